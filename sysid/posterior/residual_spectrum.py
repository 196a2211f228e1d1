"""The spectrum matrix of what a simulation leaves: gusts, what the structure lacks, sensor noise, vibration.

Welch's cross-spectra of the residuals (IEEE Trans. Audio Electroacoust. 15, 1967), as the weight of Whittle's
likelihood: output error with coloured noise of unknown spectrum (Morelli & Klein, Aircraft System Identification,
ch. 6, gives the scalar case; McKelvey & Ljung 1997 the matrix).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.arrays import Array
from sysid.posterior.observations import CommonGrid

Complex = NDArray[np.complex128]

# Band of the spectrum of what is left, and the share of a message's rate up to which an output is compared.
LOWEST_HZ, HIGHEST_HZ, NYQUIST_SHARE = 0.05, 15.0, 0.42
# The same where commands answer the noise: a loop makes the mean of the likelihood's slopes zero at the truth over the
# whole band alone (Bode's integral); over less, what lies beyond it is paid for by a pole that is too fast.
WHOLE_HZ, WHOLE_SHARE = 25.0, 0.5
_LONGEST_WINDOW_S, _LEAST_WINDOW_S, _WINDOWS = 8.0, 1.5, 6.0
# Fewer windows than this say nothing of how outputs go together.
_LEAST_FOR_CROSS = 6.0
# What a structure never holds: this share of the motion, at most; the flight says how much of it (`misfit_share`). At
# least what it costs that between two samples of a surface nobody knows where it was, and, where that is known, what
# the smoothing of the imposed motion costs.
LEAST_MISFIT, LEAST_OF_KNOWN, LARGEST_MISFIT = 0.003, 0.001, 0.03


@dataclass(frozen=True)
class ResidualSpectrum:
    """One-sided spectrum matrices (F, m, m) at `frequencies` (F,), Hz."""

    frequencies: Array
    matrices: Complex

    def at(self, frequencies: Array) -> Complex:
        """(K, m, m) interpolated along straight lines, which keeps them positive definite; ends are constant."""
        step = self.frequencies[1] - self.frequencies[0]
        x = np.clip((frequencies - self.frequencies[0]) / step, 0.0, self.frequencies.size - 1.001)
        low = x.astype(np.int64)
        share = (x - low)[:, None, None]
        return np.asarray(self.matrices[low] * (1.0 - share) + self.matrices[low + 1] * share)


def window_length(grids: Sequence[CommonGrid]) -> int:
    """Samples of Welch's windows for parts with one interval."""
    longest = max(grid.duration_s for grid in grids)
    seconds = min(_LONGEST_WINDOW_S, max(longest / _WINDOWS, _LEAST_WINDOW_S), longest)
    return max(8, min(round(seconds / grids[0].interval_s), *(grid.points.size for grid in grids)))


def welch(series: Sequence[Array], grids: Sequence[CommonGrid], length: int) -> tuple[Complex, float]:
    """Cross-spectra (F, m, m) of (m, K) series pooled over parts, and the number of independent windows."""
    interval = grids[0].interval_s
    found = []
    for values, grid in zip(series, grids, strict=True):
        inside = np.flatnonzero(grid.taper > 0.5)
        first, last = int(inside[0]), int(inside[-1]) + 1
        if last - first < length:
            first, last = 0, values.shape[1]
        found.append(spectra_of_windows(values[:, first:last], length))
    seconds = sum(grid.duration_s for grid in grids)
    return 2.0 * interval * np.concatenate(found).mean(axis=0), max(1.8 * seconds / (length * interval), 1.0)


def spectra_of_windows(values: Array, length: int) -> Complex:
    """(windows, F, m, m) of (m, K) series in half overlapping windows of Hann, straight lines taken out.

    A window's cross-spectra are per sample and two-sided.
    """
    window = np.hanning(length + 1)[:length]
    ramp = np.arange(length) - 0.5 * (length - 1)
    parts = np.lib.stride_tricks.sliding_window_view(values, length, axis=1)[:, :: max(1, length // 2)]
    parts = parts - parts.mean(axis=2, keepdims=True)
    parts = parts - (parts @ ramp / float(ramp @ ramp))[:, :, None] * ramp
    Z = np.fft.rfft(parts * window, axis=2).transpose(1, 2, 0)
    return np.asarray(Z[:, :, :, None] * Z[:, :, None, :].conj() / float(window @ window))


def residual_spectrum(
    residuals: Sequence[Array],
    simulated: Sequence[Array],
    grids: Sequence[CommonGrid],
    misfit: float | None = None,
    least: float = LEAST_MISFIT,
) -> tuple[ResidualSpectrum, float]:
    """Spectrum matrix of the residuals of one flight's parts, and the share of misfit that it holds besides.

    residuals, simulated: per part (m, K), measured less simulated and simulated. misfit: share of the simulated
    outputs' own spectrum to add; None takes what the residuals say, at least `least`.
    """
    length = window_length(grids)
    C, windows = welch(residuals, grids, length)
    m = C.shape[1]
    frequencies = np.asarray(np.fft.rfftfreq(length, grids[0].interval_s), dtype=np.float64)
    shrink = max(0.0, 1.0 - m / windows) if windows > _LEAST_FOR_CROSS else 0.0
    diagonal = np.arange(m)
    own = C[:, diagonal, diagonal].copy()
    C *= shrink
    C[:, diagonal, diagonal] = own
    C[0] = C[1]
    C = _thirds(C)
    Y = _thirds(_without_zero(welch(simulated, grids, length)[0]))[:, diagonal, diagonal].real
    share = misfit_share(frequencies, C[:, diagonal, diagonal].real, Y, least) if misfit is None else misfit
    floor = C[:, diagonal, diagonal].real
    C[:, diagonal, diagonal] += share**2 * Y + 1e-4 * floor + 1e-4 * floor.mean(axis=0) + 1e-18
    return ResidualSpectrum(frequencies, C), share


def misfit_share(frequencies: Array, residual: Array, simulated: Array, least: float = LEAST_MISFIT) -> float:
    """How much of the motion the structure may not hold, by what residuals have beyond their flattest part.

    Sensors alone leave a flat spectrum: then nothing is added, and a textbook flight keeps its accuracy.
    """
    top = frequencies >= 0.6 * min(frequencies[-1], HIGHEST_HZ)
    band = (frequencies >= LOWEST_HZ) & (frequencies <= 5.0)
    noise = np.median(residual[top], axis=0)
    beyond = np.maximum(residual[band].sum(axis=0) - 1.3 * noise * np.count_nonzero(band), 0.0)
    ratio = beyond / np.maximum(simulated[band].sum(axis=0), 1e-300)
    return float(np.clip(np.sqrt(np.median(ratio)), least, LARGEST_MISFIT))


def noise_share(series: Sequence[Array], grids: Sequence[CommonGrid], highest_hz: float) -> float:
    """Share of the power of (K,) series in the band up to `highest_hz` that is flat noise, as its upper end has it."""
    length = window_length(grids)
    power = welch([one[None] for one in series], grids, length)[0][:, 0, 0].real
    frequencies = np.fft.rfftfreq(length, grids[0].interval_s)
    band = (frequencies >= LOWEST_HZ) & (frequencies <= highest_hz)
    level = np.median(power[band & (frequencies >= 0.6 * highest_hz)])
    return float(min(level * np.count_nonzero(band) / power[band].sum(), 1.0))


def _thirds(C: NDArray[np.complex128]) -> Complex:
    """1/4 1/2 1/4 over neighbouring frequencies."""
    wide = np.concatenate((C[:1], C, C[-1:]))
    return np.asarray(0.25 * wide[:-2] + 0.5 * wide[1:-1] + 0.25 * wide[2:])


def _without_zero(C: Complex) -> Complex:
    C[0] = C[1]
    return C
