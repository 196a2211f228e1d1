"""Cramer-Rao bound of a simulated flight: what its sensors tell at most, from its noise-free truth.

Nothing of the estimators is used: the flight is simulated again at the truth by the bundled simulator, and the outputs'
derivatives are central differences of whole simulations. In calm air the errors of the outputs are the sensors' own
(Maine & Iliff, NASA RP-1168, section 3.3); with gusts see `gust_bounds`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.flight.sensor_suite import RATES_HZ, TABLE_II
from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.physics.kernel_records import DrivingInputs
from sim_vehicle.physics.layout import CHANNELS
from sim_vehicle.physics.rotation import quaternion
from sim_vehicle.physics.simulation import simulate
from sim_vehicle.vehicle.packed_model import PackedModel, flatten
from sim_vehicle.vehicle.propulsion import rotor_scale
from sim_vehicle.vehicle.vehicle_file import Vehicle

Array = NDArray[np.float64]

STATES = ("u", "v", "w", "p", "q", "r", "phi", "theta", "psi")
LONGITUDINAL_STATES = ("u", "w", "q", "theta")
LONGITUDINAL_OUTPUTS = ("airspeed", "alpha", "q", "theta", "ax", "az")
LATERAL_OUTPUTS = ("beta", "p", "r", "phi", "psi", "ay")
GPS = ("vn", "ve", "vd")
# Sensor errors by the names of an identification's result: output, and whether a scale factor or a bias.
ERRORS = {
    **{f"accel_bias_{axis}": (f"a{axis}", False) for axis in "xyz"},
    **{f"gyro_bias_{rate}": (rate, False) for rate in "pqr"},
    **{f"{name}_scale": (name, True) for name in ("airspeed", "alpha", "beta", "theta")},
    **{f"{name}_bias": (name, False) for name in ("airspeed", "alpha", "beta", "phi", "theta")},
    **dict(zip(("wind_north", "wind_east", "wind_down"), ((name, False) for name in GPS), strict=True)),
}
# First words of the unknowns that no identification reports: where the motion starts, and its measured inputs.
INPUTS = ("start ", "thrust ", "rotor ")
_STEP = 1e-5  # of coefficients and states, relative where they exceed 1
_THRUST_STEP = 1e-4  # N
_ROTOR_STEP = 1e-5  # of full speed
SUB_STEPS = 4


@dataclass(frozen=True)
class Experiment:
    """A flight flown, and what is to be told from it.

    model: the true values of every coefficient of the structure, 0 where the aircraft has none, and its effects.
    outputs: names of those that are measured and used. lateral: whether lateral motion is free; else it is known.
    """

    flown: FlownFlight
    vehicle: Vehicle
    model: Model
    outputs: tuple[str, ...]
    lateral: bool

    @property
    def states(self) -> tuple[str, ...]:
        """The motion's free states."""
        return STATES if self.lateral else LONGITUDINAL_STATES

    @property
    def coefficients(self) -> tuple[str, ...]:
        """The coefficients that act on the free motion."""
        return tuple(n for n in self.model.coefficients if self.lateral or n.split("_")[0] in ("CL", "CD", "Cm"))

    @property
    def errors(self) -> tuple[str, ...]:
        """The errors that the outputs can have."""
        return tuple(name for name, (output, _) in ERRORS.items() if output in self.outputs)


@dataclass(frozen=True)
class Slopes:
    """Derivatives of the outputs at the truth.

    names: P unknowns. values: (N, outputs, P). sigma: (N, outputs) noise, infinite where an output has no sample.
    prior: (P, P) information from other measurements.
    """

    names: tuple[str, ...]
    values: Array
    sigma: Array
    prior: Array


def true_model(flown: Model, structure: Sequence[str]) -> Model:
    """`flown` with a coefficient of 0 for each name of the structure that it lacks."""
    entries = {name: flown.coefficients.get(name, Coefficient(0.0)) for name in structure}
    return Model(flown.name, entries, flown.effects)


def output_noise(name: str) -> float:
    """Standard deviation of one sample: noise, and the rounding to a step."""
    error = TABLE_II[name]
    return math.hypot(error.noise, error.quantum / math.sqrt(12.0))


def true_states(flown: FlownFlight) -> Array:
    """The nine STATES over ground at every sample, (N, 9)."""
    truth = flown.truth
    speed, alpha, beta = truth["V"], truth["alpha"], truth["beta"]
    air = np.stack(
        [speed * np.cos(beta) * np.cos(alpha), speed * np.sin(beta), speed * np.cos(beta) * np.sin(alpha)], axis=1
    )
    # Without steady wind the air moves with the gusts alone.
    ground = air + flown.gust_body
    return np.hstack([ground, np.stack([truth[name] for name in STATES[3:]], axis=1)])


def simulated(
    experiment: Experiment, flat: PackedModel, path: Array, C: Array, start: Array, thrust: Array, command: Array
) -> Array:
    """The outputs (N, outputs) without noise, for coefficients C, nine states at the start, thrust (N,) and commands
    (N, 4).

    path: (N, 9) true states, of which those that are not free are imposed.
    """
    flown = experiment.flown
    held = np.zeros((0, 9))
    if not experiment.lateral:
        held = path.copy()
        held[:, [STATES.index(name) for name in experiment.states]] = np.nan
    x0 = np.zeros(14)
    x0[:3] = [flown.truth[name][0] for name in ("north", "east", "down")]
    x0[3:6], x0[10:13], x0[13] = start[:3], start[3:6], np.nan
    x0[6:10] = quaternion(*(float(angle) for angle in start[6:]))
    count = path.shape[0]
    y = np.empty((count, len(CHANNELS)))
    dt = float(flown.time_s[1] - flown.time_s[0])
    inputs = DrivingInputs(
        np.ascontiguousarray(command), thrust, flown.truth["rho"], held, flown.gust_body, dt, SUB_STEPS, False
    )
    simulate(x0, 0, 0, count, inputs, flat.arrays._replace(C=C), y)
    return y[:, [CHANNELS.index(name) for name in experiment.outputs]]


def slopes(experiment: Experiment) -> Slopes:
    """Derivatives by coefficients, sensor errors, initial states and what is not known of thrust and rotor."""
    flat = flatten(experiment.vehicle, experiment.model)
    path, thrust = true_states(experiment.flown), experiment.flown.truth["thrust"]
    free = [STATES.index(name) for name in experiment.states]

    command = experiment.flown.command

    def fly(C: Array, states: Array, force: Array, commands: Array = command) -> Array:
        return simulated(experiment, flat, path, C, states, force, commands)

    found: dict[str, Array] = {}
    for name in experiment.coefficients:
        place = flat.names.index(name)
        step = _STEP * max(1.0, abs(flat.C[place]))
        moved = [flat.C.copy(), flat.C.copy()]
        moved[0][place] += step
        moved[1][place] -= step
        found[name] = (fly(moved[0], path[0], thrust) - fly(moved[1], path[0], thrust)) / (2.0 * step)
    for name, place in zip(experiment.states, free, strict=True):
        unit = np.eye(9)[place] * _STEP
        found[f"start {name}"] = (fly(flat.C, path[0] + unit, thrust) - fly(flat.C, path[0] - unit, thrust)) / (
            2.0 * _STEP
        )
    true = fly(flat.C, path[0], thrust)
    for name in experiment.errors:
        output, is_scale = ERRORS[name]
        column = experiment.outputs.index(output)
        found[name] = np.zeros_like(true)
        found[name][:, column] = true[:, column] if is_scale else 1.0
    shapes = _thrust_shapes(experiment)
    for name, shape in shapes.items():
        force = _THRUST_STEP * shape
        found[name] = (fly(flat.C, path[0], thrust + force) - fly(flat.C, path[0], thrust - force)) / (
            2.0 * _THRUST_STEP
        )
    turning = _rotor_shapes(experiment)
    for name, shape in turning.items():
        push = np.outer(_ROTOR_STEP * shape, [0.0, 0.0, 0.0, 1.0])
        found[name] = (fly(flat.C, path[0], thrust, command + push) - fly(flat.C, path[0], thrust, command - push)) / (
            2.0 * _ROTOR_STEP
        )
    names = tuple(found)
    values = np.stack(list(found.values()), axis=2)
    prior = _thrust_information(names, shapes, experiment.vehicle) + _rotor_information(
        names, turning, experiment.vehicle
    )
    return Slopes(names, values, _sigma(experiment), prior)


def calm_information(told: Slopes) -> Array:
    """Fisher information of the unknowns (P, P) in calm air."""
    rows = told.values / told.sigma[:, :, None]
    information = told.prior + np.einsum("kjp,kjq->pq", rows, rows)
    return np.asarray(information, dtype=np.float64)


def bounds(names: Sequence[str], information: Array, unknown: Sequence[str]) -> dict[str, float]:
    """Smallest standard deviation of every name of `unknown`, starts, thrust and propeller speed being unknown too.

    A sensor error that is not among `unknown` counts as known; see `bound_of` for what it would have cost.
    """
    kept = [i for i, name in enumerate(names) if name in unknown or name.startswith(INPUTS)]
    part = information[np.ix_(kept, kept)]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(part), 1e-300))
    values, vectors = np.linalg.eigh(part * np.outer(scale, scale))
    variance = np.sum(vectors**2 / np.maximum(values, 1e-15), axis=1) * scale**2
    return {names[i]: float(np.sqrt(v)) for i, v in zip(kept, variance, strict=True) if names[i] in unknown}


def bound_of(names: Sequence[str], information: Array, unknown: Sequence[str], name: str) -> float:
    """The bound of `name` where it is unknown beside all of `unknown`."""
    return bounds(names, information, [*unknown, name])[name]


def _thrust_shapes(experiment: Experiment) -> dict[str, Array]:
    """What the samples of the thrust sensor leave open, (N,) each: level; gain and lag behind the throttle; the start;
    where the propeller's thrust depends on it, the slope by the airspeed.

    Thrust follows the throttle as a first-order lag, of which the estimator knows neither gain nor time constant.
    """
    thrust, throttle = experiment.flown.truth["thrust"], experiment.flown.command[:, 3]
    shapes = {"thrust offset": np.ones(thrust.size)}
    if np.ptp(throttle) < 1e-6 or experiment.vehicle.propulsion is None:
        return shapes
    if experiment.vehicle.propulsion.CT:
        airspeed = experiment.flown.truth["V"] - experiment.flown.truth["V"].mean()
        shapes |= {"thrust slope": airspeed, "thrust curvature": airspeed**2}
    tau = experiment.vehicle.propulsion.tau
    shapes["thrust gain"] = _after_lag(throttle, tau)
    if tau > 0.0:
        shapes["thrust lag"] = _after_lag(throttle, 1.01 * tau) - _after_lag(throttle, 0.99 * tau)
        shapes["thrust start"] = np.exp(-0.02 * np.arange(thrust.size) / tau)
    moving = {name: shape - shape.mean() for name, shape in shapes.items() if float(np.std(shape)) > 1e-9}
    return {"thrust offset": shapes["thrust offset"]} | {n: shape / float(np.std(shape)) for n, shape in moving.items()}


def _rotor_shapes(experiment: Experiment) -> dict[str, Array]:
    """What the samples of the propeller's counter leave open, as held throttle (N,): level, gain, lag and start, as of
    the thrust. Empty where the propeller's speed acts on nothing but the thrust, which has a sensor of its own.
    """
    propulsion, throttle = experiment.vehicle.propulsion, experiment.flown.command[:, 3]
    if propulsion is None or not propulsion.CQ:
        return {}
    shapes = {"rotor offset": np.ones(throttle.size)}
    if np.ptp(throttle) > 1e-6:
        shapes["rotor gain"] = (throttle - throttle.mean()) / float(np.std(throttle))
        if propulsion.tau > 0.0:
            # d/dtau of u / (1 + tau s) is the lag's answer to minus the rate of what has passed it once.
            rate = throttle - _after_lag(throttle, propulsion.tau)
            shapes["rotor lag"] = rate / float(np.std(rate))
            shapes["rotor start"] = np.where(np.arange(throttle.size) == 0, 1.0, 0.0)
    return shapes


def _rotor_information(names: Sequence[str], shapes: dict[str, Array], vehicle: Vehicle) -> Array:
    """Information of the samples of the counter, which reads the held throttle behind the motor's lag."""
    rows = np.zeros((next(iter(shapes.values())).size if shapes else 0, len(names)))
    for name, shape in shapes.items():
        turned = _after_lag(shape, vehicle.propulsion.tau) * rotor_scale(vehicle.propulsion) * 30.0 / math.pi
        rows[:, names.index(name)] = turned / output_noise("rpm")
    return np.asarray(rows.T @ rows, dtype=np.float64)


def _after_lag(command: Array, tau: float, dt: float = 0.02) -> Array:
    """A held command after a first-order lag, at the samples, (N,)."""
    share = 1.0 if tau == 0.0 else 1.0 - math.exp(-dt / tau)
    out = np.full(command.size, command[0])
    for k in range(1, command.size):
        out[k] = out[k - 1] + share * (command[k - 1] - out[k - 1])
    return out


def _thrust_information(names: Sequence[str], shapes: dict[str, Array], vehicle: Vehicle) -> Array:
    """Information of the thrust sensor's samples: thrust is its reading plus the moving mass times measured ax."""
    moving = vehicle.propulsion.moving_mass if vehicle.propulsion is not None else 0.0
    spread = math.hypot(TABLE_II["thrust"].noise, moving * output_noise("ax"))
    length = next(iter(shapes.values())).size
    rows = np.zeros((length, len(names)))
    for name, shape in shapes.items():
        rows[:, names.index(name)] = shape
    if "accel_bias_x" in names:
        rows[:, names.index("accel_bias_x")] = moving
    rows /= spread
    return np.asarray(rows.T @ rows, dtype=np.float64)


def _sigma(experiment: Experiment) -> Array:
    time_s = experiment.flown.time_s
    sigma = np.empty((time_s.size, len(experiment.outputs)))
    for j, name in enumerate(experiment.outputs):
        sigma[:, j] = output_noise(name)
        if name in GPS:
            tick = np.floor(time_s * RATES_HZ["gps"] + 1e-6)
            sigma[1:, j] = np.where(np.diff(tick) > 0, sigma[1:, j], np.inf)
    return sigma
