"""Attitude: 3-2-1 Euler angles, the quaternion (scalar first), the matrix from earth to body axes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit_inlined

Array = NDArray[np.float64]


@jit_inlined
def quaternion_parts(phi: float, theta: float, psi: float) -> tuple[float, float, float, float]:
    """Quaternion of Euler angles [rad] (Stevens & Lewis, eq. 1.8-16)."""
    cr, sr, cp, sp = math.cos(phi / 2), math.sin(phi / 2), math.cos(theta / 2), math.sin(theta / 2)
    cy, sy = math.cos(psi / 2), math.sin(psi / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def quaternion(phi: float, theta: float, psi: float) -> Array:
    """Quaternion of the 3-2-1 Euler angles.

    Parameters
    ----------
    phi, theta, psi : float
        Roll, pitch and yaw angle, rad.

    Returns
    -------
    Array, shape (4,)
        Quaternion, scalar first, dimensionless.
    """
    return np.array(quaternion_parts(phi, theta, psi))


@jit_inlined
def euler_angles(q0: float, q1: float, q2: float, q3: float) -> tuple[float, float, float]:
    """phi, theta, psi [rad] of a quaternion (Stevens & Lewis, eq. 1.8-17)."""
    phi = math.atan2(2.0 * (q2 * q3 + q0 * q1), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3)
    theta = math.asin(min(max(2.0 * (q0 * q2 - q1 * q3), -1.0), 1.0))
    psi = math.atan2(2.0 * (q1 * q2 + q0 * q3), q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3)
    return phi, theta, psi


@jit_inlined
def rotation_matrix(
    q0: float, q1: float, q2: float, q3: float
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Rotation matrix from earth to body axes, row by row (Stevens & Lewis, eq. 1.8-14)."""
    r11 = q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3
    r12 = 2.0 * (q1 * q2 + q0 * q3)
    r13 = 2.0 * (q1 * q3 - q0 * q2)
    r21 = 2.0 * (q1 * q2 - q0 * q3)
    r22 = q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3
    r23 = 2.0 * (q2 * q3 + q0 * q1)
    r31 = 2.0 * (q1 * q3 + q0 * q2)
    r32 = 2.0 * (q2 * q3 - q0 * q1)
    r33 = q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3
    return r11, r12, r13, r21, r22, r23, r31, r32, r33
