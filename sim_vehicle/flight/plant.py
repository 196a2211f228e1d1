"""A vehicle with a model, ready to be flown tick by tick."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.effects import slot
from sim_vehicle.effects.sensor_time_skew import is_late, split_delay
from sim_vehicle.errors import ModelFileError, VehicleFileError
from sim_vehicle.flight.state import PlantState, Trim
from sim_vehicle.flight.trim import solve_trim
from sim_vehicle.model.model_file import Model
from sim_vehicle.physics.actuation import RISE_COLUMN, count_named, start_actuators
from sim_vehicle.physics.atmosphere import air_at
from sim_vehicle.physics.dynamics import derivatives
from sim_vehicle.physics.ideal_sensors import read_sensors
from sim_vehicle.physics.kernel_records import Moment, TickInputs, TickState, TickWork
from sim_vehicle.physics.layout import (
    ACTUATOR_SIZE,
    CHANNELS,
    HISTORY,
    MORE_COLUMN,
    SENSOR_SIZE,
    STATE_SIZE,
    WORK_SIZE,
    Aux,
)
from sim_vehicle.physics.propeller import rotor_speed
from sim_vehicle.physics.rotation import euler_angles, quaternion
from sim_vehicle.physics.simulation import HEIGHT_COLUMN, read_within_tick, tick
from sim_vehicle.vehicle.controls import MOTOR_MOMENTS
from sim_vehicle.vehicle.motors import motor_loads
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import Vehicle

Array = NDArray[np.float64]

OUTPUTS = (
    "V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az", "north", "east", "down",
    "vn", "ve", "vd", "de", "da", "dr", "throttle", "thrust", "rpm", "rho", "p_dot", "q_dot", "r_dot",
    "CL", "CD", "CY", "Cl", "Cm", "Cn",
)  # fmt: skip
_STILL = np.zeros(3)
_FREE = np.zeros(0)


class _Motors(NamedTuple):
    """Of several motors at a moment. throttle: (M,) behind their lags; thrust: N, of all; moments: (3,)."""

    throttle: Array
    thrust: float
    moments: Array


class Plant:
    """The equations of motion of one vehicle with one model.

    max_step: largest integration step, s. Raises ModelFileError for a model without a needed value, VehicleFileError
    for a vehicle that cannot be flown (no propulsion).
    """

    def __init__(self, vehicle: Vehicle, model: Model, max_step: float = 0.005) -> None:
        self.vehicle = vehicle
        self.model = model
        self.flat = flatten(vehicle, model)
        # Whoever flies gives the wind as it is at every height (sim_vehicle.flight.wind), and u v w are over ground.
        self.flat.E[slot("wind_shear")] = 0.0
        # A lift that lags is a state of its own; Runge-Kutta's step must not be long against its time constant.
        self.max_step = min(max_step, (model.effect("unsteady_lift") or {}).get("tau", max_step))
        self._delay = (model.effect("actuator_delay") or {}).get("delay", 0.0)
        if vehicle.propulsion is None or not vehicle.propulsion.by_throttle:
            raise VehicleFileError(
                f"{vehicle.path}: to fly this vehicle give [propulsion] max_thrust in newtons, "
                "or CT, diameter and max_rpm"
            )
        skew = model.effect("sensor_time_skew") or {"delay": 0.0, "group": 0.0}
        self._skew = skew["delay"]
        self._late = [j for j in range(len(CHANNELS)) if is_late(j, skew["group"])] if self._skew > 0.0 else []
        self._scratch = np.zeros((6, STATE_SIZE))
        self._rate = np.zeros(STATE_SIZE)
        self._mean = np.zeros(4 + count_named(self.flat.F))
        self._named = len(vehicle.named_inputs)
        self._motors = [vehicle.named_controls.index(name) for name in vehicle.motors]

    def effect(self, name: str) -> dict[str, float] | None:
        """Parameters of an effect of the model, None where it has none of that name."""
        return self.model.effect(name)

    def density(self, altitude: float) -> float:
        """Air density [kg/m3]: the vehicle file's, else that of the standard atmosphere at `altitude` [m]."""
        fixed = self.vehicle.environment.air_density
        return air_at(altitude)[2] if fixed is None else fixed

    def trim(self, airspeed: float | None = None, altitude: float | None = None, climb_angle: float = 0.0) -> Trim:
        """Steady straight flight at `airspeed` [m/s], `altitude` [m], `climb_angle` [rad]; else TrimError."""
        flight = self.vehicle.flight
        return solve_trim(
            self,
            flight.airspeed if airspeed is None else airspeed,
            flight.altitude if altitude is None else altitude,
            climb_angle,
        )

    def state_at(self, x: Array, command: Array, surfaces: Array) -> PlantState:
        """State with actuators at rest at `command` and surfaces as given, sensors settled.

        Controls of other names than de, da, dr and throttle stand behind these four in both; else at 0, each motor at
        the throttle.
        """
        actuators = np.zeros(ACTUATOR_SIZE)
        start_actuators(command, actuators)
        commands = np.tile(self._row(np.asarray(command, dtype=np.float64)), (HISTORY, 1))
        if len(surfaces) == 4:
            motors = self.vehicle.motors
            own = [float(surfaces[3]) if name in motors else 0.0 for name in self.vehicle.named_inputs]
            surfaces = np.append(surfaces, own)
        state = PlantState(
            np.array(x, dtype=np.float64), actuators, np.zeros(SENSOR_SIZE), commands,
            np.array(surfaces, dtype=np.float64), np.zeros(WORK_SIZE + self._mean.size - 4), np.zeros(len(CHANNELS)),
        )  # fmt: skip
        self.evaluate(state, _STILL, _STILL, 0.0)
        return state

    def _row(self, command: Array) -> Array:
        """A command as a row of what the compiled code flies by."""
        if not self._named:
            return command
        row = np.zeros(MORE_COLUMN + self._named)
        row[:4], row[HEIGHT_COLUMN], row[RISE_COLUMN] = command[:4], np.nan, np.nan
        row[MORE_COLUMN : MORE_COLUMN + command.size - 4] = command[4:]
        return row

    def _run_motors(self, state: PlantState, row: Array, dt: float, rho: float) -> tuple[_Motors, _Motors]:
        """What several motors do over a step in the mean, and at its end; their throttles go on.

        row: the command, 0 to 1 behind its surfaces.
        """
        asked = np.clip(row[MORE_COLUMN + np.array(self._motors)], 0.0, 1.0)
        before = state.motors if state.motors.size else np.full(asked.size, row[3])
        taus = np.array([max(one.tau, 1e-9) for one in self.vehicle.motors.values()])
        left = np.exp(-dt / taus)
        state.motors = asked + (before - asked) * left
        mean = asked + (before - asked) * taus / dt * (1.0 - left)
        V, air = np.full(2, state.work[Aux.V]), np.full(2, rho)
        throttle = {name: np.array([mean[i], state.motors[i]]) for i, name in enumerate(self.vehicle.motors)}
        loads = motor_loads(self.vehicle, throttle, V, air)
        now, after = (
            _Motors(one, float(loads.thrust[i]), loads.moments[i]) for i, one in enumerate((mean, state.motors))
        )
        return now, after

    def rates(self, state: PlantState, wind_ned: Array, gust_body: Array) -> Array:
        """Rate of the state vector (14,) as it is now; by-products are left in `state.work`."""
        flat = self.flat
        rho = self.density(float(-state.x[2]))
        derivatives(state.x, state.surfaces, state.thrust, wind_ned, gust_body, rho, flat.P, flat.E, flat.C, flat.F,
                    flat.K, flat.T, state.work, self._rate)  # fmt: skip
        return self._rate.copy()

    def evaluate(self, state: PlantState, wind_ned: Array, gust_body: Array, interval: float) -> None:
        """Bring by-products and readings up to date with the state; `interval` since the last reading [s]."""
        self.rates(state, wind_ned, gust_body)
        read_sensors(state.x, state.work, self.flat.P, self.flat.E, interval, state.sensor, state.reading)
        if self._late:
            self._delay_readings(state, interval)

    def _delay_readings(self, state: PlantState, interval: float) -> None:
        """Keep the newest readings, and show of the delayed sensors those of before."""
        if interval == 0.0:
            state.past = np.tile(state.reading, (HISTORY, 1))
            state.past_sensor = state.sensor.copy()
            return
        whole, part = split_delay(self._skew / interval)
        if part == 0.0:
            state.past[:-1] = state.past[1:]
            state.past[-1] = state.reading
        state.reading[self._late] = state.past[HISTORY - 1 - whole, self._late]

    def _glimpse(self, state: PlantState, inputs: TickInputs, at_end: Array) -> None:
        """Keep what sensors that are delayed by a part of a tick read at that moment of the tick to be flown."""
        _, part = split_delay(self._skew / inputs.dt)
        if part == 0.0:
            return
        share, gust = 1.0 - part, inputs.gust
        state.past[:-1] = state.past[1:]
        moment = Moment(share, gust + (2.0 * share - 1.0) * (at_end - gust), math.nan)
        read_within_tick(
            TickState(state.x, state.actuators, state.surfaces), inputs, moment, self.flat.arrays,
            TickWork(state.work, self._scratch, self._mean, self._rate), state.past_sensor, state.past[-1],
        )  # fmt: skip

    def step(
        self,
        state: PlantState,
        command: Array,
        dt: float,
        wind_ned: Array = _STILL,
        gust_body: Array = _STILL,
        gust_at_end: Array | None = None,
    ) -> None:
        """Fly `dt` seconds under `command` (de, da, dr [rad], throttle 0..1, controls of other names), in place.

        wind_ned: (3,) velocity of the air, m/s; gust_body: (3,) the same in body axes, on top of it, its mean over the
        step; gust_at_end: what the sensors meet there, None for the same.
        The time of the state goes on by `dt`.
        Raises ModelFileError for a delay longer than what is kept of commands or readings.
        """
        flat = self.flat
        for name, delay, kept in (
            ("actuator_delay", self._delay, (HISTORY - 1) * dt),
            ("sensor_time_skew", self._skew, (HISTORY - 1) * dt),
        ):
            if delay > kept:
                raise ModelFileError(f"effect {name}: delay must be at most {kept:g} s here, got {delay:g}")
        state.commands[:-1] = state.commands[1:]
        state.commands[-1] = self._row(command)
        sub_steps = max(1, math.ceil(dt / self.max_step - 1e-9))
        rho = self.density(float(-state.x[2]))
        thrust = math.nan
        if self._motors:
            over, after = self._run_motors(state, state.commands[-1], dt, rho)
            thrust, state.thrust = over.thrust, after.thrust
            state.commands[-1, -len(MOTOR_MOMENTS) :] = over.moments
            state.commands[-1, MORE_COLUMN + np.array(self._motors)] = over.throttle
        at_end = gust_body if gust_at_end is None else gust_at_end
        if self._late:
            inputs = TickInputs(state.commands, HISTORY - 1, wind_ned, gust_body, rho, thrust, _FREE, dt, sub_steps)
            self._glimpse(state, inputs, at_end)
        tick(state.x, state.actuators, state.commands, HISTORY - 1, dt, sub_steps, wind_ned, gust_body, rho, thrust,
             _FREE, flat.P, flat.E, flat.C, flat.F, flat.K, flat.T, state.work, self._scratch, self._mean,
             state.surfaces[: self._mean.size])  # fmt: skip
        if self._motors:
            state.surfaces[-len(MOTOR_MOMENTS) :] = after.moments
            state.surfaces[4 + np.array(self._motors)] = after.throttle
        self.evaluate(state, wind_ned, at_end, dt)

    def read(self, state: PlantState) -> Array:
        """What ideal sensors at their mounting places read, (19,) in the order of CHANNELS."""
        return state.reading.copy()

    def outputs(self, state: PlantState) -> Array:
        """True values at the centre of gravity, in the order of OUTPUTS."""
        x, W, surfaces = state.x.tolist(), state.work.tolist(), state.surfaces.tolist()
        phi, theta, psi = euler_angles(*x[6:10])
        thrust = W[Aux.thrust]
        rpm = rotor_speed(surfaces[3], thrust, self.flat.P) * 30.0 / math.pi
        return np.array(
            [
                W[Aux.V], W[Aux.alpha], W[Aux.beta], x[10], x[11], x[12], phi, theta,
                psi, W[Aux.ax], W[Aux.ay], W[Aux.az], x[0], x[1], x[2], *state.reading[14:17].tolist(), *surfaces[:4],
                thrust, rpm, W[Aux.rho], W[Aux.p_dot], W[Aux.q_dot], W[Aux.r_dot], *W[Aux.CL : Aux.Cn + 1],
            ]
        )  # fmt: skip


__all__ = ["CHANNELS", "OUTPUTS", "Plant", "PlantState", "Trim", "quaternion"]
