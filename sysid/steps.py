"""Gauss-Newton steps and covariances from normal equations, in scaled unknowns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sysid.errors import EstimationError
from sysid.flight import Array

Mask = NDArray[np.bool_]


def damped_step(information: Array, downhill: Array, damping: float, flight: str) -> Array:
    """(P,) Levenberg-Marquardt step from information (P, P) and gradient downhill (P,); damping 0 is Gauss-Newton's.

    flight: its name, for the message. Raises EstimationError where either is no number, which it is where the
    simulation diverges next to the values tried: with such slopes there is no direction to go in.
    """
    require_numbers(flight, information, downhill)
    scale = _scale(information)
    scaled = information * np.outer(scale, scale)
    scaled[np.diag_indices_from(scaled)] += damping
    try:
        step: Array = np.linalg.lstsq(scaled, downhill * scale, rcond=1e-13)[0] * scale
    except np.linalg.LinAlgError:
        raise EstimationError(_no_step(flight)) from None
    return step


def hold(information: Array, downhill: Array, places: Mask, std: Array) -> None:
    """Take unknowns that go in steps out of normal equations, in place: they stay, known to `std` (P,)."""
    information[places, :] = information[:, places] = 0.0
    information[places, places] = 1.0 / std[places] ** 2
    downhill[places] = 0.0


def require_numbers(flight: str, *values: Array) -> None:
    """Raise EstimationError where anything in the normal equations of a flight is not finite."""
    if not all(np.isfinite(one).all() for one in values):
        raise EstimationError(_no_step(flight))


def inverse(M: Array) -> Array:
    """Inverse of the information matrix, scaled; directions without information get a huge variance."""
    scale = _scale(M)
    values, vectors = np.linalg.eigh(M * np.outer(scale, scale))
    values = np.maximum(values, 1e-14)
    inverse: Array = (vectors / values) @ vectors.T * np.outer(scale, scale)
    return inverse


def _scale(M: Array) -> Array:
    return np.asarray(1.0 / np.sqrt(np.maximum(np.diag(M), 1e-30)))


def _no_step(flight: str) -> str:
    return (
        f"{flight}: the motion simulated from these signals nearly diverges, so that no estimate can be improved:"
        " check units, signs and delays of the signals, or give a shorter part (--from, --to) or --method ee"
    )
