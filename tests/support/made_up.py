"""Physics that no catalogue holds, in a simulator of its own: five made-up forces and moments, never in the product.

The equations of motion are integrated here in plain numpy by Kutta's rule of three eighths, not by the product's step;
of the product only the rates of the known physics are used, to which the made-up term is added.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from flight_bounds import Array

from sim_vehicle.flight.plant import Plant, PlantState
from sim_vehicle.model.model_file import Model
from sim_vehicle.physics.actuation import advance_actuators
from sim_vehicle.physics.ideal_sensors import read_sensors
from sim_vehicle.physics.layout import HISTORY, Aux
from sim_vehicle.vehicle.vehicle_file import Vehicle

_STEP_S = 0.005
_STILL = np.zeros(3)
_AX, _P_DOT = int(Aux.ax), int(Aux.p_dot)


@dataclass(frozen=True)
class Flow:
    """What a made-up term may depend on: s, m/s, rad, rad/s; surfaces in rad, throttle 0 to 1; height in m."""

    time: float
    V: float
    alpha: float
    beta: float
    p: float
    q: float
    r: float
    surfaces: Array
    height: float


@dataclass(frozen=True)
class MadeUp:
    """coefficients: the term's share of CX, CY, CZ (body axes), Cl, Cm and Cn at a flow, (6,)."""

    title: str
    coefficients: Callable[[Flow], tuple[float, float, float, float, float, float]]


def _lift_ripple(flow: Flow) -> tuple[float, float, float, float, float, float]:
    return 0.0, 0.0, -0.05 * math.sin(2.0 * math.pi * flow.alpha / math.radians(3.0)), 0.0, 0.0, 0.0


def _periodic_moment(flow: Flow) -> tuple[float, float, float, float, float, float]:
    return 0.0, 0.0, 0.0, 0.0, 0.004 * math.sin(2.0 * math.pi * 0.9 * flow.time), 0.0


def _one_sided_rudder(flow: Flow) -> tuple[float, float, float, float, float, float]:
    return 0.0, 0.0, 0.0, 0.0, 0.0, -0.05 * max(float(flow.surfaces[2]), 0.0)


def _sideslip_notch(flow: Flow) -> tuple[float, float, float, float, float, float]:
    return 0.0, 0.0, 0.0, 0.01 * math.exp(-0.5 * (flow.beta / math.radians(0.7)) ** 2), 0.0, 0.0


def _rate_hump(flow: Flow) -> tuple[float, float, float, float, float, float]:
    return 0.0, 0.0, 0.0, 0.0, 0.02 * math.sin(4.0 * flow.q), 0.0


MADE_UP = {
    "lift_ripple": MadeUp("lift that ripples with the angle of attack, period 3 deg", _lift_ripple),
    "periodic_moment": MadeUp("a pitching moment that swings by itself at 0.9 Hz", _periodic_moment),
    "one_sided_rudder": MadeUp("more yaw from the rudder on one side alone", _one_sided_rudder),
    "sideslip_notch": MadeUp("a rolling moment about zero sideslip alone", _sideslip_notch),
    "rate_hump": MadeUp("a pitching moment that turns back as the pitch rate grows", _rate_hump),
}


class MadeUpPlant(Plant):
    """A vehicle with a model and one made-up term."""

    def __init__(self, vehicle: Vehicle, model: Model, term: MadeUp) -> None:
        super().__init__(vehicle, model)
        self._term = term
        self._time = 0.0
        self._trimming = True

    def begin(self) -> None:
        """The trim is found: from now on the term acts."""
        self._trimming = False

    def rates(self, state: PlantState, wind_ned: Array, gust_body: Array) -> Array:
        """Rate of the state vector (14,), the made-up term with it; by-products are left in `state.work`."""
        rate, W = super().rates(state, wind_ned, gust_body), state.work
        if self._trimming:
            return rate
        mass, geometry = self.vehicle.mass, self.vehicle.geometry
        V = float(W[Aux.V])
        flow = Flow(
            self._time, V, float(W[Aux.alpha]), float(W[Aux.beta]), *(float(x) for x in state.x[10:13]),
            state.surfaces, float(-state.x[2]),
        )  # fmt: skip
        CX, CY, CZ, Cl, Cm, Cn = self._term.coefficients(flow)
        force = 0.5 * float(W[Aux.rho]) * V**2 * geometry.S
        accelerations = force / mass.mass * np.array([CX, CY, CZ])
        roll, yaw = force * geometry.b * Cl, force * geometry.b * Cn
        determinant = mass.Ixx * mass.Izz - mass.Ixz**2
        angular = np.array(
            [
                (mass.Izz * roll + mass.Ixz * yaw) / determinant,
                force * geometry.c * Cm / mass.Iyy,
                (mass.Ixz * roll + mass.Ixx * yaw) / determinant,
            ]
        )
        rate[3:6] += accelerations
        rate[10:13] += angular
        W[_AX : _AX + 3] += accelerations
        W[_P_DOT : _P_DOT + 3] += angular
        return rate

    def evaluate(self, state: PlantState, wind_ned: Array, gust_body: Array, interval: float) -> None:
        """Bring by-products and readings up to date with the state."""
        self.rates(state, wind_ned, gust_body)
        read_sensors(state.x, state.work, self.flat.P, self.flat.E, interval, state.sensor, state.reading)

    def step(
        self, state: PlantState, command: Array, dt: float, wind_ned: Array = _STILL, gust_body: Array = _STILL,
        gust_at_end: Array | None = None,
    ) -> None:  # fmt: skip
        """Fly `dt` seconds under `command`, in place."""
        self.begin()
        state.commands[:-1] = state.commands[1:]
        state.commands[-1] = command
        count = max(1, math.ceil(dt / _STEP_S - 1e-9))
        step, mean = dt / count, np.zeros(4)
        for i in range(count):
            advance_actuators(state.commands, HISTORY - 1, i * step, step, dt, self.flat.P, self.flat.E,
                              state.actuators, mean, state.surfaces)  # fmt: skip
            end = state.surfaces.copy()
            state.surfaces[:] = mean
            begin = state.x.copy()
            k1 = self.rates(state, wind_ned, gust_body)
            state.x[:], self._time = begin + step / 3.0 * k1, self._time + step / 3.0
            k2 = self.rates(state, wind_ned, gust_body)
            state.x[:], self._time = begin + step * (k2 - k1 / 3.0), self._time + step / 3.0
            k3 = self.rates(state, wind_ned, gust_body)
            state.x[:], self._time = begin + step * (k1 - k2 + k3), self._time + step / 3.0
            k4 = self.rates(state, wind_ned, gust_body)
            state.x[:] = begin + step / 8.0 * (k1 + 3.0 * (k2 + k3) + k4)
            state.x[6:10] /= np.linalg.norm(state.x[6:10])
            state.surfaces[:] = end
        self.evaluate(state, wind_ned, gust_body if gust_at_end is None else gust_at_end, dt)
