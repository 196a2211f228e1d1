"""How the numbers that are estimated enter the simulation and the sensors."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence

import numpy as np

from sim_vehicle.effects import slot
from sim_vehicle.physics.kernel_records import DrivingInputs
from sim_vehicle.physics.layout import CHANNELS
from sim_vehicle.physics.rotation import quaternion
from sim_vehicle.physics.simulation import simulate_variants
from sim_vehicle.vehicle.packed_model import PackedModel
from sysid.arrays import Array
from sysid.problem.free_parameters import FreeParameter
from sysid.problem.sensitivities import Driven, Inputs, Lane, has_tangents, tangents
from sysid.signals.record import (
    OUTPUT_PLACES,
    OUTPUTS,
    Record,
    held_by_dead_band,
    simulated_effects,
    thrust_without_airspeed,
    with_other_inputs,
)
from sysid.signals.sensor_errors import SENSOR_ERRORS

_STATE_STEP = np.array([1e-4, 1e-4, 1e-4, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5])


STILL_AIR = np.zeros((0, 3))
# Up to this interval one integration step per sample follows the fast modes of small aircraft, s.
_CLOSE_SAMPLES_S = 0.021


def _state_vector(states: Array) -> Array:
    """(14,) simulation state from u v w p q r phi theta psi."""
    x0 = np.zeros(14)
    x0[3:6] = states[:3]
    x0[10:13] = states[3:6]
    x0[6:10] = quaternion(*(float(angle) for angle in states[6:9]))
    x0[13] = math.nan
    return x0


def with_errors(y: Array, errors: Mapping[str, float]) -> Array:
    """Readings (N, 15) from ideal ones (N, 19): (1 + scale) true + bias."""
    return with_placed_errors(y[:, OUTPUT_PLACES], errors)


def with_placed_errors(y: Array, errors: Mapping[str, float]) -> Array:
    """Readings from ideal OUTPUTS: (1 + scale) true + bias.

    Parameters
    ----------
    y : Array, shape (N, 15)
        Ideal OUTPUTS, each column in its output's unit.
    errors : Mapping of str to float
        Name of a sensor error -> its value, a bias in the output's unit, a scale error dimensionless; names that are
        not in SENSOR_ERRORS are left out.

    Returns
    -------
    Array, shape (N, 15)
        Readings, each column in its output's unit.
    """
    out = y.copy()
    for name, value in errors.items():
        if name not in SENSOR_ERRORS:
            continue
        output, form, _, _ = SENSOR_ERRORS[name]
        column = OUTPUTS.index(output)
        out[:, column] += value * y[:, column] if form == "scale" else value
    return out


def error_gains(errors: Mapping[str, float]) -> Array:
    """What one unit of each true output reads.

    Parameters
    ----------
    errors : Mapping of str to float
        Name of a sensor error -> its value; the scale errors, dimensionless, are used.

    Returns
    -------
    Array, shape (15,)
        Gain 1 + scale of each of OUTPUTS, dimensionless.
    """
    return np.array([1.0 + errors.get(f"{name}_scale", 0.0) for name in OUTPUTS])


def sensor_derivative(name: str, predicted: Array, errors: Mapping[str, float]) -> tuple[str, Array | float]:
    """The output that one sensor error changes, and the derivative by it.

    Parameters
    ----------
    name : str
        Name of the sensor error, of SENSOR_ERRORS.
    predicted : Array, shape (N, 15)
        Predicted readings of OUTPUTS, sensor errors included, each column in its output's unit.
    errors : Mapping of str to float
        Name of a sensor error -> its value, a bias in the output's unit, a scale error dimensionless.

    Returns
    -------
    output : str
        Name of the output, of OUTPUTS.
    derivative : Array, shape (N,), or float
        Derivative of the reading: by a bias 1, dimensionless and the same for all samples; by a scale error the true
        output, in its unit.
    """
    output, form, _, _ = SENSOR_ERRORS[name]
    if form == "bias":
        return output, 1.0
    bias, scale = errors.get(f"{output}_bias", 0.0), errors.get(f"{output}_scale", 0.0)
    return output, (predicted[:, OUTPUTS.index(output)] - bias) / (1.0 + scale)


def _columns(y: Array, outputs: Sequence[str]) -> Array:
    """The columns of y (N, 15) that some outputs stand in."""
    return y if outputs is OUTPUTS else y[:, [OUTPUTS.index(name) for name in outputs]]


def _timed(flat: PackedModel, record: Record) -> tuple[Array, Array]:
    """Effects (as in `flat.E`) at the record's own time, and its commands.

    commands: (M, 4), or (M, 6) with the other inputs that an effect needs.
    """
    effects = simulated_effects(flat, record)
    commands = with_other_inputs(held_by_dead_band(record.commands, record, effects), record, effects)
    return effects, commands


def free_states(record: Record) -> list[int]:
    """Which of the nine initial states are estimated: those that the record does not impose."""
    return [
        i for i in range(9) if not (record.imposed_states.size and np.isfinite(record.imposed_states[record.start, i]))
    ]


class Predictor:
    """Outputs of records as a function of the parameters.

    flat: the model everything else is taken from. parameters: what is estimated, P of them. Every record adds nine
    initial states, of which those imposed by `Record.imposed_states` are left out. sub_steps: integration steps per
    sample. tangent_steps: the same for the derivatives; None takes half of them where samples are close together, which
    moves the derivatives of small aircraft by less than a thousandth, and estimates by as much of their standard error.
    command_first: see sim_vehicle.physics.simulation.simulate.
    """

    def __init__(
        self,
        flat: PackedModel,
        parameters: Sequence[FreeParameter],
        records: Sequence[Record],
        *,
        sub_steps: int = 2,
        tangent_steps: int | None = None,
        command_first: float = 0.0,
    ) -> None:
        self.flat = flat
        self.parameters = tuple(parameters)
        self.records = tuple(records)
        self.sub_steps = sub_steps
        self.tangent_steps = tangent_steps
        self.command_first = command_first
        self._place = {name: i for i, name in enumerate(flat.names)}
        self.free_states = [free_states(record) for record in self.records]

    @property
    def size(self) -> int:
        """Number of unknowns: parameters and initial states."""
        return len(self.parameters) + sum(len(free) for free in self.free_states)

    def state_slice(self, index: int) -> slice:
        """Where the initial states of a record stand among the unknowns."""
        begin = len(self.parameters) + sum(len(free) for free in self.free_states[:index])
        return slice(begin, begin + len(self.free_states[index]))

    def initial_states(self, index: int, theta: Array, guess: Array) -> Array:
        """All nine initial states of a record: the free ones from `theta`, the others from `guess`."""
        states = guess.copy()
        states[self.free_states[index]] = theta[self.state_slice(index)]
        return states

    def apply(self, theta: Array) -> tuple[PackedModel, dict[str, float]]:
        """Model and sensor errors at `theta` (its first P entries)."""
        flat = self.flat.copy()
        errors: dict[str, float] = {}
        for parameter, value in zip(self.parameters, theta[: len(self.parameters)], strict=True):
            if parameter.kind == "coefficient":
                flat.C[self._place[parameter.name]] = value
            elif parameter.kind == "effect":
                effect, _, name = parameter.name.partition(".")
                flat.E[slot(effect)] = 1.0
                flat.E[slot(effect, name)] = value
            else:
                errors[parameter.name] = float(value)
        return flat, errors

    def outputs(
        self, index: int, flat: PackedModel, errors: dict[str, float], states: Array, gusts: Array = STILL_AIR
    ) -> Array:
        """Predicted OUTPUTS (N, 15) of a record from nine initial states u v w p q r phi theta psi.

        gusts: (M, 3) body-axis velocity of the air at every sample of the commands, m/s; (0, 3) for still air.
        """
        record = self.records[index]
        y = np.empty((1, record.length, len(CHANNELS)))
        shift = np.array([self.thrust_shift(record, errors)])
        timed, commands = _timed(flat, record)
        self._simulate(record, commands, _state_vector(states)[None], flat, timed[None], flat.C[None], shift, gusts, y)
        return with_errors(y[0], errors)

    def thrust_shift(self, record: Record, errors: Mapping[str, float]) -> float:
        """What an accelerometer's bias adds to the thrust of a motor that hangs on the cell, N."""
        return -record.moving_mass * errors.get("accel_bias_x", 0.0)

    def _simulate(
        self, record: Record, commands: Array, x0: Array, flat: PackedModel, E: Array, C: Array, shift: Array,
        gusts: Array, y: Array,
    ) -> None:  # fmt: skip
        inputs = DrivingInputs(
            commands, thrust_without_airspeed(record), record.rho, record.imposed_states, gusts, record.interval_s,
            self.sub_steps, float(self.command_first), record.seen,
        )  # fmt: skip
        models = flat.arrays._replace(E=E, C=C)
        simulate_variants(x0, 0, record.start, record.start + record.length, inputs, models, shift, y)

    def derivatives(
        self,
        index: int,
        theta: Array,
        states: Array,
        predicted: Array,
        out: Array | None = None,
        driven: Sequence[tuple[Record, float]] = (),
        outputs: Sequence[str] = OUTPUTS,
    ) -> Array:
        """Derivatives of some of a record's outputs by the parameters, its own free initial states and what drives it.

        Returns (N, outputs, P + states + driven): `out`, if that is given, written over.
        theta: unknowns; states: the record's nine initial states; predicted: (N, 15) there. driven: what the record
        becomes, in its commands, thrust and imposed states, by a step of an unknown, and the step. Sensor errors enter
        in closed form, parameters of effects by forward differences, all else by tangents of the simulation. Where lift
        lags there are differences alone.
        """
        record, count = self.records[index], len(self.parameters)
        flat, errors = self.apply(theta)
        unknowns = count + len(self.free_states[index])
        exact = has_tangents(flat, record.interval_s)
        shape = (record.length, len(outputs), unknowns + len(driven))
        by_sample = np.empty(shape) if out is None else out
        if not exact:
            by_sample[:] = 0.0
        result = np.moveaxis(by_sample, 2, 0)
        simulated = [
            i
            for i in range(unknowns)
            if i >= count
            or self.parameters[i].kind in ("coefficient", "effect")
            or (self.parameters[i].name == "accel_bias_x" and record.moving_mass > 0.0)
        ]
        if exact:
            differences = [i for i in simulated if i < count and self.parameters[i].kind == "effect"]
            places = [i for i in simulated if i not in differences]
            self._tangents(index, flat, errors, states, places, driven, outputs, by_sample)
        else:
            differences = simulated
            for i, (other, step) in enumerate(driven, unknowns):
                moved = copy.copy(self)
                moved.records = (other,)
                result[i] = _columns((moved.outputs(0, flat, errors, states) - predicted) / step, outputs)
        self._differences(index, theta, states, predicted, differences, outputs, result)
        for i, parameter in enumerate(self.parameters):
            if parameter.kind == "sensor":
                name, slope = sensor_derivative(parameter.name, predicted, errors)
                if name in outputs:
                    result[i][:, outputs.index(name)] += slope
        return by_sample

    def _tangents(
        self,
        index: int,
        flat: PackedModel,
        errors: Mapping[str, float],
        states: Array,
        places: Sequence[int],
        driven: Sequence[tuple[Record, float]],
        outputs: Sequence[str],
        out: Array,
    ) -> None:
        """Exact derivatives by the unknowns at `places`, initial states last of them, and by what drives the record,
        into `out` (N, outputs, P + states + driven).
        """
        record, count = self.records[index], len(self.parameters)
        lanes = []
        for i in places:
            if i >= count:
                lanes.append(Lane(i))
            elif self.parameters[i].kind == "sensor":
                lanes.append(Lane(i, thrust=-record.moving_mass))
            else:
                lanes.append(Lane(i, term=self._place[self.parameters[i].name]))
        steps = self.tangent_steps or self.sub_steps
        if self.tangent_steps is None and record.interval_s <= _CLOSE_SAMPLES_S:
            steps = (self.sub_steps + 1) // 2
        shift = self.thrust_shift(record, errors)
        others = [
            Driven(_timed(flat, one)[1], thrust_without_airspeed(one) + shift, one.imposed_states, step, one.seen)
            for one, step in driven
        ]
        lanes += [Lane(i) for i in range(out.shape[2] - len(driven), out.shape[2])]
        flat = flat.copy()
        flat.E[:], commands = _timed(flat, record)
        inputs = Inputs(
            record.start, record.start + record.length, commands, thrust_without_airspeed(record) + shift, record.rho,
            record.interval_s, steps, self.command_first, record.imposed_states, record.seen,
        )  # fmt: skip
        gains = _columns(error_gains(errors)[None], outputs)[0].tolist()
        tangents(flat, inputs, _state_vector(states), self.free_states[index], lanes, outputs, gains, others, out)

    def _differences(
        self,
        index: int,
        theta: Array,
        states: Array,
        predicted: Array,
        places: Sequence[int],
        names: Sequence[str],
        result: Array,
    ) -> None:
        """Forward differences by the unknowns at `places`, added to `result`, in one compiled call."""
        if not places:
            return
        record, count = self.records[index], len(self.parameters)
        flat, errors = self.apply(theta)
        flat.E[:], commands = _timed(flat, record)
        base, base_shift = _state_vector(states), self.thrust_shift(record, errors)
        # Per variant: the step, state, effects, coefficients, thrust.
        variants: list[tuple[float, Array, Array, Array, float]] = []
        for i in places:
            if i >= count:
                state = self.free_states[index][i - count]
                step = float(_STATE_STEP[state])
                moved_states = states.copy()
                moved_states[state] += step
                variants.append((step, _state_vector(moved_states), flat.E, flat.C, base_shift))
            elif self.parameters[i].kind == "sensor":
                # The apparent thrust of a bias, beside the bias itself.
                variants.append((1e-4 / record.moving_mass, base, flat.E, flat.C, base_shift - 1e-4))
            else:
                step = self.parameters[i].step * max(1.0, abs(theta[i]))
                step = -step if theta[i] + step > self.parameters[i].high else step
                shifted = theta.copy()
                shifted[i] += step
                moved, _ = self.apply(shifted)
                variants.append((step, base, _timed(moved, record)[0], moved.C, base_shift))
        steps, x0, E, C, shift = zip(*variants, strict=True)
        y = np.empty((len(variants), record.length, len(CHANNELS)))
        self._simulate(record, commands, np.array(x0), flat, np.array(E), np.array(C), np.array(shift), STILL_AIR, y)
        for i, step, outputs in zip(places, steps, y, strict=True):
            result[i] += _columns((with_errors(outputs, errors) - predicted) / step, names)
