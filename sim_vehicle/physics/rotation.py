"""Attitude: Euler angles and the quaternion."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def quaternion(phi: float, theta: float, psi: float) -> Array:
    """Quaternion (4,), scalar first, of the 3-2-1 Euler angles [rad]."""
    cr, sr, cp, sp = math.cos(phi / 2), math.sin(phi / 2), math.cos(theta / 2), math.sin(theta / 2)
    cy, sy = math.cos(psi / 2), math.sin(psi / 2)
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )
