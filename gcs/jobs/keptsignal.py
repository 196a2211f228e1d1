"""One signal of a flight that was read for plots: its samples in files of numpy, of which a request reads a stretch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gcs.catalogue.decimate import decimate
from gcs.jobs.spectrum import Array, power_spectral_density, spectrogram


@dataclass(frozen=True)
class KeptSignal:
    """One signal of a flight's folder, mapped rather than read. entry: what the summary says of it."""

    folder: Path
    entry: dict[str, Any]

    def series(self, start_s: float | None, end_s: float | None, points: int) -> dict[str, Any]:
        """A stretch of it, decimated."""
        shown, samples = decimate(*self._stretch(start_s, end_s), points)
        return {
            "unit": self.entry["unit"],
            "source": self.entry["source"],
            "time": shown.tolist(),
            "value": [value if np.isfinite(value) else None for value in samples.tolist()],
        }

    def spectrum(self, start_s: float | None, end_s: float | None) -> dict[str, Any]:
        """The power spectral density of a stretch of it."""
        frequency, density = power_spectral_density(*self._stretch(start_s, end_s))
        unit = self.entry["unit"]
        return {
            "unit": f"({unit})²/Hz" if unit else "1/Hz",
            "signal_unit": unit,
            "frequency": frequency.tolist(),
            "value": density.tolist(),
        }

    def spectrogram(self, start_s: float | None, end_s: float | None) -> dict[str, Any]:
        """The power spectral density of a stretch of it over time, in dB, to a tenth."""
        middle, frequency, density = spectrogram(*self._stretch(start_s, end_s))
        unit = self.entry["unit"]
        with np.errstate(divide="ignore"):
            level = np.round(10.0 * np.log10(density), 1)
        return {
            "unit": f"dB of 1 ({unit})²/Hz" if unit else "dB of 1/Hz",
            "signal_unit": unit,
            "time": middle.tolist(),
            "frequency": frequency.tolist(),
            "value": [[value if np.isfinite(value) else None for value in row] for row in level.tolist()],
        }

    def _stretch(self, start_s: float | None, end_s: float | None) -> tuple[Array, Array]:
        time = np.load(self.folder / self.entry["time"], mmap_mode="r", allow_pickle=False)
        values = np.load(self.folder / self.entry["values"], mmap_mode="r", allow_pickle=False)
        first = 0 if start_s is None else int(np.searchsorted(time, start_s, side="left"))
        last = time.size if end_s is None else int(np.searchsorted(time, end_s, side="right"))
        return time[first:last], values[first:last]
