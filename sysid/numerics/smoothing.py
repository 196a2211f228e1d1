"""Removal of random noise without phase lag, derivatives, and the size of the noise itself.

The global Fourier smoother takes the end-point line away, reflects what is left oddly, and so gets a sine series whose
coefficients fall as k^-3 for a smooth signal while those of white noise stay level; a Wiener filter built
from that separates them (E. A. Morelli, "Estimating noise characteristics from flight test data using optimal
Fourier smoothing", Journal of Aircraft 32(4), 1995; C. Lanczos, "Applied Analysis").
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy import fft

from sysid.arrays import Array
from sysid.errors import SignalError

# Difference of order 4: a 1.7 Hz mode sampled at 50 Hz leaves 0.2 % of its amplitude, white noise sqrt(70) sigma.
_DIFFERENCE_ORDER = 4
_DIFFERENCE_GAIN = float(np.sqrt(70.0))
_MAD_TO_SIGMA = 1.4826

# Samples from which on interpolated readings are looked for, and how far their noise then seems to grow by strides.
_INTERPOLATED_LEAST = 100
_SHARED = 1.2


@dataclass(frozen=True)
class Smoothed:
    """A signal without its random noise; each of its properties is computed when it is asked for.

    ends: values at the first and last sample, through which the line goes. coefficients: (N - 2,) of the sine series
    about it. passed: (N - 2,) share of each that the filter passes. duration_s: from first to last sample.
    cutoff_hz: frequency at which signal and noise are equal.
    """

    ends: tuple[float, float]
    coefficients: Array
    passed: Array
    duration_s: float
    cutoff_hz: float

    @cached_property
    def values(self) -> Array:
        """(N,) smoothed signal, its unit."""
        first, last = self.ends
        smooth = first + (last - first) * np.linspace(0.0, 1.0, self.passed.size + 2)
        smooth[1:-1] += fft.dst(self.coefficients * self.passed, type=1) / 2.0
        return np.asarray(smooth, dtype=np.float64)

    @cached_property
    def derivative(self) -> Array:
        """(N,) time derivative of the smoothed signal, unit per second."""
        first, last = self.ends
        slope = np.zeros(self.passed.size + 2)
        order = np.arange(1, self.passed.size + 1, dtype=np.float64)
        slope[1:-1] = self.coefficients * self.passed * order * np.pi / self.duration_s
        return np.asarray((last - first) / self.duration_s + fft.dct(slope, type=1) / 2.0, dtype=np.float64)

    @property
    def noise_sigma(self) -> float:
        """Standard deviation of what was taken away, corrected for the noise that passed."""
        stopped = 1.0 - self.passed
        removed = float(np.sqrt(np.mean((self.coefficients * stopped) ** 2) / np.mean(stopped**2)))
        return removed * float(np.sqrt((self.passed.size + 1) / 2.0))


def noise_sigma(values: Array, interval_s: float) -> float:
    """Standard deviation of the white noise on a signal, from its fourth differences.

    The median makes single jumps harmless.

    Parameters
    ----------
    values : Array, shape (N,)
        Samples in any unit, NaN allowed.
    interval_s : float
        Sample interval, s; the differences need samples dense against the signal's own motion.

    Returns
    -------
    float
        Standard deviation in the unit of `values`; 0 for a signal without noise.

    Raises
    ------
    SignalError
        For fewer than 12 usable differences or an interval that is not above 0.
    """
    if not interval_s > 0.0:
        raise SignalError(f"the sample interval must be above 0 s, not {interval_s}")
    difference = np.diff(np.asarray(values, dtype=np.float64), n=_DIFFERENCE_ORDER)
    difference = difference[np.isfinite(difference)]
    if difference.size < 12:
        raise SignalError(f"noise needs at least 16 samples in a row, {difference.size} differences are usable")
    sigma = _MAD_TO_SIGMA * float(np.median(np.abs(difference - np.median(difference)))) / _DIFFERENCE_GAIN
    if sigma == 0.0:
        # More than half of the differences are equal: a coarse converter. Then the root mean square is the estimate.
        sigma = float(np.sqrt(np.mean(difference**2))) / _DIFFERENCE_GAIN
    return sigma


def sample_noise(values: Array, interval_s: float) -> float:
    """Noise of one sample as `noise_sigma` gives it, also of readings that were interpolated.

    These share their noise with their neighbours, so that every second one has more of it than the differences of all
    show, and every third one no more than that; what grows on is motion.

    Parameters
    ----------
    values : Array, shape (N,)
        Samples in any unit; those that are not finite are left out.
    interval_s : float
        Sample interval, s.

    Returns
    -------
    float
        Standard deviation in the unit of `values`.

    Raises
    ------
    SignalError
        As `noise_sigma` does: for fewer than 12 usable differences or an interval that is not above 0.
    """
    known = values[np.isfinite(values)]
    every = noise_sigma(known, interval_s)
    if known.size < _INTERPOLATED_LEAST:
        return every
    second, third = (noise_sigma(known[::k], k * interval_s) for k in (2, 3))
    return second if second > _SHARED * every and third < _SHARED * second else every


def fourier_smooth(values: Array, interval_s: float, cutoff_hz: float | None = None) -> Smoothed:
    """Smooth a signal by its global sine series and a Wiener filter; no phase lag.

    Parameters
    ----------
    values : Array, shape (N,)
        Finite uniform samples in any unit, N >= 16.
    interval_s : float
        Sample interval, s.
    cutoff_hz : float or None
        Frequency at which the filter passes one half, Hz; None finds it from the noise floor of the series. Give the
        same number for every signal of one regression, so that all are filtered alike.

    Returns
    -------
    Smoothed
        Smoothed signal, (N,), in the unit of `values`, its time derivative, (N,), in that unit per second, and the
        standard deviation of the noise, in that unit; each is computed when it is asked for.

    Raises
    ------
    SignalError
        For too few or not finite samples.

    References
    ----------
    E. A. Morelli, "Estimating noise characteristics from flight test data using optimal Fourier smoothing", Journal of
    Aircraft 32(4), 1995.
    C. Lanczos, "Applied Analysis".
    """
    values = np.asarray(values, dtype=np.float64)
    if values.size < 16 or not np.all(np.isfinite(values)):
        raise SignalError(f"smoothing needs at least 16 finite samples, {int(np.isfinite(values).sum())} are given")
    duration = (values.size - 1) * interval_s
    first, last = (float(end) for end in _end_points(values))
    line = first + (last - first) * np.linspace(0.0, 1.0, values.size)
    coefficients = fft.dst((values - line)[1:-1], type=1) / (values.size - 1)
    cutoff_order = _cutoff_order(coefficients) if cutoff_hz is None else 2.0 * duration * cutoff_hz
    passed = _passed(coefficients.size, cutoff_order)
    return Smoothed((first, last), coefficients, passed, duration, cutoff_order / (2.0 * duration))


def smooth_columns(values: Array, interval_s: float, cutoff_hz: float) -> Array:
    """What `fourier_smooth` gives for each column, in one transform, without derivatives and noise.

    Parameters
    ----------
    values : Array, shape (N, P)
        Uniform samples, finite, N >= 16; each column in its own unit.
    interval_s : float
        Sample interval, s.
    cutoff_hz : float
        Frequency at which the filter passes one half, Hz.

    Returns
    -------
    Array, shape (N, P)
        Smoothed columns, each in its own unit.

    Raises
    ------
    SignalError
        For too few or not finite samples.

    References
    ----------
    E. A. Morelli, "Estimating noise characteristics from flight test data using optimal Fourier smoothing", Journal of
    Aircraft 32(4), 1995.
    C. Lanczos, "Applied Analysis".
    """
    size = values.shape[0]
    if size < 16 or not np.isfinite(values).all():
        raise SignalError("Fourier smoothing needs at least 16 samples, all of them finite")
    first, last = _end_points(values)
    line = first + np.linspace(0.0, 1.0, size)[:, None] * (last - first)
    coefficients = fft.dst((values - line)[1:-1], type=1, axis=0) / (size - 1)
    passed = _passed(size - 2, 2.0 * (size - 1) * interval_s * cutoff_hz)
    line[1:-1] += fft.dst(coefficients * passed[:, None], type=1, axis=0) / 2.0
    return np.asarray(line, dtype=np.float64)


def _end_points(values: Array) -> tuple[Array, Array]:
    """Smoothed end values of (N,) or (N, P): the series cannot take noise off the two points its line goes through."""
    count = min(max(values.shape[0] // 20, 7), 15)
    weights = _end_weights(count)
    return weights @ values[:count], weights @ values[: -count - 1 : -1]


@lru_cache
def _end_weights(count: int) -> Array:
    """(count,) weights of the samples at an end in the constant of a quadratic fitted to them."""
    return np.asarray(np.linalg.pinv(np.vander(np.arange(count, dtype=np.float64), 3))[2])


def _passed(count: int, cutoff_order: float) -> Array:
    """(count,) share of each order that the filter passes.

    S^2/(S^2 + N^2) with S^2 = N^2 (k/kc)^-6, the power law of a signal with continuous value and slope.
    """
    relative = np.arange(1, count + 1, dtype=np.float64) / cutoff_order
    return np.asarray(1.0 / (1.0 + (relative * relative * relative) ** 2))


def _cutoff_order(coefficients: Array) -> float:
    """Order at which the power of the signal has fallen to that of the noise."""
    power = (coefficients / max(float(np.max(np.abs(coefficients))), 1e-300)) ** 2
    count = power.size
    # Upper half of the band: noise alone. 0.4549 is the median of chi-squared with one degree of freedom.
    floor = float(np.median(power[count // 2 :])) / 0.4549
    window = min(max(9, count // 60), count)
    mean = np.convolve(power, np.ones(window) / window, mode="same")
    above = np.flatnonzero(mean > 4.0 * floor)
    if above.size == 0:
        return 1.0
    # 1.8: a resonance just below the last order that is above the noise still passes with 97 % of its amplitude.
    return float(min(max(above[-1] + 1.0 - window / 2.0, 1.0) * 1.8, count))
