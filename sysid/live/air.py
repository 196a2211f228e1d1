"""Wind and sensor errors while flying, from kinematics alone: no aerodynamics, mass or thrust.

An extended Kalman filter of the air-relative velocity u v w, driven by accelerometer and gyro under the measured
attitude (the equations of `sysid.kinematics`), with airspeed and vanes as measurements of it, and the ground velocity
of a satellite receiver as its sum with the wind. Its further states are constants or drift slowly: accelerometer
biases, wind, the airspeed's scale, and each vane's bias and scale. A second one of attitude gives the gyros' biases.
What the flight cannot tell keeps the standard error that it had at the start.
Source: Klein & Morelli, "Aircraft System Identification", chapter 10 (the equations and the errors' form).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sysid.flight import Array
from sysid.parameterisation import SENSOR_ERRORS

STATES = (
    *("u", "v", "w", "accel_bias_x", "accel_bias_y", "accel_bias_z", "wind_north", "wind_east", "wind_down"),
    *("airspeed_scale", "alpha_bias", "alpha_scale", "beta_bias", "beta_scale"),
)
_DRIVING = ("ax", "ay", "az", "p", "q", "r", "phi", "theta")
_GYRO = ("gyro_bias_p", "gyro_bias_q", "gyro_bias_r")
_WIND_DRIFT = 0.05  # m/s in a second
_AIR_DRIFT = 0.02  # m/s in a second, of the air that the aircraft flies through, and the accelerometer's noise
_ATTITUDE_NOISE = 0.001
_GPS_NOISE = 0.15
_SPEED_NOISE = 0.05
_NIS_MEMORY = 250.0  # rows
_INDEX = {name: i for i, name in enumerate(STATES)}


@dataclass(frozen=True)
class SensorError:
    """An error of a sensor, or the wind: value, standard error, that at the start, and unit."""

    value: float
    std: float
    prior: float
    unit: str

    @property
    def told(self) -> bool:
        """Whether the flight has said something of it."""
        return self.std < 0.5 * self.prior


class AirFilter:
    """Takes rows one by one. gravity: m/s^2."""

    def __init__(self, gravity: float) -> None:
        self._gravity = gravity
        priors = [1.0, 1.0, 1.0, *(_prior(name) for name in STATES[3:])]
        self._prior = np.array(priors)
        self._x = np.zeros(len(STATES))
        self._P = np.diag(self._prior**2)
        self._before: dict[str, float] | None = None
        self._earlier: dict[str, float] | None = None
        self._attitude = np.zeros(3)
        self._gyro = np.zeros(3)
        self._gyro_P = np.diag([_ATTITUDE_NOISE**2] * 3 + [0.02**2] * 3)
        self._nis = 3.0
        self.rows = 0

    def take(self, row: Mapping[str, float], interval_s: float, vane_noise: Mapping[str, float]) -> None:
        """One row: ax ay az p q r phi theta psi V alpha, and beta vn ve vd where they are known (else NaN).

        vane_noise: variance of alpha and beta, rad^2.
        """
        before = self._before
        self._before = dict(row)
        if before is None:
            self._start(row)
            return
        self.rows += 1
        # The mean over the interval by the parabola through three samples: a straight line loses (w T)^2 / 12 of an
        # oscillation, 0.4 % of a short period of 1.7 Hz, which looks like a scale of the vane.
        earlier, self._earlier = self._earlier or before, before
        weights = (5.0, 8.0, -1.0) if earlier is not before else (6.0, 6.0, 0.0)
        middle = {
            name: (weights[0] * row[name] + weights[1] * before[name] + weights[2] * earlier[name]) / 12.0
            for name in _DRIVING
        }
        self._turn(middle, row, interval_s)
        self._advance(middle, interval_s)
        self._take_air(row, vane_noise)
        self._take_ground(row)

    def restart_motion(self) -> None:
        """Rows after a gap: the motion is unknown again, the errors are not."""
        self._before = self._earlier = None

    def errors(self) -> dict[str, SensorError]:
        """Every error by name, as in results of identification."""
        std = np.sqrt(np.diag(self._P))
        found = {
            name: SensorError(float(self._x[i]), float(std[i]), float(self._prior[i]), SENSOR_ERRORS[name][2])
            for name, i in _INDEX.items()
            if i >= 3
        }
        gyro_std = np.sqrt(np.diag(self._gyro_P)[3:])
        for i, name in enumerate(_GYRO):
            found[name] = SensorError(float(self._gyro[i]), float(gyro_std[i]), 0.02, "rad/s")
        return found

    def _start(self, row: Mapping[str, float]) -> None:
        beta = row["beta"] if np.isfinite(row["beta"]) else 0.0
        alpha, speed = row["alpha"], row["V"]
        self._x[:3] = speed * np.array([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
        self._P[:3, :] = self._P[:, :3] = 0.0
        self._P[:3, :3] = np.eye(3)
        self._attitude = np.array([row["phi"], row["theta"], row["psi"]])
        self._gyro_P[:3, :] = self._gyro_P[:, :3] = 0.0
        self._gyro_P[:3, :3] = np.eye(3) * _ATTITUDE_NOISE**2

    def _turn(self, middle: Mapping[str, float], row: Mapping[str, float], dt: float) -> None:
        """Attitude by the gyros, then corrected by the measured one."""
        phi, theta = middle["phi"], middle["theta"]
        sin, cos, tan, sec = np.sin(phi), np.cos(phi), np.tan(theta), 1.0 / max(np.cos(theta), 0.1)
        turning = np.array([[1.0, sin * tan, cos * tan], [0.0, cos, -sin], [0.0, sin * sec, cos * sec]])
        rates = np.array([middle["p"], middle["q"], middle["r"]]) - self._gyro
        F = np.eye(6)
        F[:3, 3:] = -dt * turning
        P = F @ self._gyro_P @ F.T
        P[:3, :3] += np.eye(3) * (0.001 * dt) ** 2
        predicted = self._attitude + dt * turning @ rates
        K = P[:, :3] @ np.linalg.inv(P[:3, :3] + np.eye(3) * _ATTITUDE_NOISE**2)
        error = np.array([row["phi"], row["theta"], row["psi"]]) - predicted
        error = (error + np.pi) % (2.0 * np.pi) - np.pi
        change = K @ error
        self._attitude = predicted + change[:3]
        self._gyro = self._gyro + change[3:]
        self._gyro_P = P - K @ P[:3, :]

    def _advance(self, middle: Mapping[str, float], dt: float) -> None:
        p, q, r = np.array([middle["p"], middle["q"], middle["r"]]) - self._gyro
        phi, theta, g = middle["phi"], middle["theta"], self._gravity
        pull = g * np.array([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
        force = np.array([middle["ax"], middle["ay"], middle["az"]]) - self._x[3:6] + pull
        spin = np.array([[0.0, r, -q], [-r, 0.0, p], [q, -p, 0.0]])
        velocity = self._x[:3]
        half = velocity + 0.5 * dt * (spin @ velocity + force)
        self._x[:3] = velocity + dt * (spin @ half + force)
        F = np.eye(len(STATES))
        F[:3, :3] += dt * spin
        F[:3, 3:6] = -dt * np.eye(3)
        self._P = F @ self._P @ F.T
        # Gusts move the air itself: the innovations tell how much more than a calm day.
        drift = _AIR_DRIFT**2 * dt * max(self._nis / 3.0, 1.0)
        self._P[[0, 1, 2], [0, 1, 2]] += drift
        self._P[[6, 7, 8], [6, 7, 8]] += _WIND_DRIFT**2 * dt

    def _take_air(self, row: Mapping[str, float], vane_noise: Mapping[str, float]) -> None:
        u, v, w = self._x[:3]
        flat, speed = max(u * u + w * w, 1e-6), max(float(np.sqrt(u * u + v * v + w * w)), 1e-3)
        alpha, beta = np.arctan2(w, u), np.arcsin(np.clip(v / speed, -1.0, 1.0))
        names = ["V", "alpha"] + (["beta"] if np.isfinite(row["beta"]) else [])
        H = np.zeros((3, len(STATES)))
        scale, alpha_scale, beta_scale = (self._x[_INDEX[f"{name}_scale"]] for name in ("airspeed", "alpha", "beta"))
        H[0, :3] = (1.0 + scale) * np.array([u, v, w]) / speed
        H[0, _INDEX["airspeed_scale"]] = speed
        H[1, :3] = (1.0 + alpha_scale) * np.array([-w, 0.0, u]) / flat
        H[1, _INDEX["alpha_bias"]], H[1, _INDEX["alpha_scale"]] = 1.0, alpha
        slope = np.sqrt(flat) / speed**2
        H[2, :3] = (1.0 + beta_scale) * np.array([-u * v / flat, 1.0, -w * v / flat]) * slope
        H[2, _INDEX["beta_bias"]], H[2, _INDEX["beta_scale"]] = 1.0, beta
        expected = {
            "V": (1.0 + scale) * speed,
            "alpha": (1.0 + alpha_scale) * alpha + self._x[_INDEX["alpha_bias"]],
            "beta": (1.0 + beta_scale) * beta + self._x[_INDEX["beta_bias"]],
        }
        noise = {"V": _SPEED_NOISE**2, **{name: max(value, 1e-6) for name, value in vane_noise.items()}}
        innovation = np.array([row[name] - expected[name] for name in names])
        size = len(names)
        nis = self._correct(H[:size], innovation, np.array([noise.get(name, 2.5e-5) for name in names]))
        self._nis += (min(nis, 100.0) * 3.0 / size - self._nis) / _NIS_MEMORY

    def _take_ground(self, row: Mapping[str, float]) -> None:
        names = [name for name in ("vn", "ve", "vd") if np.isfinite(row[name])]
        if not names:
            return
        C = _body_to_earth(row["phi"], row["theta"], row["psi"])
        expected = C @ self._x[:3] + self._x[6:9]
        rows = [("vn", "ve", "vd").index(name) for name in names]
        H = np.zeros((len(rows), len(STATES)))
        H[:, :3] = C[rows]
        H[range(len(rows)), [6 + i for i in rows]] = 1.0
        innovation = np.array([row[name] for name in names]) - expected[rows]
        self._correct(H, innovation, np.full(len(rows), _GPS_NOISE**2))

    def _correct(self, H: Array, innovation: Array, noise: Array) -> float:
        S = H @ self._P @ H.T + np.diag(noise)
        PH = self._P @ H.T
        solved = np.linalg.solve(S, np.column_stack([innovation, PH.T]))
        self._x = self._x + PH @ solved[:, 0]
        P = self._P - PH @ solved[:, 1:]
        self._P = 0.5 * (P + P.T)
        return float(innovation @ solved[:, 0])


def _prior(name: str) -> float:
    return (
        10.0
        if name in ("wind_north", "wind_east")
        else 2.0
        if name == "wind_down"
        else SENSOR_ERRORS[name][3] * (2.0 if name == "airspeed_scale" else 1.0)
    )


def _body_to_earth(phi: float, theta: float, psi: float) -> Array:
    sp, cp, st, ct, ss, cs = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta), np.sin(psi), np.cos(psi)
    return np.array(
        [
            [ct * cs, sp * st * cs - cp * ss, cp * st * cs + sp * ss],
            [ct * ss, sp * st * ss + cp * cs, cp * st * ss - sp * cs],
            [-st, sp * ct, cp * ct],
        ]
    )
