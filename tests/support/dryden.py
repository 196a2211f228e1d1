"""The closed forms of the Dryden spectra, against which gusts are held."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def dryden_spectrum(frequency: ArrayLike, sigma: float, length: float, airspeed: float) -> NDArray[np.float64]:
    """One-sided spectra of the gusts (u, v, w), (3, N), (m/s)^2 per rad/s, at `frequency`, rad/s."""
    x2 = (np.asarray(frequency, dtype=np.float64) * length / airspeed) ** 2
    scale = sigma**2 * length / airspeed / np.pi
    along = 2.0 * scale / (1.0 + x2)
    across = scale * (1.0 + 3.0 * x2) / (1.0 + x2) ** 2
    return np.stack([along, across, across])
