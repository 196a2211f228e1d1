"""A light autopilot: holds height, speed, heading and level wings between manoeuvres, and lets go while one runs.

Successive loops with small gains (Beard & McLain, Small Unmanned Aircraft, chapter 6). Every gain is divided by the
effectiveness of its control, measured on the model in trim, so that no sign of a surface is assumed and a control
without effect stays at rest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.flight.plant import OUTPUTS, Plant, Trim
from sim_vehicle.physics.layout import P_RATE, U

Array = NDArray[np.float64]

_PROBE = 0.01  # rad, or of full throttle
_CALM = np.zeros(3)
_LARGEST_BANK, _LARGEST_CLIMB = 0.5, 0.25  # rad
_UPSET_BANK, _UPSET_PITCH = 1.0, 0.8  # rad, beyond which a free response is caught
_BLEND_S = 0.5  # s to hand over between autopilot and free response
_BANK_REST = 0.25  # share of the bank hold that stays, or a 20 s lateral manoeuvre would end in a spiral


@dataclass(frozen=True)
class Targets:
    """What is to be held: airspeed, m/s as the sensor reads it; height, m; heading, rad."""

    airspeed: float
    altitude: float
    heading: float = 0.0


def control_effectiveness(plant: Plant, trim: Trim) -> Array:
    """Acceleration per unit of each control in trim.

    Measured on the surfaces themselves: a slow actuator must not look like a weak one, or its gain would grow.

    Parameters
    ----------
    plant : Plant
        The vehicle and its model.
    trim : Trim
        The steady flight about which the controls are moved.

    Returns
    -------
    Array, shape (4,)
        Of de, da, dr: pitch, roll, yaw acceleration, rad/s^2 per rad; of the throttle: acceleration along x, m/s^2 per
        unit.
    """
    found = np.zeros(4)
    for control, place in enumerate((P_RATE + 1, P_RATE, P_RATE + 2, U)):
        rates = []
        for sign in (-1.0, 1.0):
            moved = trim.state.copy()
            moved.surfaces[control] += sign * _PROBE
            rates.append(plant.rates(moved, _CALM, _CALM)[place])
        found[control] = (rates[1] - rates[0]) / (2.0 * _PROBE)
    return found


def _per(rate: float, effectiveness: float) -> float:
    """Gain that gives `rate` of acceleration; 0 for a control without effect."""
    return rate / effectiveness if abs(effectiveness) > 1e-3 else 0.0


class Autopilot:
    """Commands of the four controls from noisy readings, once in a tick.

    reference: what the sensors read in trim (signal name -> value, SI). limits: (4, 2) smallest and largest command.
    """

    def __init__(
        self, plant: Plant, trim: Trim, reference: Mapping[str, float], limits: Array, dt: float = 0.02
    ) -> None:
        pitch, roll, yaw, thrust = control_effectiveness(plant, trim)
        self._dt = dt
        self._trim = trim.command.copy()
        self._limits = limits
        self._theta = reference["theta"]
        self._phi = reference["phi"]
        self._speed = float(plant.outputs(trim.state)[OUTPUTS.index("V")])
        self._gravity = plant.vehicle.environment.gravity
        self._pitch_angle, self._pitch_rate = _per(30.0, pitch), _per(6.0, pitch)
        self._bank_angle, self._roll_rate = _per(30.0, roll), _per(3.0, roll)
        self._yaw_rate = _per(3.0, yaw)
        self._thrust, self._thrust_sum = _per(0.6, thrust), _per(0.08, thrust)
        self._climb_thrust = _per(self._gravity, thrust)
        self._throttle_offset = 0.0
        self._pitch_offset = 0.0
        self._grip: tuple[float, ...] = (1.0, 1.0)

    def command(self, read: Mapping[str, float], targets: Targets, freed: tuple[bool, bool], added: Array) -> Array:
        """Command (4,) elevator, aileron, rudder (rad), throttle (0 to 1) for the tick that begins.

        read: readings by signal name. freed: whether (elevator and throttle, aileron and rudder) are let go.
        added: (4,) the manoeuvre's increments.
        """
        upset = abs(read["phi"]) > _UPSET_BANK or abs(read["theta"]) > _UPSET_PITCH
        if upset:
            added = np.zeros(4)
        most = self._dt / _BLEND_S
        pitch_grip, roll_grip = self._grip = tuple(
            grip + min(max((0.0 if free and not upset else 1.0) - grip, -most), most)
            for free, grip in zip(freed, self._grip, strict=True)
        )
        climb = 0.5 * (targets.altitude - read["altitude"]) / self._speed
        climb = min(max(climb, -_LARGEST_CLIMB), _LARGEST_CLIMB)
        lag = targets.airspeed - read["airspeed"]
        out = self._trim + added
        out[0] += pitch_grip * self._pitch(read, climb) + self._pitch_offset
        out[3] += pitch_grip * (self._thrust * lag + self._climb_thrust * climb) + self._throttle_offset
        self._integrate(read, climb, lag, out[3], pitch_grip)
        bank, yaw = self._lateral(read, targets, roll_grip)
        out[1] += bank
        out[2] += yaw
        return np.asarray(np.minimum(np.maximum(out, self._limits[:, 0]), self._limits[:, 1]))

    def _pitch(self, read: Mapping[str, float], climb: float) -> float:
        return self._pitch_angle * (self._theta + climb - read["theta"]) - self._pitch_rate * read["q"]

    def _integrate(self, read: Mapping[str, float], climb: float, lag: float, throttle: float, grip: float) -> None:
        """Slow trims, which stay while the loops let go; none where the throttle is at its stop."""
        if grip < 1.0:
            return
        low, high = self._limits[3]
        if not ((throttle >= high and lag > 0.0) or (throttle <= low and lag < 0.0)):
            self._throttle_offset += self._thrust_sum * lag * self._dt
        error = self._theta + climb - read["theta"]
        self._pitch_offset += 0.5 * self._pitch_angle * error * self._dt

    def _lateral(self, read: Mapping[str, float], targets: Targets, grip: float) -> tuple[float, float]:
        turn = math.atan2(math.sin(targets.heading - read["psi"]), math.cos(targets.heading - read["psi"]))
        bank = min(max(0.25 * self._speed / self._gravity * turn, -_LARGEST_BANK), _LARGEST_BANK)
        share = _BANK_REST + (1.0 - _BANK_REST) * grip
        hold = self._bank_angle * (self._phi + grip * bank - read["phi"]) - grip * self._roll_rate * read["p"]
        coordinated = self._gravity / self._speed * math.sin(read["phi"]) * math.cos(read["theta"])
        return share * hold, -grip * self._yaw_rate * (read["r"] - coordinated)
