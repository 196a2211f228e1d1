"""Steady straight flight: the angles, surfaces and throttle at which nothing accelerates."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.effects import slot
from sim_vehicle.effects.linkage import cubic_linkage
from sim_vehicle.errors import TrimError
from sim_vehicle.flight.state import PlantState, Trim
from sim_vehicle.model.model_file import Model
from sim_vehicle.physics.actuation import count_named
from sim_vehicle.physics.layout import ACTUATOR_SIZE, CHANNELS, HISTORY, SENSOR_SIZE, STATE_SIZE, WORK_SIZE
from sim_vehicle.physics.rotation import euler_angles, quaternion
from sim_vehicle.vehicle.packed_model import PackedModel
from sim_vehicle.vehicle.vehicle_file import Vehicle

Array = NDArray[np.float64]


class Plant(Protocol):
    """What a trim needs of a plant."""

    vehicle: Vehicle
    model: Model
    flat: PackedModel

    def rates(self, state: PlantState, wind_ned: Array, gust_body: Array) -> Array:
        """Rate of the state vector (14,)."""

    def state_at(self, x: Array, command: Array, surfaces: Array) -> PlantState:
        """State with actuators at rest."""


TOLERANCE = 1e-9
_NEWTON_STEPS = 20
_STILL = np.zeros(3)
# Unknowns: alpha, theta, phi, de, da, dr, throttle. Sideslip is zero; what is left over is found as the least change.
_SCALE = np.array([0.05, 0.05, 0.05, 0.05, 0.05, 0.05, 0.2])


def _state(plant: Plant, unknowns: Array, airspeed: float, altitude: float) -> PlantState:
    alpha, theta, phi = unknowns[:3]
    x = np.zeros(STATE_SIZE)
    x[2] = -altitude
    x[3], x[5] = airspeed * math.cos(alpha), airspeed * math.sin(alpha)
    x[6:10] = quaternion(phi, theta, 0.0)
    x[13] = alpha
    named = count_named(plant.flat.F)
    # Controls of other names stand at 0, and each motor at the throttle.
    own = [unknowns[6] if name in plant.vehicle.motors else 0.0 for name in plant.vehicle.named_inputs[:named]]
    return PlantState(
        x, np.zeros(ACTUATOR_SIZE), np.zeros(SENSOR_SIZE), np.zeros((HISTORY, 4)),
        np.append(unknowns[3:], own), np.zeros(WORK_SIZE + named), np.zeros(len(CHANNELS)),
    )  # fmt: skip


def _unknowns(state: PlantState) -> Array:
    """What `_state` takes, from a state of the heading north."""
    phi, theta, _ = euler_angles(*state.x[6:10])
    return np.array([math.atan2(state.x[5], state.x[3]), theta, phi, *state.surfaces[:4]])


def _residual(plant: Plant, unknowns: Array, airspeed: float, altitude: float, climb_angle: float) -> Array:
    """Accelerations (6,) and the miss in climb rate over 1 s, (7,)."""
    state = _state(plant, unknowns, airspeed, altitude)
    rate = plant.rates(state, _STILL, _STILL)
    return np.concatenate((rate[3:6], rate[10:13], [rate[2] + airspeed * math.sin(climb_angle)]))


def _straighten(command: Array, E: Array) -> None:
    """Turn surfaces into the commands (4,) that hold them through the linkage, in place."""
    if E[slot("elevator_gain")] != 0.0:
        command[0] /= 1.0 + E[slot("elevator_gain", "scale")]
    if E[slot("linkage_nonlinearity")] != 0.0:
        cubic = E[slot("linkage_nonlinearity", "cubic")]
        for channel in range(3):
            deflection = command[channel]
            for _ in range(_NEWTON_STEPS):
                slope = 1.0 + 3.0 * cubic * command[channel] ** 2
                command[channel] -= (cubic_linkage(command[channel], cubic) - deflection) / slope


def solve_trim(
    plant: Plant, airspeed: float, altitude: float, climb_angle: float = 0.0, near: Trim | None = None
) -> Trim:
    """Newton's method with the least-norm step. Raises TrimError in one line where it fails.

    near: a trim of nearly the same plant to start from; None starts from level flight.
    """
    unknowns = np.array([0.05, 0.05 + climb_angle, 0.0, 0.0, 0.0, 0.0, 0.4])
    if near is not None:
        unknowns = _unknowns(near.state)
    residual = _residual(plant, unknowns, airspeed, altitude, climb_angle)
    for _ in range(60):
        jacobian = np.empty((7, 7))
        for j in range(7):
            step = 1e-6
            shifted = unknowns.copy()
            shifted[j] += step
            jacobian[:, j] = (_residual(plant, shifted, airspeed, altitude, climb_angle) - residual) / step * _SCALE[j]
        if not (np.isfinite(jacobian).all() and np.isfinite(residual).all()):
            break
        move = -np.linalg.lstsq(jacobian, residual, rcond=1e-9)[0] * _SCALE
        size = 1.0
        for _ in range(12):
            trial = unknowns + size * move
            after = _residual(plant, trial, airspeed, altitude, climb_angle)
            if np.linalg.norm(after) < np.linalg.norm(residual) or size < 1e-3:
                break
            size *= 0.5
        unknowns, residual = trial, after
        if np.max(np.abs(residual)) < 1e-12:
            break
    worst = float(np.max(np.abs(residual)))
    throttle = float(unknowns[6])
    if not worst < TOLERANCE:
        raise TrimError(f"{plant.model.name}: no steady flight at {airspeed:g} m/s; the residual stays at {worst:.2g}")
    if not 0.0 <= throttle <= 1.0:
        raise TrimError(
            f"{plant.model.name}: steady flight at {airspeed:g} m/s would need {throttle:.2f} of full throttle"
        )
    for name, deflection in zip(("elevator", "aileron", "rudder"), unknowns[3:6], strict=True):
        low, high = plant.vehicle.controls[name].limits if name in plant.vehicle.controls else (-np.inf, np.inf)
        if not low <= deflection <= high:
            raise TrimError(
                f"{plant.model.name}: steady flight at {airspeed:g} m/s would need {deflection:.3g} rad of {name}; its "
                f"linkage gives {low:g} to {high:g} rad"
            )
    surfaces = unknowns[3:].copy()
    command = surfaces.copy()
    _straighten(command, plant.flat.E)
    x = _state(plant, unknowns, airspeed, altitude).x
    state = plant.state_at(x, command, surfaces)
    rate = plant.rates(state, _STILL, _STILL)
    return Trim(state, command, float(np.max(np.abs(np.concatenate((rate[3:6], rate[10:13]))))))
