"""Wind and sensor errors while flying, from kinematics alone: no aerodynamics, mass or thrust.

An extended Kalman filter of the air-relative velocity u v w, driven by accelerometer and gyro under the measured
attitude (the equations of `sysid.compatibility.kinematics`), with airspeed and vanes as measurements of its sum with
the gusts, and the ground velocity of a satellite receiver as its sum with the wind. Its further states are constants or
drift slowly: accelerometer biases, wind, the airspeed's scale, and each vane's bias and scale. Gusts fade as a
first-order process does; how strong they are is estimated from the measurements (`air_data_imm`). A second filter of
attitude gives the gyros' biases. What is not identifiable keeps the standard error that it had at the start.
Source: Klein & Morelli, "Aircraft System Identification", chapter 10 (the equations and the errors' form).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Array
from sysid.live.signals.air_data_imm import ATTITUDE_NOISE, GUST, INTENSITIES, LEAST_DRIFT, ROW, SIZE, mixed, take_rows
from sysid.signals.sensor_errors import SENSOR_ERRORS

STATES = (
    *("u", "v", "w", "accel_bias_x", "accel_bias_y", "accel_bias_z", "wind_north", "wind_east", "wind_down"),
    *("airspeed_scale", "alpha_bias", "alpha_scale", "beta_bias", "beta_scale"),
)
_GYRO = ("gyro_bias_p", "gyro_bias_q", "gyro_bias_r")
# Variances of noise: before it is estimated from the samples, and the least.
_NOISE = {"airspeed": (0.0025, 0.0004), "alpha": (2.5e-5, 1e-6), "beta": (2.5e-5, 1e-6)}
_ACCELERATIONS = ("ax", "ay", "az")
_INDEX = {name: i for i, name in enumerate(STATES)}


@dataclass(frozen=True)
class AirDataError:
    """An error of a sensor, or the wind: value, standard error, that at the start, and unit."""

    value: float
    std: float
    prior: float
    unit: str

    @property
    def observed(self) -> bool:
        """Whether the flight holds information on it."""
        return self.std < 0.5 * self.prior


class AirFilter:
    """Takes rows as they come. gravity: m/s^2."""

    def __init__(self, gravity: float) -> None:
        self._gravity = gravity
        self._prior = np.array([1.0, 1.0, 1.0, *(_prior(name) for name in STATES[3:])])
        models = INTENSITIES.size
        self._x = np.zeros((models, SIZE))
        self._P = np.zeros((models, SIZE, SIZE))
        self._P[:, :GUST, :GUST] = np.diag(self._prior**2)
        self._shares = np.full(models, 1.0 / models)
        self._before = np.empty((0, len(ROW)))
        self._moved = {name: np.zeros(3) for name in ("alpha", "beta")}  # samples, their sum and that of the squares
        self._turned = np.zeros(6)  # attitude, gyro biases
        self._turned_P = np.diag([ATTITUDE_NOISE**2] * 3 + [0.02**2] * 3)
        self.rows = 0

    def take(self, rows: Array, interval_s: float, noise: Mapping[str, float]) -> None:
        """Rows (N, 15), columns of `airsteps.ROW`; beta vn ve vd are NaN where they are not known.

        noise: variances of the white noise of airspeed (m/s)^2, alpha and beta, rad^2, and ax ay az, (m/s^2)^2.
        """
        if not rows.shape[0]:
            return
        if not self._before.shape[0]:
            self._start(dict(zip(ROW, rows[0].tolist(), strict=True)))
            self._before, rows = rows[:1], rows[1:]
        joined = np.concatenate([self._before, rows])
        measured = np.array([max(noise.get(name, first), least) for name, (first, least) in _NOISE.items()])
        drift = np.array([LEAST_DRIFT**2 + noise.get(name, 0.0) * interval_s for name in _ACCELERATIONS])
        take_rows(
            joined, self._before.shape[0], interval_s, self._gravity, measured, drift,
            self._turned, self._turned_P, self._x, self._P, self._shares,
        )  # fmt: skip
        self.rows += rows.shape[0]
        self._before = joined[-2:]
        for name, moved in self._moved.items():
            values = rows[:, ROW.index(name)]
            values = values[np.isfinite(values)]
            moved += np.array([values.size, values.sum(), values @ values])

    def restart_motion(self) -> None:
        """Rows after a gap: the motion is unknown again, the errors are not."""
        self._before = np.empty((0, len(ROW)))

    def moved(self, vane: str) -> float:
        """Sum of the squares of the vane's angle about its mean, rad^2, over all rows."""
        count, total, squares = self._moved[vane]
        return float(squares - total**2 / count) if count else 0.0

    def errors(self) -> dict[str, AirDataError]:
        """Every error by name, as in results of identification."""
        x, P = np.zeros(SIZE), np.zeros((SIZE, SIZE))
        mixed(self._shares, self._x, self._P, x, P)
        std = np.sqrt(np.diag(P))
        found = {
            name: AirDataError(float(x[i]), float(std[i]), float(self._prior[i]), SENSOR_ERRORS[name][2])
            for name, i in _INDEX.items()
            if i >= 3
        }
        gyro_std = np.sqrt(np.diag(self._turned_P)[3:])
        for i, name in enumerate(_GYRO):
            found[name] = AirDataError(float(self._turned[3 + i]), float(gyro_std[i]), 0.02, "rad/s")
        return found

    def _start(self, row: Mapping[str, float]) -> None:
        beta = row["beta"] if np.isfinite(row["beta"]) else 0.0
        alpha, speed = row["alpha"], row["V"]
        self._x[:, :3] = speed * np.array([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
        self._x[:, GUST:] = 0.0
        for P, intensity in zip(self._P, INTENSITIES, strict=True):
            for motion, spread in ((slice(0, 3), 1.0), (slice(GUST, None), intensity)):
                P[motion, :] = P[:, motion] = 0.0
                P[motion, motion] = spread**2 * np.eye(3)
        self._turned[:3] = row["phi"], row["theta"], row["psi"]
        self._turned_P[:3, :] = self._turned_P[:, :3] = 0.0
        self._turned_P[:3, :3] = np.eye(3) * ATTITUDE_NOISE**2


def _prior(name: str) -> float:
    return (
        10.0
        if name in ("wind_north", "wind_east")
        else 2.0
        if name == "wind_down"
        else SENSOR_ERRORS[name][3] * (2.0 if name == "airspeed_scale" else 1.0)
    )
