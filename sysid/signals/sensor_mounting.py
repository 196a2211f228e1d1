"""Where the sensors of a vehicle sit and what they read."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array


@dataclass(frozen=True)
class SensorMounting:
    """Where the sensors sit and what they read.

    accelerometer, alpha_vane, beta_vane: (x, y, z) from the centre of gravity, body axes, m.
    beta_kind: "sideslip" (asin(v/V)) or "flank" (atan2(v, u)).
    airspeed_factor: true airspeed over what `airspeed` reads: sqrt(1.225/rho) for calibrated airspeed, 1 for true.
    airspeed_is_true: whether the sensor reads true airspeed at any density.
    gravity: m/s^2.
    """

    accelerometer: tuple[float, float, float] = (0.0, 0.0, 0.0)
    alpha_vane: tuple[float, float, float] = (0.0, 0.0, 0.0)
    beta_vane: tuple[float, float, float] = (0.0, 0.0, 0.0)
    beta_kind: str = "sideslip"
    airspeed_factor: float = 1.0
    airspeed_is_true: bool = False
    gravity: float = STANDARD_GRAVITY

    def packed(self) -> Array:
        """The (7,) array the compiled functions take."""
        flank = 1.0 if self.beta_kind == "flank" else 0.0
        a, b = self.alpha_vane, self.beta_vane
        return np.array([self.airspeed_factor, a[0], a[1], b[0], b[2], flank, self.gravity])


def sensor_mounting(vehicle: Vehicle, density: float) -> SensorMounting:
    """Where the sensors sit, and what the airspeed indicator calls airspeed at `density` [kg/m3]."""
    sensors = vehicle.sensors
    factor = 1.0 if sensors.airspeed.kind == "true" else math.sqrt(SEA_LEVEL_DENSITY / density)
    return SensorMounting(
        accelerometer=sensors.accelerometer.position,
        alpha_vane=sensors.alpha_vane.position,
        beta_vane=sensors.beta_vane.position,
        beta_kind=sensors.beta_vane.kind or "sideslip",
        airspeed_factor=factor,
        airspeed_is_true=sensors.airspeed.kind == "true",
        gravity=vehicle.environment.gravity,
    )
