"""Frequency responses as the flight shows them, with their coherence, to be held beside the model's.

Spectra are averaged over windows that overlap by half; of two inputs that act together each is freed of what goes with
the other (Bendat & Piersol, "Random Data", 4th ed., ch. 7; Tischler & Remple, "Aircraft and Rotorcraft System
Identification", 2nd ed., ch. 7 to 9).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.arrays import Array
from sysid.signals.preparation import Prepared
from sysid.signals.record import OUTPUTS, SURFACES

Complex = NDArray[np.complex128]

# Windows in a flight, with their half overlaps, and what a window lasts, s.
_WINDOWS, _WINDOW_S = 4.5, (4.0, 20.0)
# Standard error of windows that overlap by half over that of as many apart (Tischler & Remple, eq. 7.46).
_OVERLAP = 0.55**0.5
# A surface that moves less, rad rms, is no input; a frequency counts where it has this share of the input's density at
# its largest (below, an autopilot's answer to the gyros' noise is what moves the surface, and the response would be the
# autopilot's, inverted), and where the other input leaves it this share.
_STILL, _EXCITED, _OWN = 0.003, 0.03, 0.1
_LEAST_HZ, _MOST_HZ = 0.1, 10.0
# Share of an output that may be missing in a stretch.
_MISSING = 0.05
_TOGETHER = {"de": ("de",), "da": ("da", "dr"), "dr": ("dr", "da")}


@dataclass(frozen=True)
class MeasuredResponse:
    """A transfer function and its coherence at F frequencies, and the standard errors of gain, dB, and phase, rad."""

    frequency_hz: Array
    response: Complex
    coherence: Array
    gain_std_db: Array
    phase_std_rad: Array

    def to_json(self) -> dict[str, list[float]]:
        """As results hold it."""
        return {
            "frequency_hz": self.frequency_hz.tolist(),
            "gain_db": (20.0 * np.log10(np.abs(self.response))).tolist(),
            "gain_std_db": self.gain_std_db.tolist(),
            "phase_rad": np.angle(self.response).tolist(),
            "phase_std_rad": self.phase_std_rad.tolist(),
            "coherence": self.coherence.tolist(),
        }


def measured_json(flights: Sequence[Prepared], pairs: Sequence[tuple[str, str]]) -> dict[str, dict[str, Any]]:
    """ "output / input" -> the measured response, where the flights show one. flights: surfaces as they moved."""
    found = {}
    for source, output in pairs:
        response = measured_response(flights, source, output)
        if response is not None:
            found[f"{output} / {source}"] = response.to_json()
    return found


def measured_response(flights: Sequence[Prepared], source: str, output: str) -> MeasuredResponse | None:
    """The response of an output to a surface, None where the flights show none."""
    together = [SURFACES.index(name) for name in _TOGETHER[source]]
    found: dict[float, list[tuple[Array, Array]]] = {}
    for flight in flights:
        for stretch in flight.stretches:
            record, y = stretch.record, stretch.record.z[:, OUTPUTS.index(output)]
            good = np.isfinite(y)
            if good.mean() < 1.0 - _MISSING:
                continue
            whole = np.interp(np.arange(y.size), np.flatnonzero(good), y[good])
            inputs = record.commands[record.start : record.start + y.size, together].T
            found.setdefault(record.interval_s, []).append((inputs, whole[: inputs.shape[1]]))
    if not found:
        return None
    # Of flights at several rates those of the rate at which most was recorded.
    interval_s = max(found, key=lambda one: one * sum(y.size for _, y in found[one]))
    return averaged(found[interval_s], interval_s)


def averaged(pieces: Sequence[tuple[Array, Array]], interval_s: float) -> MeasuredResponse | None:
    """The response to the first input, the others' part taken out.

    Parameters
    ----------
    pieces : sequence of (Array, Array), shapes (I, N) and (N,)
        One or two inputs, each the mean from a sample to the next, and the output at the samples, any units.
    interval_s : float
        Sampling interval, s.

    Returns
    -------
    MeasuredResponse or None
        None where the input hardly moves, or fewer than two windows fit.

    References
    ----------
    Bendat & Piersol, "Random Data", 4th ed., sections 7.3 and 9.1.
    """
    inputs = [row for row in range(pieces[0][0].shape[0]) if row == 0 or _moves(pieces, row)]
    if not _moves(pieces, 0):
        return None
    size = _window_size([y.size for _, y in pieces], interval_s)
    pieces = [(u, y) for u, y in pieces if y.size >= size]
    total = sum(y.size for _, y in pieces) * interval_s
    window, count, sums = np.hanning(size), 0, None
    for u, y in pieces:
        for begin in range(0, y.size - size + 1, max(size // 2, 1)):
            here = slice(begin, begin + size)
            rows = np.fft.rfft(window * _level(np.vstack([u[inputs, here], y[None, here]])), axis=1)
            products = np.einsum("if,jf->ijf", rows, rows.conj())
            sums, count = products if sums is None else sums + products, count + 1
    if sums is None or count < 2:
        return None
    frequency = np.asarray(np.fft.rfftfreq(size, interval_s), dtype=np.float64)
    left, own = _free_of_others(sums)
    input_density, output_density, cross = left[0, 0].real, left[1, 1].real, left[1, 0]
    kept = (frequency >= _LEAST_HZ) & (frequency <= min(_MOST_HZ, 0.4 / interval_s)) & (own > _OWN)
    kept &= input_density > _EXCITED * input_density.max()
    if not kept.any():
        return None
    frequency, cross = frequency[kept], cross[kept]
    coherence = np.abs(cross) ** 2 / np.maximum(input_density[kept] * output_density[kept], 1e-300)
    coherence = np.minimum(coherence, 1.0)
    # The input's samples stand half an interval behind their stamps.
    response = cross / input_density[kept] * np.exp(1j * np.pi * frequency * interval_s)
    apart = total / (size * interval_s)
    error = _OVERLAP * np.sqrt((1.0 - coherence) / np.maximum(2.0 * apart * coherence, 1e-12))
    return MeasuredResponse(frequency, response, coherence, 20.0 / np.log(10.0) * error, error)


def _window_size(sizes: Sequence[int], interval_s: float) -> int:
    """Samples of a window: the longest of which those pieces that hold one hold several, else of which most do."""
    least, most = (round(seconds / interval_s) for seconds in _WINDOW_S)
    wanted = min(max(round(sum(sizes) / _WINDOWS), least), most)
    candidates = [wanted, *sorted((one for one in set(sizes) if one < wanted), reverse=True)]

    def windows(size: int) -> float:
        return sum(one for one in sizes if one >= size) / size

    return next((one for one in candidates if windows(one) >= _WINDOWS), max(candidates, key=windows))


def _moves(pieces: Sequence[tuple[Array, Array]], row: int) -> bool:
    return float(np.std(np.concatenate([u[row] for u, _ in pieces]))) > _STILL


def _level(values: Array) -> Array:
    """Rows without mean and slope."""
    place = np.arange(values.shape[1]) - 0.5 * (values.shape[1] - 1)
    flat = values - values.mean(axis=1, keepdims=True)
    return np.asarray(flat - np.outer(flat @ place / (place @ place), place))


def _free_of_others(sums: Complex) -> tuple[Complex, Array]:
    """(2, 2, F) spectra of the first input and the output without what goes with the second input, and the share (F,)
    of the first input that is its own.
    """
    if sums.shape[0] == 2:
        return sums, np.ones(sums.shape[2])
    places = np.ix_((0, 2), (0, 2))
    other = np.maximum(sums[1, 1].real, 1e-300)
    taken = np.einsum("if,jf->ijf", sums[(0, 2), 1], sums[1, (0, 2)]) / other
    left = sums[places] - taken
    return left, left[0, 0].real / np.maximum(sums[0, 0].real, 1e-300)
