"""The equations of motion as a user of scipy or AeroID would write them for numba, and a flight told in their terms.

Flat earth, body axes, linear aerodynamics, Euler angles without heading; nothing of this project's simulator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from sim_vehicle.constants import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.vehicle.vehicle_file import Vehicle

Array = NDArray[np.float64]

COEFFICIENTS = (
    *("CL_0", "CL_alpha", "CL_q", "CL_de", "CD_0", "CD_k", "Cm_0", "Cm_alpha", "Cm_q", "Cm_de"),
    *("CY_0", "CY_beta", "CY_p", "CY_r", "CY_da", "CY_dr", "Cl_0", "Cl_beta", "Cl_p", "Cl_r", "Cl_da", "Cl_dr"),
    *("Cn_0", "Cn_beta", "Cn_p", "Cn_r", "Cn_da", "Cn_dr"),
)
SENSORS = (
    *("accel_bias_x", "accel_bias_y", "accel_bias_z", "gyro_bias_p", "gyro_bias_q", "gyro_bias_r"),
    *("alpha_scale", "beta_scale"),
)
STATES = ("u", "v", "w", "p", "q", "r", "phi", "theta")
STARTS = tuple(f"start_{name}" for name in STATES)
# What the peers fit, and the noise of one sample, which they are told.
OUTPUTS = {
    "airspeed": 0.02, "alpha": np.radians(0.3), "beta": np.radians(0.3), "p": np.radians(0.03), "q": np.radians(0.03),
    "r": np.radians(0.03), "phi": np.radians(0.05), "theta": np.radians(0.05), "ax": 0.0785, "ay": 0.0785, "az": 0.0785,
}  # fmt: skip
_C, _S = len(COEFFICIENTS), len(SENSORS)


@numba.njit(cache=True)
def forces(x: Array, surfaces: Array, air: Array, k: Array, body: Array) -> Array:
    """ax, ay, az, moments l, m, n, then V, alpha, beta. air: thrust, density. body: m Ixx Iyy Izz Ixz S b c."""
    u, v, w, p, q, r = x[0], x[1], x[2], x[3], x[4], x[5]
    V = max(np.sqrt(u * u + v * v + w * w), 1.0)
    alpha, beta = np.arctan2(w, u), np.arcsin(v / V)
    span, chord = body[6] / (2.0 * V), body[7] / (2.0 * V)
    de, da, dr = surfaces[0], surfaces[1], surfaces[2]
    CL = k[0] + k[1] * alpha + k[2] * q * chord + k[3] * de
    CD = k[4] + k[5] * CL * CL
    Cm = k[6] + k[7] * alpha + k[8] * q * chord + k[9] * de
    CY = k[10] + k[11] * beta + span * (k[12] * p + k[13] * r) + k[14] * da + k[15] * dr
    Cl = k[16] + k[17] * beta + span * (k[18] * p + k[19] * r) + k[20] * da + k[21] * dr
    Cn = k[22] + k[23] * beta + span * (k[24] * p + k[25] * r) + k[26] * da + k[27] * dr
    qS = 0.5 * air[1] * V * V * body[5]
    ca, sa = np.cos(alpha), np.sin(alpha)
    out = np.empty(9)
    out[0] = (air[0] + qS * (CL * sa - CD * ca)) / body[0]
    out[1] = qS * CY / body[0]
    out[2] = -qS * (CL * ca + CD * sa) / body[0]
    out[3], out[4], out[5] = qS * body[6] * Cl, qS * body[7] * Cm, qS * body[6] * Cn
    out[6], out[7], out[8] = V, alpha, beta
    return out


@numba.njit(cache=True)
def rates(x: Array, surfaces: Array, air: Array, k: Array, body: Array) -> Array:
    """(8,) derivatives of STATES."""
    f = forces(x, surfaces, air, k, body)
    u, v, w, p, q, r, phi, theta = x
    Ixx, Iyy, Izz, Ixz = body[1], body[2], body[3], body[4]
    left = f[3] + Ixz * p * q - (Izz - Iyy) * q * r
    right = f[5] - Ixz * q * r - (Iyy - Ixx) * p * q
    determinant = Ixx * Izz - Ixz * Ixz
    sp, cp, st, ct = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta)
    out = np.empty(8)
    out[0] = f[0] - STANDARD_GRAVITY * st + r * v - q * w
    out[1] = f[1] + STANDARD_GRAVITY * ct * sp + p * w - r * u
    out[2] = f[2] + STANDARD_GRAVITY * ct * cp + q * u - p * v
    out[3] = (Izz * left + Ixz * right) / determinant
    out[4] = (f[4] - (Ixx - Izz) * p * r - Ixz * (p * p - r * r)) / Iyy
    out[5] = (Ixz * left + Ixx * right) / determinant
    out[6] = p + (q * sp + r * cp) * st / ct
    out[7] = q * cp - r * sp
    return out


@numba.njit(cache=True)
def readings(x: Array, surfaces: Array, air: Array, k: Array, sensors: Array, body: Array) -> Array:
    """(11,) what the sensors of OUTPUTS read. sensors: values of SENSORS."""
    f = forces(x, surfaces, air, k, body)
    out = np.empty(11)
    out[0], out[1], out[2] = f[6], (1.0 + sensors[6]) * f[7], (1.0 + sensors[7]) * f[8]
    out[3], out[4], out[5] = x[3] + sensors[3], x[4] + sensors[4], x[5] + sensors[5]
    out[6], out[7] = x[6], x[7]
    out[8], out[9], out[10] = f[0] + sensors[0], f[1] + sensors[1], f[2] + sensors[2]
    return out


@numba.njit(cache=True)
def simulated(theta: Array, commands: Array, air: Array, dt: float, body: Array) -> Array:
    """(N, 11) readings for all unknowns: commands (N, 3) held from each sample to the next, two Runge-Kutta steps."""
    k, sensors, x = theta[:_C], theta[_C : _C + _S], theta[_C + _S :].copy()
    out = np.empty((commands.shape[0], 11))
    h = 0.5 * dt
    for i in range(commands.shape[0]):
        out[i] = readings(x, commands[max(i - 1, 0)], air[i], k, sensors, body)
        for _ in range(2):
            k1 = rates(x, commands[i], air[i], k, body)
            k2 = rates(x + 0.5 * h * k1, commands[i], air[i], k, body)
            k3 = rates(x + 0.5 * h * k2, commands[i], air[i], k, body)
            k4 = rates(x + h * k3, commands[i], air[i], k, body)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return out


@dataclass(frozen=True)
class PeerFlight:
    """One flight as the peers get it.

    time_s: (N,). measured: (N, 11) OUTPUTS at the centre of gravity. commands: (N, 3) rad. air: (N, 2) true thrust
    and density. body: (8,) m Ixx Iyy Izz Ixz S b c. start: first guess of COEFFICIENTS, SENSORS, STARTS.
    """

    time_s: Array
    measured: Array
    commands: Array
    air: Array
    body: Array
    start: Array

    @property
    def interval_s(self) -> float:
        """Sample interval."""
        return float(self.time_s[1] - self.time_s[0])


def peer_flight(flown: FlownFlight, vehicle: Vehicle, guess: Sequence[float]) -> PeerFlight:
    """Sensors moved to the centre of gravity, calibrated airspeed made true; guess: of COEFFICIENTS."""
    z = {name: flown.measured[name][1] for name in OUTPUTS}
    density = flown.truth["rho"]
    speed = z["airspeed"] * np.sqrt(SEA_LEVEL_DENSITY / density)
    vane, flag = vehicle.sensors.alpha_vane.position, vehicle.sensors.beta_vane.position
    z["alpha"] = z["alpha"] + (vane[0] * z["q"] - vane[1] * z["p"]) / speed
    z["beta"] = z["beta"] - (flag[0] * z["r"] - flag[2] * z["p"]) / speed
    z["airspeed"] = speed
    measured = np.column_stack([z[name] for name in OUTPUTS])
    mass, size = vehicle.mass, vehicle.geometry
    body = np.array([mass.mass, mass.Ixx, mass.Iyy, mass.Izz, mass.Ixz, size.S, size.b, size.c])
    air = np.column_stack([flown.truth["thrust"], density])
    V, alpha, beta = measured[0, :3]
    first = [V * np.cos(beta) * np.cos(alpha), V * np.sin(beta), V * np.cos(beta) * np.sin(alpha), *measured[0, 3:8]]
    start = np.concatenate([guess, np.zeros(_S), first])
    return PeerFlight(flown.time_s - flown.time_s[0], measured, flown.command[:, :3].copy(), air, body, start)
