"""Autocorrelation of residuals, pooled over series."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.arrays import Array
from sysid.numerics.filters import correlation


def pooled_autocorrelation(series: Sequence[Array], share: float = 0.2) -> Array:
    """Two-sided normalised autocorrelation of residuals, tapered, pooled over series.

    Lags are kept up to `share` of the shortest series and end where the correlation is first lost in its own noise.

    Parameters
    ----------
    series : Sequence of Array, shape (N,) each
        Residuals, all in one unit, which may be any; NaN counts as 0.
    share : float
        Largest lag over the length of the shortest series, dimensionless.

    Returns
    -------
    Array, shape (2 L + 1,)
        Autocorrelation at the lags -L to L, in samples, dimensionless; 1 in the middle. L is 0 where all residuals
        are 0.
    """
    length = max(2, int(share * min(len(x) for x in series)))
    total, power, count = np.zeros(length), 0.0, 0
    for x in series:
        clean = np.nan_to_num(x)
        total += correlation(clean, length)
        power += float(clean @ clean)
        count += len(clean)
    if power <= 0.0:
        return np.array([1.0])
    rho = total / power
    limit = 2.0 / np.sqrt(count)
    small = np.nonzero(np.abs(rho) < limit)[0]
    if small.size:
        rho = rho[: max(int(small[0]), 1)]
    return np.concatenate((rho[:0:-1], rho))
