"""The aircraft that an autopilot flies: in the air the simulator's own motion, on the ground wheels.

On wheels the aircraft moves along its heading alone, level across, pitched up as far as the elevator lifts the nose,
and turns as the rudder steers; it leaves the ground when the forces of its model carry it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.errors import SimVehicleError
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.state import PlantState
from sim_vehicle.flight.wind import WindField
from sim_vehicle.physics.layout import STATE_SIZE, Aux
from sim_vehicle.physics.rotation import euler_angles, quaternion, rotation_matrix
from sim_vehicle.vehicle.vehicle_file import Vehicle

Array = NDArray[np.float64]

_CONTROLS = ("elevator", "aileron", "rudder", "throttle")
# Rolling friction of small wheels on grass, as a share of what the ground carries.
_ROLLING = 0.05
# How far the nose may be raised above its angle at rest, rad, before the tail strikes.
_MOST_NOSE_UP = 0.25
# Turning on wheels: rad/s for each m/s and rad of the rudder, at most this many rad/s.
_STEERING, _FASTEST_TURN = 0.5, 1.0
# Gusts are made for so many seconds at once, and begin anew then.
_GUSTS_S = 600.0
# The longest step, s, that is taken for one: SITL asks for 50 to 1200 a second.
_LONGEST_STEP_S = 0.05


@dataclass(frozen=True)
class Motion:
    """What SITL asks for, SI and rad. position, velocity: north east down of where it stood. attitude: quaternion from
    earth to body. specific_force, rates: body axes, at the centre of gravity.
    """

    time_s: float
    position: Array
    velocity: Array
    attitude: Array
    specific_force: Array
    rates: Array
    on_ground: bool


class AutopilotFlight:
    """One flight under an autopilot's pulse widths, from standing on the ground at height 0."""

    def __init__(self, plant: Plant, wind: WindField, heading: float, generator: np.random.Generator) -> None:
        """heading: rad. Raises SimVehicleError for a vehicle without servos, or one that cannot fly at all."""
        self.plant, self.wind, self._heading, self._generator = plant, wind, heading, generator
        _require_servos(plant.vehicle)
        trim = plant.trim()
        self._speed = float(trim.state.work[Aux.V])
        _, self._rest, _ = euler_angles(*trim.state.x[6:10])
        self._rest = max(float(self._rest), 0.0)
        rudder = plant.model.flown().get("Cn_dr", 0.0)
        self._steering = math.copysign(_STEERING, rudder) if rudder else 0.0
        self.restart()

    def restart(self) -> None:
        """Stand again where the flight began, at time 0."""
        x = np.zeros(STATE_SIZE)
        x[6:10] = quaternion(0.0, self._rest, self._heading)
        command = np.zeros(4)
        self._state: PlantState = self.plant.state_at(x, command, command)
        self._state.time_s = 0.0
        self._step, self._gusts = 0.0, np.zeros((0, 3))
        self._count = 0
        self.motion = self._on_wheels(self._state.x.copy(), 0.0, 0.0)

    def step(self, pwm: tuple[int, ...], dt: float) -> Motion:
        """Fly `dt` seconds, at most 0.05, under these pulse widths, us."""
        dt = min(dt, _LONGEST_STEP_S)
        command = self.command(pwm)
        before, ground = self._state.x.copy(), self.motion.on_ground
        time_s = self._state.time_s
        gust = self._gust(dt)
        self.plant.step(self._state, command, dt, self.wind.at(float(-before[2])), np.zeros(3) if ground else gust)
        self._state.time_s = time_s + dt
        x = self._state.x
        if not np.isfinite(x).all():
            raise SimVehicleError("the flight has diverged: the model holds nothing of such a motion")
        if x[2] >= 0.0:
            self.motion = self._on_wheels(before, dt, float(command[2]))
        else:
            self.motion = self._in_air()
        return self.motion

    def command(self, pwm: tuple[int, ...]) -> Array:
        """(4 + named,) de, da, dr [rad], throttle, controls of other names: of pulse widths; an output that is not sent
        yet is neutral.
        """
        names = (*_CONTROLS, *self.plant.vehicle.named_controls)
        found = np.zeros(len(names))
        for place, name in enumerate(names):
            control = self.plant.vehicle.controls.get(name)
            if control is None:
                continue
            pulses = [float(pwm[servo - 1]) if servo <= len(pwm) else 0.0 for servo in control.servos]
            if all(pulses):
                found[place] = float(control.deflection_from_pwm(*pulses))
        return found

    def _gust(self, dt: float) -> Array:
        """(3,) the next gust, body axes."""
        if self.wind.sigma == 0.0:
            return np.zeros(3)
        if dt != self._step or self._count >= len(self._gusts):
            self._step, self._count = dt, 0
            self._gusts = self.wind.gusts(round(_GUSTS_S / dt), dt, self._speed, self._generator)
        self._count += 1
        return np.asarray(self._gusts[self._count - 1])

    def _in_air(self) -> Motion:
        x, work = self._state.x, self._state.work
        to_body = np.array(rotation_matrix(*x[6:10])).reshape(3, 3)
        force = np.array([work[Aux.ax], work[Aux.ay], work[Aux.az]])
        return Motion(
            self._state.time_s, x[:3].copy(), to_body.T @ x[3:6], x[6:10].copy(), force, x[10:13].copy(), False
        )

    def _on_wheels(self, before: Array, dt: float, rudder: float) -> Motion:
        """Take out of the last step what wheels do not allow."""
        x = self._state.x
        gravity = self.plant.vehicle.environment.gravity
        old = np.array(rotation_matrix(*before[6:10])).reshape(3, 3).T @ before[3:6]
        new = np.array(rotation_matrix(*x[6:10])).reshape(3, 3).T @ x[3:6]
        _, theta, _ = euler_angles(*x[6:10])
        _, _, psi = euler_angles(*before[6:10])
        along = new[0] * math.cos(psi) + new[1] * math.sin(psi)
        # What the wings do not carry yet, the wheels do, and rub.
        carried = min(max((new[2] - old[2]) / (gravity * dt), 0.0), 1.0) if dt > 0.0 else 1.0
        slowed = _ROLLING * gravity * carried * dt
        along = 0.0 if abs(along) <= slowed else along - math.copysign(slowed, along)
        along = max(along, 0.0)
        turn = min(max(self._steering * along * rudder, -_FASTEST_TURN), _FASTEST_TURN)
        psi += turn * dt
        pitch = min(max(float(theta), self._rest), self._rest + _MOST_NOSE_UP)
        rate = float(x[11]) if pitch == theta else 0.0
        velocity = np.array([along * math.cos(psi), along * math.sin(psi), min(float(new[2]), 0.0)])
        x[:2] = before[:2] + 0.5 * dt * (velocity[:2] + old[:2])
        x[2] = min(float(x[2]), 0.0) if velocity[2] < 0.0 else 0.0
        x[6:10] = quaternion(0.0, pitch, psi)
        to_body = np.array(rotation_matrix(*x[6:10])).reshape(3, 3)
        x[3:6] = to_body @ velocity
        x[10:13] = (-turn * math.sin(pitch), rate, turn * math.cos(pitch))
        down = np.array([0.0, 0.0, gravity])
        force = to_body @ ((velocity - old) / dt - down if dt > 0.0 else -down)
        return Motion(self._state.time_s, x[:3].copy(), velocity, x[6:10].copy(), force, x[10:13].copy(), True)


def _require_servos(vehicle: Vehicle) -> None:
    bare = [
        name for name in ("elevator", "throttle") if name not in vehicle.controls or not vehicle.controls[name].servos
    ]
    if bare:
        raise SimVehicleError(
            f"{vehicle.path}: {' and '.join(bare)} without a servo; an autopilot moves controls by pulse widths"
        )
