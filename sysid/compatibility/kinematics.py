"""Kinematics of a rigid aircraft over a flat earth: six equations without aerodynamics, mass or thrust.

    u' = r v - q w - g sin(theta) + ax          phi'   = p + tan(theta) (q sin(phi) + r cos(phi))
    v' = p w - r u + g cos(theta) sin(phi) + ay  theta' = q cos(phi) - r sin(phi)
    w' = q u - p v + g cos(theta) cos(phi) + az  psi'   = (q sin(phi) + r cos(phi)) / cos(theta)

Source: Klein & Morelli, "Aircraft System Identification", chapter 10; state order u v w phi theta psi throughout,
velocities relative to an air mass that moves uniformly.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np

from sim_vehicle.jit import jit, jit_arrays
from sysid.arrays import Array

STATES = ("u", "v", "w", "phi", "theta", "psi")


@jit
def derivative(x: Array, imu: Array, gravity: float, out: Array) -> None:
    """Time derivative of the state.

    x: (6,) u v w (m/s) phi theta psi (rad). imu: (6,) ax ay az (m/s^2) p q r (rad/s) at the centre of gravity.
    gravity: m/s^2. out: (6,), written.
    """
    u, v, w = x[0], x[1], x[2]
    sin_phi, cos_phi = sin(x[3]), cos(x[3])
    sin_theta, cos_theta = sin(x[4]), cos(x[4])
    p, q, r = imu[3], imu[4], imu[5]
    turn = q * sin_phi + r * cos_phi
    out[0] = r * v - q * w - gravity * sin_theta + imu[0]
    out[1] = p * w - r * u + gravity * cos_theta * sin_phi + imu[1]
    out[2] = q * u - p * v + gravity * cos_theta * cos_phi + imu[2]
    out[3] = p + turn * sin_theta / cos_theta
    out[4] = q * cos_phi - r * sin_phi
    out[5] = turn / cos_theta


@jit_arrays
def midpoints(imu: Array) -> Array:
    """IMU samples half-way between the measured ones, by the cubic through the four nearest (linear below four).

    imu: (N, 6). Returns (N - 1, 6). A straight line would lose (omega dt)^2/12 of an oscillation's integral: 0.3 % of a
    1.7 Hz pitch oscillation at 50 Hz, which looks like a scale error of the attitude.
    """
    n = imu.shape[0]
    middle = np.empty((max(n - 1, 0), 6))
    for k in range(n - 1):
        for i in range(6):
            if n < 4:
                middle[k, i] = 0.5 * (imu[k, i] + imu[k + 1, i])
            elif k == 0:
                middle[k, i] = (5.0 * imu[0, i] + 15.0 * imu[1, i] - 5.0 * imu[2, i] + imu[3, i]) / 16.0
            elif k == n - 2:
                inner = 15.0 * imu[n - 2, i] - 5.0 * imu[n - 3, i] + imu[n - 4, i]
                middle[k, i] = (5.0 * imu[n - 1, i] + inner) / 16.0
            else:
                near = imu[k, i] + imu[k + 1, i]
                middle[k, i] = (9.0 * near - imu[k - 1, i] - imu[k + 2, i]) / 16.0
    return middle


@jit
def step(
    x: Array, imu_now: Array, imu_mid: Array, imu_next: Array, bias: Array, dt: float, gravity: float, work: Array,
    out: Array,
) -> None:  # fmt: skip
    """One fourth-order Runge-Kutta step.

    x: (6,). imu_now, imu_mid, imu_next: (6,) measured at both ends and half-way. bias: (6,) taken off all. dt: s.
    gravity: m/s^2. work: (6, 6). out: (6,), written.
    """
    k1, k2, k3, k4, trial, imu = work[0], work[1], work[2], work[3], work[4], work[5]
    for i in range(6):
        imu[i] = imu_now[i] - bias[i]
    derivative(x, imu, gravity, k1)
    for i in range(6):
        imu[i] = imu_mid[i] - bias[i]
        trial[i] = x[i] + 0.5 * dt * k1[i]
    derivative(trial, imu, gravity, k2)
    for i in range(6):
        trial[i] = x[i] + 0.5 * dt * k2[i]
    derivative(trial, imu, gravity, k3)
    for i in range(6):
        imu[i] = imu_next[i] - bias[i]
        trial[i] = x[i] + dt * k3[i]
    derivative(trial, imu, gravity, k4)
    for i in range(6):
        out[i] = x[i] + dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])


@jit_arrays
def reconstruct(x0: Array, imu: Array, bias: Array, dt: float, gravity: float) -> Array:
    """Integrate the kinematic equations from a measured start.

    x0: (6,) first state. imu: (N, 6) ax ay az p q r at the centre of gravity. bias: (6,) of these. dt: s.
    gravity: m/s^2. Returns (N, 6) states.
    """
    states, work = np.empty((imu.shape[0], 6)), np.empty((6, 6))
    for i in range(6):
        states[0, i] = x0[i]
    middle = midpoints(imu)
    for k in range(imu.shape[0] - 1):
        step(states[k], imu[k], middle[k], imu[k + 1], bias, dt, gravity, work, states[k + 1])
    return states


def to_centre_of_gravity(
    specific_force: Array, rates: Array, rate_derivatives: Array, position: tuple[float, float, float]
) -> Array:
    """Move specific force from the accelerometer to the centre of gravity: a_m - w' x r - w x (w x r).

    Parameters
    ----------
    specific_force : Array, shape (N, 3)
        a_m, specific force at the accelerometer, body axes, m/s^2.
    rates : Array, shape (N, 3)
        w, body rates p q r, rad/s.
    rate_derivatives : Array, shape (N, 3)
        w', their derivatives with respect to time, rad/s^2.
    position : tuple[float, float, float]
        r, position of the accelerometer from the centre of gravity, body axes, m.

    Returns
    -------
    Array, shape (N, 3)
        Specific force at the centre of gravity, body axes, m/s^2.

    References
    ----------
    Klein & Morelli, "Aircraft System Identification", chapter 10.
    """
    lever = np.asarray(position, dtype=np.float64)
    tangential = np.cross(rate_derivatives, lever)
    centripetal = np.cross(rates, np.cross(rates, lever))
    return np.asarray(specific_force - tangential - centripetal, dtype=np.float64)


def air_data(velocity: Array) -> tuple[Array, Array, Array]:
    """(V, alpha, beta) in m/s and rad from (N, 3) air-relative body velocities: atan2(w, u), asin(v/V)."""
    speed = np.sqrt(np.sum(velocity**2, axis=1))
    safe = np.maximum(speed, 1e-9)
    return speed, np.arctan2(velocity[:, 2], velocity[:, 0]), np.arcsin(velocity[:, 1] / safe)


def body_velocity(speed: Array, alpha: Array, beta: Array) -> Array:
    """(N, 3) u v w, m/s, from true airspeed (m/s), alpha and beta (rad)."""
    return np.column_stack(
        [
            speed * np.cos(alpha) * np.cos(beta),
            speed * np.sin(beta),
            speed * np.sin(alpha) * np.cos(beta),
        ]
    )
