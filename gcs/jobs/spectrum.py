"""Power spectral densities of recorded signals, of a whole stretch and over time, by Welch's method."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Segments of an average: so many fit into the stretch, overlapping by half; and the longest, samples.
_SEGMENTS, _LONGEST = 8, 16384
_FEWEST = 32
# A stretch with so large a share of its samples missing has no spectrum.
_MOST_MISSING = 0.5
# Beyond it a square is beyond all numbers; nothing that flies measures it.
_LARGEST = 1e100
# Of a spectrogram: its columns, and the longest segment, samples.
_MOST_COLUMNS, _LONGEST_SHORT = 300, 256
# Samples of an hour at a kilohertz: more are not looked at.
_MOST = 4_000_000


def power_spectral_density(time_s: Array, values: Array) -> tuple[Array, Array]:
    """One-sided power spectral density of samples whose stamps need not be even.

    P. D. Welch, "The Use of Fast Fourier Transform for the Estimation of Power Spectra", IEEE Trans. Audio
    Electroacoustics 15 (1967), by `scipy.signal.welch`: Hann windows, half overlapping, a straight line taken out of
    each. What is missing is drawn straight between its neighbours first, at the median interval of the stamps.

    Parameters
    ----------
    time_s, values : Array, shape (n,)
        Stamps, ascending, s, and samples, NaN where there is none.

    Returns
    -------
    frequency : Array, shape (m,)
        Hz, without zero; empty where there are too few samples.
    density : Array, shape (m,)
        Square of the values' unit per Hz.
    """
    from scipy.signal import detrend, welch

    _, step, even = _evenly(time_s, values)
    if not even.size:
        return np.empty(0), np.empty(0)
    length = int(min(max(2 * even.size // (_SEGMENTS + 1), _FEWEST), even.size, _LONGEST))
    frequency, density = welch(even, 1.0 / step, "hann", length, detrend=detrend)
    return np.asarray(frequency[1:]), np.asarray(density[1:])


def spectrogram(time_s: Array, values: Array) -> tuple[Array, Array, Array]:
    """Power spectral density over time, by `scipy.signal.spectrogram`: short segments, each as in Welch's method.

    Parameters
    ----------
    time_s, values : Array, shape (n,)
        Stamps, ascending, s, and samples, NaN where there is none.

    Returns
    -------
    middle : Array, shape (k,)
        Middles of the stretches that were averaged, at even steps, s. Empty where there are too few samples.
    frequency : Array, shape (m,)
        Hz, without zero.
    density : Array, shape (m, k)
        Square of the values' unit per Hz.
    """
    from scipy.signal import detrend
    from scipy.signal import spectrogram as of_segments

    begin, step, even = _evenly(time_s, values)
    if not even.size:
        return np.empty(0), np.empty(0), np.empty((0, 0))
    length = int(min(max(even.size // 8, _FEWEST), even.size, _LONGEST_SHORT))
    # The window is named, not given as weights: scipy takes the segment's length from those.
    frequency, middle, density = of_segments(even, 1.0 / step, "hann", length, length // 2, detrend=detrend)
    together = -(-middle.size // _MOST_COLUMNS)
    edges = np.arange(0, middle.size, together)
    counts = np.diff(np.append(edges, middle.size))  # the last one is of what is left
    means = np.add.reduceat(density[1:], edges, axis=1) / counts
    apart = float(middle[1] - middle[0]) if middle.size > 1 else 0.0
    return begin + middle[0] + apart * (edges + 0.5 * (together - 1)), frequency[1:], means


def _evenly(time_s: Array, values: Array) -> tuple[float, float, Array]:
    """Begin, interval (s) and samples at even steps; no samples where there are too few, or too many are missing."""
    time_s, values = time_s[:_MOST], values[:_MOST]  # they may be a mapped file
    good = np.abs(values) < _LARGEST
    time_s, values = time_s[good], values[good]
    if time_s.size < _FEWEST:
        return 0.0, 0.0, np.empty(0)
    step = float(np.median(np.diff(time_s)))
    count = round((time_s[-1] - time_s[0]) / step) + 1 if step > 0.0 else 0
    if not time_s.size <= count * 2 or time_s.size < (1.0 - _MOST_MISSING) * count:
        return 0.0, 0.0, np.empty(0)
    begin = float(time_s[0])
    return begin, step, np.interp(begin + step * np.arange(count), time_s, values)
