"""Standing and rolling on the runway: straight, by kinematics alone, so that a recording holds a whole flight.

The aircraft stands at the pitch angle of its trimmed flight; so lift-off at the trim speed is continuous.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.flight.plant import OUTPUTS, Plant
from sim_vehicle.physics.propeller import rotor_speed, throttle_thrust

Array = NDArray[np.float64]

ROLL_ACCELERATION = 3.0  # m/s^2, take-off and braking
_SETTLE_S = 0.5  # s in which wheels take bank, pitch and sink out of a touch-down
_AIRFLOW = 4.0  # m/s below which friction holds a vane where it hangs


@dataclass
class Roll:
    """A straight roll. Position m, speed m/s over ground along `psi`, acceleration m/s^2; angles rad, sink m/s."""

    north: float
    east: float
    psi: float
    speed: float
    acceleration: float
    rest_theta: float
    start_phi: float = 0.0
    start_theta: float = 0.0
    sink: float = 0.0
    elapsed: float = 0.0

    def advance(self, dt: float) -> None:
        """Move on by `dt`, s; a braking roll stops at rest."""
        mean = max(self.speed + 0.5 * self.acceleration * dt, 0.0)
        self.speed = max(self.speed + self.acceleration * dt, 0.0)
        self.north += mean * math.cos(self.psi) * dt
        self.east += mean * math.sin(self.psi) * dt
        self.elapsed += dt

    def truth(self, plant: Plant, throttle: float, surfaces: Array, wind_ned: Array) -> dict[str, float]:
        """Every OUTPUT of the plant as on the ground; forces of the air are not reported there (0)."""
        left = max(1.0 - self.elapsed / _SETTLE_S, 0.0)
        settling = 1.0 if 0.0 < left < 1.0 else 0.0
        phi = self.start_phi * left
        theta = self.rest_theta + (self.start_theta - self.rest_theta) * left
        p = -self.start_phi / _SETTLE_S * settling
        q = -(self.start_theta - self.rest_theta) / _SETTLE_S * settling
        vn, ve, vd = self.speed * math.cos(self.psi), self.speed * math.sin(self.psi), self.sink * left
        along = (vn - wind_ned[0]) * math.cos(self.psi) + (ve - wind_ned[1]) * math.sin(self.psi)
        across = -(vn - wind_ned[0]) * math.sin(self.psi) + (ve - wind_ned[1]) * math.cos(self.psi)
        airspeed = math.hypot(along, across)
        blown = airspeed > _AIRFLOW
        gravity = plant.vehicle.environment.gravity
        a = self.acceleration if self.speed > 0.0 else 0.0
        down = -gravity - self.sink / _SETTLE_S * settling  # specific force along earth's vertical
        rho, P = plant.density(0.0), plant.flat.P
        thrust = throttle_thrust(throttle, airspeed, rho, P)
        rpm = rotor_speed(throttle, thrust, P) * 30.0 / math.pi
        known = {
            "V": airspeed, "alpha": theta if blown else 0.0, "beta": math.asin(across / airspeed) if blown else 0.0,
            "p": p, "q": q, "phi": phi, "theta": theta, "psi": self.psi, "rho": rho,
            "ax": a * math.cos(theta) - down * math.sin(theta), "az": a * math.sin(theta) + down * math.cos(theta),
            "north": self.north, "east": self.east, "vn": vn, "ve": ve, "vd": vd,
            "de": float(surfaces[0]), "da": float(surfaces[1]), "dr": float(surfaces[2]), "throttle": throttle,
            "thrust": thrust, "rpm": rpm,
        }  # fmt: skip
        return {name: known.get(name, 0.0) for name in OUTPUTS}


def ideal_readings(truth: dict[str, float], calibrated: bool) -> dict[str, float]:
    """What perfect sensors read on the ground: lever arms and lags do not matter at these rates."""
    ratio = math.sqrt(truth["rho"] / SEA_LEVEL_DENSITY) if calibrated else 1.0
    return {**truth, "airspeed": truth["V"] * ratio, "altitude": -truth["down"]}
