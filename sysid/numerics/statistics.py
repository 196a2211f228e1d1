"""Statistics of residuals that several estimators share."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import fft, linalg

from sysid.arrays import Array

_WINDOW_S, _SHORTEST_WINDOW = 8.0, 32  # s and samples of a window of Welch's spectrum


def spectral_span(runs: Sequence[Array], interval_s: float) -> float:
    """Logarithm of the largest over the smallest spectral density of runs of one residual.

    Largest and smallest are the densities that 95 and 5 % of the frequencies stay below. Welch's method, windows of a
    sixth of the longest run, 8 s at most, 32 samples at least, smoothed over three frequencies.

    Parameters
    ----------
    runs : Sequence of Array, shape (N,) each
        Residual of each run, in any one unit, NaN where nothing was read; runs with fewer finite samples than a window,
        and so all with less than 32, do not count.
    interval_s : float
        Sample interval, s.

    Returns
    -------
    float
        Natural logarithm of the ratio, dimensionless; 0 where no run is long enough.
    """
    clean = [run[np.isfinite(run)] for run in runs]
    longest = max((run.size for run in clean), default=0)
    length = max(min(longest // 6, round(_WINDOW_S / interval_s)), _SHORTEST_WINDOW)
    window = np.hanning(length + 1)[:length]
    density, count = np.zeros(length // 2 + 1), 0
    for run in clean:
        for begin in range(0, run.size - length + 1, max(1, length // 2)):
            part = run[begin : begin + length]
            density += np.abs(np.fft.rfft((part - part.mean()) * window)) ** 2
            count += 1
    if not count:
        return 0.0
    inner = density[1:-1]
    wide = np.concatenate((inner[:1], inner, inner[-1:]))
    low, high = np.percentile(0.25 * wide[:-2] + 0.5 * wide[1:-1] + 0.25 * wide[2:], (5.0, 95.0))
    return float(np.log(high / max(low, 1e-300)))


def sample_autocorrelation(values: Array, lags: int) -> Array:
    """Normalised autocorrelation about the mean at lag 0..lags.

    Parameters
    ----------
    values : Array, shape (N,)
        Finite samples in any unit.
    lags : int
        Largest lag, in samples.

    Returns
    -------
    Array, shape (lags + 1,)
        Autocorrelation, dimensionless, 1 at lag 0; that of a constant is 0 at all other lags.
    """
    centred = values - values.mean()
    size = fft.next_fast_len(centred.size + lags, real=True)
    sums = fft.irfft(np.abs(fft.rfft(centred, size)) ** 2, size)[: lags + 1]
    return np.asarray(sums / sums[0], dtype=np.float64) if sums[0] > 0.0 else np.eye(1, lags + 1)[0]


def autoregressive_innovations(values: Array, order: int | None = None) -> Array:
    """Innovations of an autoregressive model fitted to a residual (Yule-Walker), order by AIC if None.

    values: (N,) finite. Returns (N - order,).
    """
    centred = values - values.mean()
    highest = min(max(values.size // 10, 1), 20) if order is None else order
    rho = sample_autocorrelation(values, highest)
    chosen, best = 0, 0.0
    if order is None:
        for p in range(1, highest + 1):
            weights = linalg.solve_toeplitz(rho[:p], rho[1 : p + 1])
            gain = 1.0 - float(weights @ rho[1 : p + 1])
            score = values.size * np.log(max(gain, 1e-12)) + 2.0 * p
            if score < best - 1e-9:
                chosen, best = p, score
    else:
        chosen = order
    if chosen == 0:
        return np.asarray(centred, dtype=np.float64)
    weights = linalg.solve_toeplitz(rho[:chosen], rho[1 : chosen + 1])
    innovation = centred[chosen:].copy()
    for lag in range(1, chosen + 1):
        innovation -= weights[lag - 1] * centred[chosen - lag : centred.size - lag]
    return np.asarray(innovation, dtype=np.float64)


def gaussian_p(values: Array) -> float | None:
    """Probability of a residual's whitened values, if Gaussian, of looking at least as little like it.

    D'Agostino & Pearson's K^2 on the whitened series: the test assumes independent samples, and residuals of
    flight data are not.

    Parameters
    ----------
    values : Array, shape (N,)
        Residual in any unit; samples that are not finite are left out.

    Returns
    -------
    float or None
        Probability, dimensionless; None for fewer than 40 finite samples or a constant.
    """
    finite = values[np.isfinite(values)]
    if finite.size < 40 or np.ptp(finite) == 0.0:
        return None
    from scipy import stats  # slow to import, and wanted for this alone

    return float(stats.normaltest(autoregressive_innovations(finite)).pvalue)


def effective_count(values: Array) -> float:
    """Number of independent samples a correlated series is worth for its mean (initial positive sequence).

    Parameters
    ----------
    values : Array, shape (N,)
        Finite samples in any unit.

    Returns
    -------
    float
        Effective number of samples.
    """
    rho = sample_autocorrelation(values, max(values.size // 5, 1))
    negative = np.flatnonzero(rho < 0.0)
    stop = int(negative[0]) if negative.size else rho.size
    return float(values.size / (1.0 + 2.0 * rho[1:stop].sum()))


def white_noise_std(values: Array) -> float:
    """Standard deviation of white noise in a smooth series, by its third differences.

    Parameters
    ----------
    values : Array, shape (N,)
        Evenly spaced samples of any unit.

    Returns
    -------
    float
        Standard deviation, in the unit of `values`; 0 for fewer than four samples.
    """
    # Of a normal distribution, the standard deviation over the median distance; 1 9 9 1 is what they add up to.
    return 1.4826 * float(np.median(np.abs(np.diff(values, 3)))) / np.sqrt(20.0) if values.size > 3 else 0.0


def without(std: float, share: float) -> float:
    """What is left of a standard error without an independent part of it."""
    return math.sqrt(max(std**2 - share**2, 0.0))
