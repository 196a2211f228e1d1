"""Phase-optimised, mutually orthogonal multisines.

Source: Klein & Morelli, Aircraft System Identification, 2nd ed., 9.5.2: u_j(t) = sum over k in K_j of A_k
sin(2 pi k t / T + phi_k) with disjoint sets K_j of harmonics of one base period T, phases chosen for a small
relative peak factor.
Phases: Schroeder's (IEEE Trans. Inf. Theory 16, 1970), then the clipping algorithm of Van der Ouderaa,
Schoukens and Renneboog (IEEE Trans. Instrum. Meas. 37, 1988).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_CLIP_LEVELS = (0.75, 0.85, 0.95)
_ITERATIONS = 150
_STARTS = 4


def relative_peak_factor(values: Array) -> float:
    """Relative peak factor, (max - min) / (2 sqrt(2) rms).

    It is 1 for a sine; the smaller, the more power for a given amplitude.

    Parameters
    ----------
    values : Array, shape (N,)
        The signal, in any unit.

    Returns
    -------
    float
        Relative peak factor, dimensionless.

    References
    ----------
    Klein & Morelli, Aircraft System Identification, 2nd ed., 9.5.2.
    """
    return float((values.max() - values.min()) / (2.0 * np.sqrt(2.0 * np.mean(values**2))))


def harmonic_sets(low: float, high: float, period: float, axes: int) -> list[tuple[int, ...]]:
    """Disjoint, interleaved harmonic numbers for `axes` inputs, of frequencies from `low` to `high`, Hz."""
    first, last = max(1, int(np.ceil(low * period - 1e-9))), int(np.floor(high * period + 1e-9))
    return [tuple(range(first + axis, last + 1, axes)) for axis in range(axes)]


def synthesise(
    harmonics: Sequence[int],
    phases: Sequence[float],
    time: Array,
    period: float,
    weights: Sequence[float] | None = None,
) -> Array:
    """Multisine, the sum of w_k sin(2 pi k t / period + phi_k).

    Parameters
    ----------
    harmonics : Sequence[int], length K
        Harmonics k of the base period.
    phases : Sequence[float], length K
        Phases phi_k, rad.
    time : Array, shape (N,)
        Time t, s.
    period : float
        Base period, s.
    weights : Sequence[float], length K, optional
        Amplitudes w_k, in the unit of the signal; 1 where none are given.

    Returns
    -------
    Array, shape (N,)
        The signal, in the unit of the weights.

    References
    ----------
    Klein & Morelli, Aircraft System Identification, 2nd ed., 9.5.2.
    """
    angle = 2.0 * np.pi / period * np.outer(time, np.asarray(harmonics, dtype=np.float64))
    waves = np.sin(angle + np.asarray(phases, dtype=np.float64))
    return np.asarray(waves.sum(axis=1) if weights is None else waves @ np.asarray(weights, dtype=np.float64))


@lru_cache(maxsize=64)
def optimised_phases(harmonics: tuple[int, ...], weights: tuple[float, ...] = ()) -> tuple[float, ...]:
    """Phases (rad) of `harmonics` with a small relative peak factor, starting at a rising zero.

    weights: their relative amplitudes, all above 0; equal ones where none are given. Deterministic. For ten
    harmonics or more of equal amplitude the factor is below about 1.2.
    """
    numbers = np.asarray(harmonics)
    sizes = np.asarray(weights, dtype=np.float64) if weights else np.ones(numbers.size)
    count = numbers.size
    samples = 1 << int(np.ceil(np.log2(16 * numbers.max())))
    # A shape of this power: what its peaks are over.
    rms = float(np.sqrt(np.sum(sizes**2) / 2.0))
    generator = np.random.default_rng(count)
    away = [generator.uniform(-1.0, 1.0, count) * start for start in range(1, _STARTS)]
    phases = _schroeder(sizes) + np.stack([np.zeros(count), *away])
    best, least = phases[0], np.inf
    for level in _CLIP_LEVELS:
        for _ in range(_ITERATIONS):
            signals = _signals(numbers, phases, samples, sizes)
            high, low = signals.max(axis=1), signals.min(axis=1)
            factors = (high - low) / (2.0 * np.sqrt(2.0) * rms)
            if factors.min() < least:
                least, best = float(factors.min()), phases[int(np.argmin(factors))]
            middle, half = ((high + low) / 2.0)[:, None], ((high - low) / 2.0)[:, None]
            clipped = np.clip(signals, middle - level * half, middle + level * half)
            phases = np.angle(np.fft.rfft(clipped)[:, numbers]) + np.pi / 2.0
    return tuple(float(phase) for phase in _start_at_zero(numbers, best, samples, sizes))


def _schroeder(sizes: Array) -> Array:
    """Schroeder's phases: the signal dwells at each harmonic for as long as its share of the power."""
    share = sizes**2 / np.sum(sizes**2)
    before = np.concatenate(([0.0], np.cumsum(share)[:-1]))
    return np.asarray(-2.0 * np.pi * np.concatenate(([0.0], np.cumsum(before[1:]))))


def _signals(numbers: NDArray[np.int64], phases: Array, samples: int, sizes: Array) -> Array:
    """(S, samples) periods of the multisines of phases (S, K)."""
    spectra = np.zeros((phases.shape[0], samples // 2 + 1), dtype=np.complex128)
    spectra[:, numbers] = 0.5 * samples * sizes * np.exp(1j * (phases - np.pi / 2.0))
    return np.fft.irfft(spectra, samples)


def _start_at_zero(numbers: NDArray[np.int64], phases: Array, samples: int, sizes: Array) -> Array:
    """Shift the period so that it begins where the signal rises through zero (no step at start and end)."""
    signal = _signals(numbers, phases[None, :], samples, sizes)[0]
    crossing = int(np.argmax((signal <= 0.0) & (np.roll(signal, -1) > 0.0)))
    rise = signal[(crossing + 1) % samples] - signal[crossing]
    offset = (crossing - signal[crossing] / rise) / samples
    # One linear step lands within the sample; a few Newton steps make the start exact.
    for _ in range(4):
        angle = 2.0 * np.pi * numbers * offset + phases
        offset -= (sizes @ np.sin(angle)) / (2.0 * np.pi * (sizes * numbers) @ np.cos(angle))
    return np.asarray(np.mod(phases + 2.0 * np.pi * numbers * offset, 2.0 * np.pi))
