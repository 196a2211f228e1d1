"""The bench's own errors, carried into the standard errors of the estimates.

A calibration curve and a linkage are known from the bench only as well as their points scatter. What the flight itself
estimates (a vane's scale, a pitot's bias) absorbs its part of such an error; the rest moves the coefficients. Each
independent part of a bench error, of one standard deviation, moves the estimate by one Gauss-Newton step d, that of a
thousandth of it times a thousand: the travel of a surface may be known to a third alone, over which a simulation is not
linear, while the estimate follows it in proportion. The bench and the flight's noise are independent, so the covariance
of the estimate grows by the sum of d d' (consider covariance: S. F. Schmidt, Advances in Control Systems 3, 1966; B. D.
Tapley et al., Statistical Orbit Determination, ch. 6).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.controls import signal_of
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.filter_error.estimation import build_filter
from sysid.filter_error.estimator import FilterErrorResult
from sysid.numerics.normal_equations import solve
from sysid.output_error.estimator import OutputError, OutputErrorResult
from sysid.output_error.from_problem import build
from sysid.output_error.linearisation import OutputErrorLinearisation
from sysid.problem.estimation_problem import Problem
from sysid.signals.calibration import Calibration
from sysid.signals.preparation import Prepared
from sysid.signals.record import OUTPUTS, SURFACES, Record, angle_wrap
from sysid.signals.redundant_sensors import PAIRS
from sysid.uncertainty.systematic import LINKAGE, SHARE

_OF_LINKAGE = ("_gain_std", "_bias_std")
MEASURED = ("alpha", "beta", "airspeed")
#: Where surfaces move between their samples: what is known at best of when they were where, s, by the whole
#: milliseconds of a log's stamps; and how fast a small aircraft's fastest mode is, rad/s. Between samples they go in
#: lines: to a mode of a rad/s what moved otherwise, and was at its mean all the while, seems a dt^2 / 12 away.
SURFACE_CLOCK, STAMPS_STD_S, _FASTEST = "surface_clock", 5e-4, 30.0


@dataclass(frozen=True)
class BenchError:
    """One independent part of a bench error, of one standard deviation.

    source: what was on the bench, for a linkage as `systematic` of a result names it. record: a record as it would read
    with the error.
    """

    source: str
    record: Callable[[Record], Record]


def bench_errors(prepared: Sequence[Prepared], vehicle: Vehicle) -> list[BenchError]:
    """Every part of every bench error that the flights rest on."""
    found: list[BenchError] = []
    curves = {(name, flight.data.name): curve for flight in prepared for name, curve in flight.calibrations.items()}
    shares = {flight.data.name: flight.shares for flight in prepared}
    for name in dict.fromkeys(name for name, _ in curves):
        output = {second: first for first, second in PAIRS.items()}.get(name, name)
        mine = {
            flight: (curve, shares[flight].get(name, 1.0 if output == name else 0.0))
            for (signal, flight), curve in curves.items()
            if signal == name
        }
        if output not in (*MEASURED, "thrust"):
            continue
        parts = max(len(curve.coefficients) for curve, _ in mine.values())
        found += [BenchError(name, _misread(output, mine, part, vehicle)) for part in range(parts)]
    if any(stretch.record.joined for flight in prepared for stretch in flight.stretches):
        found.append(BenchError(SURFACE_CLOCK, _otherwise_within))
    return [*found, *linkage_errors(vehicle)]


def late(record: Record, std_s: float = STAMPS_STD_S) -> Record:
    """The record with its surfaces later by what is not known of when they were where."""
    return record.with_surfaces(lambda one: one - std_s * np.gradient(one, record.interval_s, axis=0))


def _otherwise_within(record: Record) -> Record:
    """The record with its surfaces later by that, and by what a simulation does not know of them between samples."""
    return late(record, float(np.hypot(STAMPS_STD_S, _FASTEST * record.interval_s**2 / 12.0)))


def linkage_errors(vehicle: Vehicle) -> list[BenchError]:
    """What the vehicle file says of how well each linkage is known: the gain of it, and its zero."""
    found: list[BenchError] = []
    for name, control in vehicle.controls.items():
        column = (*SURFACES, "throttle", *vehicle.named_controls).index(signal_of(name))
        if control.gain_std:
            found.append(BenchError(f"{name}_gain_std", _moved(column, control.gain_std, 0.0)))
        if control.bias_std:
            found.append(BenchError(f"{name}_bias_std", _moved(column, 0.0, control.bias_std)))
    return found


def is_of_linkage(source: str) -> bool:
    """Whether a source is one of `linkage_errors`."""
    return source.endswith(_OF_LINKAGE)


def is_of_travel(source: str) -> bool:
    """Whether a source is about how far surfaces move, which cancels in whatever is asked in shares of their travel."""
    return is_of_linkage(source) or source == LINKAGE.name


def is_of_surfaces(source: str) -> bool:
    """Whether a source is about where surfaces were: its gain, its zero, or when."""
    return is_of_linkage(source) or source == SURFACE_CLOCK


def _misread(
    name: str, curves: Mapping[str, tuple[Calibration, float]], part: int, vehicle: Vehicle
) -> Callable[[Record], Record]:
    """The change of one measured signal by one part of its curve's error."""

    def change(record: Record) -> Record:
        if record.flight not in curves:
            return record
        curve, share = curves[record.flight]
        if share == 0.0 or part >= len(curve.coefficients):
            return record
        if name == "thrust":
            return replace(record, thrust=record.thrust + curve.error_modes(record.thrust)[part])
        z = record.z.copy()
        column = z[:, OUTPUTS.index(name)]
        factor = np.ones(column.size)
        if name == "airspeed" and vehicle.sensors.airspeed.kind == "true":
            # The curve gives calibrated airspeed.
            factor = np.sqrt(SEA_LEVEL_DENSITY / record.rho[record.start : record.start + record.length])
        read = column / factor
        if name == "airspeed" and curve.si_unit == "Pa":
            pressure = 0.5 * SEA_LEVEL_DENSITY * read * np.abs(read)
            slope = np.maximum(SEA_LEVEL_DENSITY * np.abs(read), 1e-6)
            column += share * factor * curve.error_modes(pressure)[part] / slope
        else:
            column += share * factor * curve.error_modes(read)[part]
        return replace(record, z=z)

    return change


def _moved(column: int, gain: float, bias: float) -> Callable[[Record], Record]:
    def moved(inputs: Array) -> Array:
        found = inputs.copy()
        found[:, column] += gain * inputs[:, column] + bias
        return found

    def change(record: Record) -> Record:
        if column < len(SURFACES):
            return record.with_surfaces(moved)
        return replace(record, commands=moved(record.commands))

    return change


@dataclass(frozen=True)
class BenchEffect:
    """A bench error with the change that it seems to be, and what it adds to the residuals (N, 15) of each record."""

    error: BenchError
    apparent: ApparentChange
    added: list[Array]


def misled(errors: Sequence[BenchError], here: OutputErrorLinearisation) -> list[BenchEffect]:
    """What each of the bench errors, of one standard deviation, does at an estimate."""
    return [_misled(error, here) for error in errors]


def _misled(error: BenchError, here: OutputErrorLinearisation) -> BenchEffect:
    problem = here.problem
    changed = replace(problem, records=tuple(map(error.record, problem.records)))
    false = apparent_change(changed, problem)
    if not false.inputs_changed:
        return BenchEffect(error, false, [angle_wrap(change) for change in false.outputs])
    little = replace(problem, records=_a_little(changed.records, problem.records))
    other = build(little, here.model, here.coefficients, here.effects, here.result.sigma)
    after = other.residuals(other.predict(here.result.theta))
    pairs = zip(after, here.residuals, strict=True)
    return BenchEffect(error, false, [angle_wrap(new - old) / SHARE for new, old in pairs])


def _a_little(changed: Sequence[Record], records: Sequence[Record]) -> tuple[Record, ...]:
    """The records with SHARE of a bench error: all that it changes are numbers that it changes in proportion."""

    def between(old: Array, new: Array) -> Array:
        return old if new is old else old + SHARE * (new - old)

    return tuple(
        replace(
            old, z=between(old.z, new.z), thrust=between(old.thrust, new.thrust),
            commands=between(old.commands, new.commands), positions=between(old.positions, new.positions),
            imposed_states=between(old.imposed_states, new.imposed_states),
        )
        for new, old in zip(changed, records, strict=True)
    )  # fmt: skip


def carry(
    every: Sequence[BenchEffect], here: OutputErrorLinearisation, result: OutputErrorResult
) -> tuple[OutputErrorResult, dict[str, dict[str, float]]]:
    """The result with the bench errors in its covariance, and what each of them contributes.

    here: the estimate, or one so near to `result` that the same slopes hold. A reported sensor error is that of the
    signal as it was used, bench error included, so its own curve's error does not widen it.
    Returns parameter -> source -> standard deviation beside the result, with its sign where the source has one part.
    """
    shares: dict[str, dict[str, float]] = {parameter.name: {} for parameter in result.parameters}
    if not every:
        return result, shares
    information, _ = here.normal
    covariance, white = result.covariance.copy(), result.covariance_white.copy()
    for one, pull in zip(every, here.gradient_changes([one.added for one in every]).T, strict=True):
        pull[: len(result.parameters)] += _prior_pull(here.estimation, here.problem, one.apparent.sensors)
        step = solve(information, pull)
        for i, parameter in enumerate(result.parameters):
            step[i] -= one.apparent.sensors.get(parameter.name, 0.0)
            _add(shares[parameter.name], one.error.source, float(step[i]))
        covariance += np.outer(step, step)
        white += np.outer(step, step)
    return replace(result, covariance=covariance, covariance_white=white), shares


def _add(shares: dict[str, float], source: str, step: float) -> None:
    shares[source] = float(np.hypot(shares[source], step)) if source in shares else step


@dataclass(frozen=True)
class ApparentChange:
    """What a bench error does: to each record's outputs, whether to its inputs, and to the sensor errors estimated."""

    outputs: list[Array]
    inputs_changed: bool
    sensors: dict[str, float]


def apparent_change(changed: Problem, problem: Problem) -> ApparentChange:
    """What the difference of two sets of records seems to be: `changed` after a bench error, `problem` as measured."""
    pairs = list(zip(changed.records, problem.records, strict=True))
    outputs = [new.z - old.z for new, old in pairs]
    inputs = any(
        new.thrust is not old.thrust or new.commands is not old.commands or new.imposed_states is not old.imposed_states
        for new, old in pairs
    )
    sensors: dict[str, float] = {}
    for name in MEASURED:
        column = OUTPUTS.index(name)
        change = np.concatenate([one[:, column] for one in outputs])
        free = [key for key in (f"{name}_scale", f"{name}_bias") if key in problem.sensors]
        good = np.isfinite(change)
        if not free or not np.any(change[good]):
            continue
        read = np.concatenate([old.z[:, column] for _, old in pairs])[good]
        design = np.column_stack([read if key.endswith("_scale") else np.ones(read.size) for key in free])
        absorbed = np.linalg.lstsq(design, change[good], rcond=None)[0]
        sensors |= dict(zip(free, absorbed.tolist(), strict=True))
    return ApparentChange(outputs, inputs, sensors)


def _prior_pull(estimation: OutputError, problem: Problem, sensors: Mapping[str, float]) -> Array:
    """A prior that came from the same readings moves with their error."""
    shift = np.zeros(len(estimation.prior_mean))
    for i, parameter in enumerate(estimation.predictor.parameters):
        if parameter.name in problem.priors:
            shift[i] = sensors.get(parameter.name, 0.0)
    return np.asarray(estimation.prior_information @ shift)


def carry_filtered(
    errors: Sequence[BenchError],
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    result: FilterErrorResult,
) -> tuple[FilterErrorResult, dict[str, dict[str, float]]]:
    """The result with bench errors in its covariance, and what each contributes (see
    sysid.uncertainty.bench_errors.carry).
    """
    shares: dict[str, dict[str, float]] = {parameter.name: {} for parameter in result.parameters}
    if not errors:
        return result, shares
    unfinished = build_filter(problem, model, coefficients, effects).step_at(result)
    covariance, white = result.covariance.copy(), result.covariance_white.copy()
    for error in errors:
        changed = replace(problem, records=tuple(map(error.record, problem.records)))
        little = replace(problem, records=_a_little(changed.records, problem.records))
        step = (build_filter(little, model, coefficients, effects).step_at(result) - unfinished) / SHARE
        false = apparent_change(changed, problem).sensors
        for i, parameter in enumerate(result.parameters):
            step[i] -= false.get(parameter.name, 0.0)
            _add(shares[parameter.name], error.source, float(step[i]))
        covariance, white = covariance + np.outer(step, step), white + np.outer(step, step)
    return replace(result, covariance=covariance, covariance_white=white), shares
