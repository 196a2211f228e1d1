"""Identification of one or more flights: from signals to the result file."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sim_vehicle.errors import SimVehicleError
from sim_vehicle.model import Coefficient, Model
from sim_vehicle.parameters import flatten
from sim_vehicle.vehicle import Vehicle
from sysid.bench import bench_errors
from sysid.compatibility import CompatibilityResult, Refusal, correct
from sysid.delays import commands_std
from sysid.equation_error import equation_error
from sysid.equation_identify import EquationEstimate, estimate_by_equations
from sysid.errors import EstimationError, SysidError
from sysid.estimate import (
    MAX_RUN_S,
    Motion,
    Problem,
    excited_motion,
    free_coefficients,
    model_of,
    refusals,
    relevant_sensors,
    split_runs,
)
from sysid.flight import FlightData, FlightSignals
from sysid.frozen import frozen_commands
from sysid.gap import Fixed
from sysid.linear import LinearModel, linearise
from sysid.maximum_likelihood import MaximumLikelihood, maximum_likelihood
from sysid.maximum_likelihood import systematic as systematic_effects
from sysid.parameterisation import SENSOR_ERRORS
from sysid.prepare import MAX_STRETCH_S, Prepared, check_compatibility, prepare, unmeasured_thrust
from sysid.prior import Gaussian, known_from
from sysid.punctual import commands_in_time, refined_delays, with_late_commands
from sysid.records import SURFACES
from sysid.residuals import body_of, known_propulsion, moment_noise
from sysid.series import Comparison
from sysid.signalcheck import SignalCheck, check_signals, in_time
from sysid.smoothing import noise_sigma
from sysid.structure import default_structure, helpful_manoeuvre, usual_size
from sysid.timing import command_shows_at_once
from sysid.validation import Validation, validate

METHODS = ("auto", "ee", "oe", "fe")
Progress = Callable[[float, str], None]
# The air data scale is told by GPS in the compatibility check, which the output-error step does not see again.
_FROM_COMPATIBILITY = ("airspeed_scale", "airspeed_bias")


@dataclass(frozen=True)
class Identification:
    """Everything an identification found. See `result_json` for the file.

    linear: the model about the flight's mean airspeed, or why there is none. compared: the model and the flights that
    it is judged by, or where there are none those that it comes from.
    """

    flights: tuple[Prepared, ...]
    compatibility: CompatibilityResult
    model: Model
    sensor_errors: Mapping[str, tuple[float, float, str]]
    refused: tuple[Refusal, ...]
    validation: Validation | None
    validation_flights: tuple[str, ...]
    likeliest: MaximumLikelihood | None
    equation_error: EquationEstimate | None
    linear: LinearModel | str
    warnings: tuple[str, ...]
    check: SignalCheck = field(default_factory=SignalCheck)
    compared: Comparison | None = None


def make_problem(
    prepared: Sequence[Prepared],
    vehicle: Vehicle,
    compatible: CompatibilityResult,
    sensors: Sequence[str] | None = None,
    run_s: float = MAX_RUN_S,
    ground: bool = False,
) -> Problem:
    """Estimation problem of all stretches: runs, start states from the reconstruction, sensor errors to estimate.

    sensors: names to estimate; None takes those that the compatibility check can tell. run_s: longest free run, s.
    ground: whether velocity over ground, where measured, counts in a motion that is free in all axes though no vane is
    missing; else it counts for the air data alone, by what the compatibility check made of it.
    """
    stretches = [stretch for flight in prepared for stretch in flight.stretches]
    motion = excited_motion([stretch.record for stretch in stretches])
    if ground and motion.longitudinal and motion.lateral and "wind_north" in compatible.parameters:
        motion = replace(motion, ground=True)
    runs, paths = [], []
    for stretch, found in zip(stretches, compatible.states, strict=True):
        states = dict(found)
        psi = stretch.data.columns.get("psi")
        states.setdefault("psi", np.zeros(stretch.record.length) if psi is None else psi)
        part_runs, part_paths = split_runs(stretch.record, states, motion, run_s)
        runs += part_runs
        paths += part_paths
    known = compatible.parameters
    names = relevant_sensors(list(known) if sensors is None else sensors, motion)
    # The same readings must not count twice.
    told = () if motion.ground else _FROM_COMPATIBILITY
    priors = {n: (known[n].value, known[n].std) for n in names if n in known and n in told}
    start = {name: known[name].value if name in known else 0.0 for name in names}
    at_once = command_shows_at_once(
        corrected_parts(prepared, vehicle, compatible), body_of(vehicle), lateral=not motion.longitudinal
    )
    guesses = tuple(path[0].copy() for path in paths)
    return Problem(vehicle, tuple(runs), guesses, motion, start, priors, at_once, paths=tuple(paths))


def corrected_parts(
    prepared: Sequence[Prepared], vehicle: Vehicle, compatible: CompatibilityResult
) -> list[FlightData]:
    """Stretches with sensor errors taken off and thrust known, for equation error."""
    parts = []
    flat = flatten(vehicle, Model(vehicle.name, {}))
    errors = {name: error.value for name, error in compatible.parameters.items()}
    index = 0
    for flight in prepared:
        for stretch in flight.stretches:
            record = stretch.record
            data = correct(stretch.data, compatible, index)
            here = slice(record.start, record.start + record.length)
            thrust, torque = known_propulsion(record, Fixed(flat, errors), data["V"])
            columns = {**data.columns, "thrust": thrust, "torque": torque, "air_density": record.rho[here]}
            columns |= {name: record.commands[here, j] for j, name in enumerate((*SURFACES, "throttle"))}
            columns.setdefault("beta", np.zeros(record.length))
            parts.append(replace(data, columns=columns))
            index += 1
    return parts


def start_model(
    prepared: Sequence[Prepared],
    vehicle: Vehicle,
    compatible: CompatibilityResult,
    structure: Model,
    motion: Motion,
    prior: Model | None,
) -> Model:
    """Start values: equation error, a prior model where that fails, the usual size of nothing elsewhere."""
    values = dict.fromkeys(structure.coefficients, 0.0)
    stds: dict[str, float] = dict.fromkeys(structure.coefficients, math.inf)
    if prior is not None:
        values |= {name: value for name, value in prior.values().items() if name in values}
    names = free_coefficients(list(structure.coefficients), motion)
    try:
        for axis in equation_error(corrected_parts(prepared, vehicle, compatible), body_of(vehicle), names).values():
            for name, value, std in zip(axis.names, axis.values, axis.std, strict=True):
                # An estimate worse than knowing nothing is a bad start.
                if std < 2.0 * usual_size(name):
                    values[name], stds[name] = float(value), float(std)
    except SysidError:
        if prior is None:
            raise
    entries = {
        name: Coefficient(value, stds[name] if math.isfinite(stds[name]) else None) for name, value in values.items()
    }
    return replace(structure, coefficients=entries, correlation=None)


def identify(
    flights: Sequence[FlightSignals],
    vehicle: Vehicle,
    *,
    validate_on: Sequence[FlightSignals] = (),
    structure: Model | None = None,
    prior: Model | None = None,
    method: str = "auto",
    start_s: float | None = None,
    stop_s: float | None = None,
    sensors: Sequence[str] | None = None,
    systematic: bool = True,
    progress: Progress = lambda share, text: None,
    check: SignalCheck | None = None,
    delays: bool = True,
) -> Identification:
    """Identify a model.

    flights: one or more, estimated together. validate_on: flights the model is judged by. structure: a model whose
    coefficients (values ignored) and effects (kept) are the structure; None takes the linear one. prior: what is known
    before the flight, with its correlations (sysid.prior); start values alone where it has none.
    method: "ee" equation error, "oe" output error, "fe" filter error; "auto" is "oe", and "fe" in turbulence.
    start_s, stop_s: the part to take, s.
    sensors: sensor errors to estimate (names of SENSOR_ERRORS); None lets the flight decide.
    check: what is known of mistakes in the signals already; None looks for them.
    delays: whether those that the whole motion tells (sysid.delaychoice) are looked for.
    systematic: whether to say what errors of the vehicle file would do, which takes longer than the estimate.
    Raises SysidError subclasses in one line.
    """
    if method not in METHODS:
        raise EstimationError(f"unknown method {method!r}; known are {', '.join(METHODS)}")
    progress(0.02, "signals on one time base")
    prepared = [prepare(flight, vehicle, start_s, stop_s) for flight in flights]
    if check is None:
        progress(0.05, "units, signs, axes and delays")
        check = check_signals(prepared, vehicle)
    prepared = in_time(prepared, vehicle, check)
    progress(0.10, "data compatibility")
    compatible = check_compatibility(prepared)
    warnings = [w for flight in prepared for w in flight.warnings] + list(compatible.warnings)
    warnings += unmeasured_thrust(prepared)
    # In rough air velocity over ground holds the gusts too, which the estimate in still air does not know.
    calm = compatible.gust_sigma == 0.0
    surfaces = [name for name in SURFACES if any(name in flight.data for flight in prepared)]
    if structure is None:
        structure = Model(vehicle.name, {name: Coefficient(0.0) for name in default_structure(surfaces)})
    late: dict[str, float] = {}
    parts, told = corrected_parts(prepared, vehicle, compatible), tuple(structure.coefficients)
    if calm:
        noise = [moment_noise(stretch.record, vehicle) for flight in prepared for stretch in flight.stretches]
        warnings += frozen_commands(parts, body_of(vehicle), noise)
    if delays and structure.effect("actuator_delay") is None:
        prepared, check, late = commands_in_time(prepared, vehicle, check, parts, told, method, calm)
    problem = make_problem(prepared, vehicle, compatible, sensors, ground=calm and sensors is None)
    problem = replace(problem, known=_known(prior, structure, warnings), delays=late)
    progress(0.30, "equation error")
    start = start_model(prepared, vehicle, compatible, structure, problem.motion, prior)
    late_start = None
    if late and not calm:
        tried = with_late_commands(prepared, vehicle, late)
        late_start = start_model(tried, vehicle, compatible, structure, problem.motion, prior)
    names = free_coefficients(list(structure.coefficients), problem.motion)
    likeliest: MaximumLikelihood | None = None
    errors = {name: (e.value, e.std, e.unit) for name, e in compatible.parameters.items()}
    carried = () if problem.known is None else problem.known.names
    quiet = _quiet([name for name in structure.coefficients if name not in carried], names)
    equations: EquationEstimate | None = None
    if method == "ee":
        equations = estimate_by_equations(
            prepared, vehicle, compatible, names, problem.command_first, problem.known, corrected_parts, systematic,
            commands_std(check.delays),
        )  # fmt: skip
        warnings += equations.warnings
        refused = [*quiet, *equations.refused]
        model = _equation_model(start, equations, refused, _validity(prepared, compatible))
        model = _with_extra(model, "systematic", equations.systematic)
    else:
        progress(0.40, "maximum likelihood")
        free_effects = [(e.name, key) for e in start.effects for key, entry in e.parameters.items() if entry.std]
        turbulent = replace(make_problem(prepared, vehicle, compatible, sensors, MAX_STRETCH_S), known=problem.known)
        likeliest = maximum_likelihood(
            problem, turbulent, start, names, free_effects, compatible, bench_errors(prepared, vehicle),
            delays=check.delays if delays else None, late_model=late_start, method=method, sensors=sensors,
            progress=lambda s, t: progress(0.4 + 0.45 * s, t),
        )  # fmt: skip
        problem, result = likeliest.problem, likeliest.estimate
        prepared, check = refined_delays(prepared, vehicle, check, likeliest.delays)
        warnings += likeliest.warnings
        refused = [*quiet, *refusals(result, names), *likeliest.refused]
        validity = _validity(prepared, compatible)
        model = model_of(start, vehicle.name, result, names, free_effects, refused, validity, problem.known)
        model = _with_extra(model, "bench", likeliest.from_bench)
        if systematic:
            progress(0.85, "systematic errors")
            moved = systematic_effects(likeliest, start, names, free_effects)
            model = _with_extra(model, "systematic", moved)
        errors = {name: error for name, error in errors.items() if name not in {r.name for r in likeliest.refused}}
        for name in problem.sensors:
            errors[name] = (result.value(name), result.std(name), SENSOR_ERRORS[name][2])
    warnings += [one.sentence for one in check.findings()]
    progress(0.88, "validation")
    judges = [_judge(flight, vehicle, check, warnings) for flight in validate_on]
    compared = _comparison(judges or prepared, vehicle, model, errors, problem.command_first)
    validation = _validate(compared) if judges else None
    progress(1.0, "done")
    return Identification(
        tuple(prepared), compatible, model, errors, _once((*refused, *compatible.refused), errors), validation,
        tuple(flight.name for flight in validate_on), likeliest, equations,
        _linear(vehicle, model, prepared, compatible, likeliest), tuple(dict.fromkeys(warnings)), check,
        compared,
    )  # fmt: skip


def _once(refused: Sequence[Refusal], told: Mapping[str, object]) -> tuple[Refusal, ...]:
    """Every refusal once, and none of what another method could tell after all."""
    return tuple({entry.name: entry for entry in reversed(refused) if entry.name not in told}.values())[::-1]


def _known(prior: Model | None, structure: Model, warnings: list[str]) -> Gaussian | None:
    """What a prior model tells of the coefficients and effects of the structure."""
    if prior is None:
        return None
    known, warning = known_from(prior)
    if warning:
        warnings.append(warning)
    if known is None:
        return None
    effects = [f"{effect.name}.{key}" for effect in structure.effects for key in effect.parameters]
    names = [*structure.coefficients, *effects]
    strange = [name for name in known.names if name not in names]
    if strange:
        warnings.append(f"the prior's {', '.join(strange)} is no part of the structure and is left out")
    return known.of(names)


def _linear(
    vehicle: Vehicle,
    model: Model,
    prepared: Sequence[Prepared],
    compatible: CompatibilityResult,
    likeliest: MaximumLikelihood | None,
) -> LinearModel | str:
    """The model about the flights' mean airspeed and density, or in words why it cannot be had."""
    airspeed = float(np.mean(np.concatenate([states["V"] for states in compatible.states])))
    stretches = [stretch for flight in prepared for stretch in flight.stretches]
    density = float(np.mean(np.concatenate([stretch.record.rho for stretch in stretches])))
    covariance = None
    if likeliest is not None:
        result = likeliest.estimate
        names = [parameter.name for parameter in result.parameters]
        covariance = (names, result.covariance[: len(names), : len(names)])
    try:
        return linearise(vehicle, model, airspeed, density, covariance)
    except SimVehicleError as error:
        return str(error)


def _with_extra(model: Model, key: str, found: Mapping[str, Mapping[str, float]]) -> Model:
    """The model with something told beside each estimate under `key`."""

    def beside(name: str, entry: Coefficient) -> Coefficient:
        if entry.value is None or not found.get(name):
            return entry
        return replace(entry, extra={**entry.extra, key: dict(found[name])})

    effects = tuple(
        replace(e, parameters={key: beside(f"{e.name}.{key}", entry) for key, entry in e.parameters.items()})
        for e in model.effects
    )
    entries = {name: beside(name, entry) for name, entry in model.coefficients.items()}
    return replace(model, coefficients=entries, effects=effects)


def _quiet(structure: Sequence[str], names: Sequence[str]) -> list[Refusal]:
    return [
        Refusal(name, "the surfaces that would excite it did not move", helpful_manoeuvre(name))
        for name in structure
        if name not in names
    ]


def _equation_model(
    start: Model, found: EquationEstimate, refused: Sequence[Refusal], validity: Mapping[str, tuple[float, float]]
) -> Model:
    reasons = {entry.name: entry.reason for entry in refused}
    joint = found.joint.of([name for name in found.joint.names if name not in reasons])
    told = {} if joint is None else joint.entries()
    entries = {
        name: Coefficient(None, refused=reasons[name])
        if name in reasons
        else Coefficient(*told[name])
        if name in told
        else entry
        for name, entry in start.coefficients.items()
    }
    correlation = None if joint is None else joint.correlation()
    return replace(start, coefficients=entries, validity=validity, correlation=correlation)


def _validity(prepared: Sequence[Prepared], compatible: CompatibilityResult) -> dict[str, tuple[float, float]]:
    """Range of angle of attack and airspeed that the stretches covered (1st to 99th percentile)."""
    alpha = np.concatenate([states["alpha"] for states in compatible.states])
    speed = np.concatenate([states["V"] for states in compatible.states])
    return {
        "alpha": (round(float(np.percentile(alpha, 1)), 4), round(float(np.percentile(alpha, 99)), 4)),
        "airspeed": (round(float(np.percentile(speed, 1)), 2), round(float(np.percentile(speed, 99)), 2)),
    }


def _judge(signals: FlightSignals, vehicle: Vehicle, check: SignalCheck, warnings: list[str]) -> Prepared:
    """A flight to judge the model by, in time, its mistakes told."""
    flight = prepare(signals, vehicle)
    warnings += [*flight.warnings, *(one.sentence for one in check_signals([flight], vehicle).mistakes)]
    return in_time([flight], vehicle, check)[0]


def _comparison(
    flights: Sequence[Prepared],
    vehicle: Vehicle,
    model: Model,
    errors: Mapping[str, tuple[float, float, str]],
    command_first: bool,
) -> Comparison:
    """Flights beside the model, refused coefficients counting as zero, effects with refused parameters as absent."""
    told = {name: entry for name, entry in model.coefficients.items() if entry.value is not None}
    known = replace(model, coefficients=told, effects=tuple(e for e in model.effects if not e.refused()))
    axes = sorted({name.partition("_")[0] for name in known.coefficients})
    values = {name: value for name, (value, _, _) in errors.items()}
    return Comparison(tuple(flights), vehicle, Fixed(flatten(vehicle, known), values, command_first), tuple(axes))


def _validate(compared: Comparison) -> Validation:
    """Coefficients measured on other flights against the model's."""
    paths = [path for flight in compared.paths for path in flight]
    z = {axis: np.concatenate([path.measured[axis] for path in paths]) for axis in compared.axes}
    y = {axis: np.concatenate([path.predicted[axis] for path in paths]) for axis in compared.axes}
    noise = {a: noise_sigma(z[a], compared.flights[-1].data.interval_s) for a in z if a in ("CL", "CD", "CY")}
    stretches = [stretch for flight in compared.flights for stretch in flight.stretches]
    moments = [moment_noise(stretch.record, compared.vehicle) for stretch in stretches]
    return validate(z, y, noise | {a: float(np.median([m[a] for m in moments])) for a in ("Cl", "Cm", "Cn") if a in z})
