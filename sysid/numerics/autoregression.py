"""Whitening of coloured series by an autoregression."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.arrays import Array
from sysid.numerics.filters import correlation


def autoregression(series: Sequence[Array], order: int) -> Array:
    """Whitening filter (order + 1,) 1, -a1, -a2 ... of pooled series, by the Yule-Walker equations."""
    count = sum(one.size for one in series)
    covariance = np.array([
        sum(float(one[lag:] @ one[: one.size - lag]) for one in series if one.size > lag) / count
        for lag in range(order + 1)
    ])  # fmt: skip
    if covariance[0] <= 0.0:
        return np.concatenate(([1.0], np.zeros(order)))
    # A little white noise keeps the equations solvable for a series without any.
    covariance[0] *= 1.0 + 1e-9
    places = np.abs(np.subtract.outer(np.arange(order), np.arange(order)))
    weights = np.linalg.solve(covariance[places], covariance[1:])
    return np.concatenate(([1.0], -weights))


def apply_whitening_filter(values: Array, taps: Array) -> Array:
    """(N,) or (N, P) passed through the whitening filter along the first axis; the first samples, half in, left out."""
    order = taps.size - 1
    if values.ndim == 1:
        return np.convolve(values, taps, mode="valid")
    white: Array = taps[0] * values[order:]
    for lag in range(1, order + 1):
        white = white + taps[lag] * values[order - lag : values.shape[0] - lag]
    return white


def pooled_autocorrelation(series: Sequence[Array], share: float = 0.2) -> Array:
    """Two-sided normalised autocorrelation of residuals, tapered, (2 L + 1,), pooled over series; NaN counts as 0.

    Lags are kept up to `share` of the shortest series and end where the correlation is first lost in its own noise.
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
