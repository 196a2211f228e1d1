"""Identification of one or more flights: from signals to the result file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.compatibility.reconstruction import CompatibilityResult, Refusal, check_compatibility
from sysid.compatibility.selection import CLEAR_SHARE, LIMITS
from sysid.compatibility.wind import mean_wind
from sysid.equation_error.coefficients import body_of
from sysid.equation_error.dead_surfaces import frozen_commands
from sysid.errors import DivergedError, EstimationError, SysidError
from sysid.identification.equation_error import EquationEstimate, estimate_by_equations
from sysid.identification.moving_surfaces import with_surfaces_as_they_moved
from sysid.identification.output_or_filter_error import MaximumLikelihood, maximum_likelihood, with_error_sources
from sysid.identification.repaired_flight import FlightsRead, has_whole_imu, read_flights
from sysid.identification.repeatability import FEWEST, FlightScatter, by_posterior, scattered
from sysid.identification.request import Request
from sysid.identification.result_model import (
    MeanMotion,
    equation_model,
    mean_motion,
    refuse_unexcited,
    reported,
    unique_refusals,
    validity_of,
    with_sources,
)
from sysid.numerics.threads import single_threaded
from sysid.problem.coefficient_residuals import moment_noise
from sysid.problem.estimation_problem import Problem, Progress, free_coefficients, model_of, refusals, unbelieved
from sysid.problem.formulation import corrected_parts, known_before, make_problem, start_model, timing_of
from sysid.problem.model_structure import default_structure
from sysid.problem.vehicle_errors import is_stated
from sysid.quality.estimate_rules import SeenEstimate, with_estimate
from sysid.quality.flight_quality import NOTHING_SEEN, Quality
from sysid.quality.flight_rules import flights_quality
from sysid.signal_check.fault import Mistake
from sysid.signals.flight import FlightSignals, moved_controls, standing_controls
from sysid.signals.preparation import MAX_STRETCH_S, Prepared, require_thrust, unmeasured_thrust
from sysid.signals.record import SURFACES, has_positions
from sysid.signals.sensor_errors import SENSOR_ERRORS
from sysid.uncertainty.bench_errors import bench_errors, is_of_surfaces
from sysid.uncertainty.reconstruction_errors import held_errors
from sysid.uncertainty.travel import travel_shares
from sysid.validation.held_out import comparison, validation_of
from sysid.validation.residual_series import ModelComparison
from sysid.validation.statistics import Validation

if TYPE_CHECKING:
    from sysid.posterior.estimates import PosteriorEstimate

# Standard errors beyond which a sensor error by output error is not the one by kinematics.
_PULLED = 4.0
# Share of an axis' coefficient that the structure does not hold, from which on output error is not believed: 0.004
# where hardly anything is missing, 0.04 to 0.09 with aircraft of tables.
_MISFIT = 0.02
METHODS = ("auto", "map", "ee", "oe", "fe")


@dataclass(frozen=True)
class Identification:
    """Everything an identification found. See `result_json` for the file.

    mean: the model about the flights' mean airspeed. compared: the model and the flights that
    it is judged by, or where there are none those that it comes from. posterior: what `map` estimated beside. quality:
    what all of it is worth. flown: the flights with their surfaces as they moved, where the method estimates that.
    repeatability: coefficient -> what each of several flights says of it by itself.
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
    mean: MeanMotion
    warnings: tuple[str, ...]
    mistakes: tuple[Mistake, ...] = ()
    compared: ModelComparison | None = None
    posterior: PosteriorEstimate | None = None
    quality: Quality = NOTHING_SEEN
    flown: tuple[Prepared, ...] = ()
    repeatability: Mapping[str, FlightScatter] = field(default_factory=dict)


@single_threaded
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
    as_recorded: Sequence[str] = (),
) -> Identification:
    """Identify a model.

    flights: one or more, estimated together. validate_on: flights the model is judged by. structure: a model whose
    coefficients (values ignored) and effects (kept) are the structure; None takes the linear one. prior: what is known
    before the flight, with its correlations (sysid.numerics.gaussian); start values alone where it has none.
    method: "map" output error with an estimated noise spectrum and priors, "ee" equation error, "oe" output error, "fe"
    filter error. "auto" is "oe" where that leaves nothing but white noise, as in flights of the textbooks, for its bars
    are narrower there; "map" everywhere else, and "fe" where the free motion of the aircraft diverges. Where sensors
    are given "auto" is "oe": the other knows none of them.
    start_s, stop_s: the part to take, s.
    sensors: sensor errors to estimate (names of SENSOR_ERRORS); None takes those that the flight identifies.
    as_recorded: signals that are taken as they are, whatever seems ("ax", ...).
    systematic: whether to say what errors of the vehicle file would do, which takes longer than the estimate.
    Raises SysidError subclasses in one line.
    """
    if method not in METHODS:
        raise EstimationError(f"unknown method {method!r}; known are {', '.join(METHODS)}")
    asked = Request(
        tuple(flights), vehicle, tuple(validate_on), structure, prior, start_s, stop_s,
        None if sensors is None else tuple(sensors), systematic, tuple(as_recorded), progress,
    )  # fmt: skip
    progress(0.05, "units, signs and axes")
    read = read_flights(flights, validate_on, vehicle, as_recorded, start_s, stop_s)
    asked = replace(asked, vehicle=read.doubted(vehicle))
    if method == "map":
        found = _by_posterior(asked, read)
    elif method != "auto":
        found = _identify_by_classical_method(asked, method, read)
    elif sensors is None:
        found = _choose_method(asked, read)
    else:
        found = _identify_by_classical_method(asked, "oe", read)
    if found.posterior is None and len(read.fitted) >= FEWEST:
        progress(0.95, "each flight by itself")
        found = replace(found, repeatability=_each_by_itself(asked, found, read))
    known = {name for name, entry in found.model.coefficients.items() if entry.value is not None}
    found = replace(found, repeatability={name: one for name, one in found.repeatability.items() if name in known})
    progress(1.0, "done")
    return found


def _each_by_itself(asked: Request, found: Identification, read: FlightsRead) -> dict[str, FlightScatter]:
    """What each flight says with the same classical method; of those that it can be used for alone."""
    quiet = replace(asked, prior=None, systematic=False, progress=lambda share, text: None)
    method = "ee" if found.likeliest is None else found.likeliest.method
    each = {}
    for one in read.fitted:
        with suppress(SysidError, ArithmeticError, ValueError):
            part = replace(read, fitted=[one], judges=(), left_out=())
            alone = _identify_by_classical_method(quiet, method, part, any_aircraft=True)
            entries = alone.model.coefficients.items()
            each[one.signals.name] = {name: (e.value, e.std) for name, e in entries if e.value is not None and e.std}
    return scattered(each)


def _choose_method(asked: Request, read: FlightsRead) -> Identification:
    """`identify` with the method that the flight asks for."""
    from sysid.identification.posterior_method import reconstructed  # slow to import

    compatible = reconstructed(read.fitted)
    # Where kinematics see calm air and one motion, the flight may be as the textbooks have them.
    calm = compatible is not None and compatible.compatible and compatible.gust_sigma == 0.0
    found = _output_error_if_white(asked.within(0.1, 0.4), read, compatible) if calm else None
    if found is not None:
        return found
    try:
        return _by_posterior(asked.within(0.4 if calm else 0.1, 0.8), read, compatible)
    except DivergedError as error:
        books = _identify_by_classical_method(asked.within(0.8, 1.0), "fe", read)
        return replace(books, warnings=(f"{error}; estimated by filter error", *books.warnings))


def _output_error_if_white(
    asked: Request, read: FlightsRead, compatible: CompatibilityResult | None
) -> Identification | None:
    """The estimate by output error; None where it cannot be made, or leaves more than white noise of the sensors."""
    from sysid.posterior.stated_priors import moving_mass_known  # slow to import

    # Only the other method's bars hold what the vehicle file says of its own errors, and what it leaves open.
    if asked.vehicle.mass.doubted:
        return None
    if not moving_mass_known(asked.vehicle) and any("thrust" in one.signals.signals for one in read.fitted):
        return None
    if any(
        one.doubt or one.airspeed_std or one.prepared.thrust_source.missing or not has_whole_imu(one.signals)
        for one in read.fitted
    ):
        return None
    try:
        books = _identify_by_classical_method(asked, "oe", read, compatible)
    except SysidError:
        return None
    likeliest = books.likeliest
    if likeliest is None or likeliest.left_over or not likeliest.whole_bars or _pulled(books):
        return None
    # What its structure does not hold, sensor errors and coefficients make up for together.
    if likeliest.wider is not None and likeliest.wider.share > _MISFIT:
        return None
    # A sideslip by kinematics may be worth nothing where a simulated one is.
    if any(reason.no_numbers for reason in books.quality.reasons):
        return None
    # Where surfaces were between samples is an estimate, a millisecond of which is more than these bars hold.
    if not has_positions(asked.vehicle) and any(one.record.joined for one in books.flights[0].stretches):
        return None
    return books


def _pulled(books: Identification) -> bool:
    """Whether a sensor error is not what kinematics alone estimate: the motion's model then makes up for aerodynamics
    that its structure does not hold.
    """
    known = books.compatibility.parameters
    return any(
        abs(value - known[name].value) > _PULLED * math.hypot(std, known[name].std)
        for name, (value, std, _) in books.sensor_errors.items()
        if name in known
    )


def _identify_by_classical_method(
    asked: Request,
    method: str,
    read: FlightsRead,
    known: CompatibilityResult | None = None,
    any_aircraft: bool = False,
) -> Identification:
    """`identify` with equation error, output error or filter error. known: the flights' data compatibility.

    any_aircraft: see `reported`.
    """
    read.require_airspeed()
    given = read
    read, prepared = given.as_measured(asked.vehicle, asked.start_s, asked.stop_s)
    require_thrust(prepared)
    asked.progress(0.10, "data compatibility")
    same = read.fitted == given.fitted and all(one.whole for one in read.fitted)
    compatible = known if known is not None and same else check_compatibility(prepared)
    span = (asked.start_s, asked.stop_s)
    if (moving := with_surfaces_as_they_moved(read, asked.vehicle, span, prepared, compatible)) is not None:
        prepared, compatible, asked = moving.prepared, moving.compatible, replace(asked, vehicle=moving.vehicle)
    vehicle, progress = asked.vehicle, asked.progress
    posed = _pose(asked, prepared, compatible)
    found = _by_equations(posed) if method == "ee" else _by_likelihood(posed, _likeliest(posed, method))
    worth = flights_quality([one.signals for one in read.fitted], prepared, vehicle, compatible.gust_sigma, False)
    model, refused, worth = reported(found.model, found.refused, worth, is_of_surfaces, asked.prior, any_aircraft)
    found = replace(found, model=model, refused=refused)
    mistakes = read.mistakes()
    sentences = [one.sentence for one in mistakes]
    progress(0.88, "validation" if asked.validate_on else "comparison with the measurement")
    judges = [one.as_measured(vehicle, anew=moving is not None) for one in read.judges]
    compared = comparison(judges or prepared, vehicle, found.model, found.errors, posed.problem.command_first)
    validation = validation_of(compared) if judges else None
    likeliest = found.likeliest
    left_over = "" if likeliest is None else likeliest.left_over
    misfit = "" if likeliest is None or likeliest.wider is None else likeliest.wider.warning()
    seen = SeenEstimate(found.model, found.refused, validation, {}, misfit, left_over, sentences)
    return Identification(
        tuple(prepared), compatible, found.model, found.errors,
        unique_refusals((*found.refused, *compatible.refused), found.errors), validation,
        tuple(flight.name for flight in asked.validate_on), found.likeliest, found.equations,
        mean_motion(vehicle, found.model, prepared, compatible),
        tuple(dict.fromkeys((*posed.warnings, *found.warnings, *sentences, *read.warnings()))), mistakes,
        compared, None, with_estimate(worth, seen),
    )  # fmt: skip


def _by_posterior(asked: Request, read: FlightsRead, known: CompatibilityResult | None = None) -> Identification:
    """`identify` with the method "map". known: the flights' data compatibility, if at hand."""
    from sysid.identification.posterior_method import identify_by_posterior  # slow to import
    from sysid.posterior.estimates import UNINFORMED_RATIO
    from sysid.posterior.nuisance_priors import THRUST_BY_SPEED_STD
    from sysid.posterior.stated_priors import as_estimated
    from sysid.validation.servo_replay import with_estimated_deflections

    vehicle, progress = asked.vehicle, asked.progress
    found = identify_by_posterior(read.fitted, asked, known)
    worth = flights_quality(found.signals, found.prepared, vehicle, found.compatible.gust_sigma, True)
    model, refused, worth = reported(found.model, found.refused, worth, is_stated, asked.prior)
    found = replace(found, model=model, refused=tuple(refused))
    # Kinematics determine zeros and gains in air without gusts alone, with sensors as the textbooks have them; the
    # estimate has its own.
    scale = found.estimate.airspeed_scale()
    errors = {
        **found.estimate.sensor_errors(UNINFORMED_RATIO),
        **found.estimate.attitude_errors(UNINFORMED_RATIO),
        **mean_wind(found.prepared, scale),
    }
    mistakes = read.mistakes()
    sentences = [one.sentence for one in mistakes]
    warnings = [*sentences, *found.warnings, *unmeasured_thrust(found.prepared, THRUST_BY_SPEED_STD)]
    progress(0.88, "validation" if asked.validate_on else "comparison with the measurement")
    judges = [one.prepared for one in read.judges]
    # What the kinematics say of sensors is not what this estimate takes them for.
    flown = with_estimated_deflections(found.prepared, found.signals, vehicle, found.estimate)
    flights = (
        with_estimated_deflections(judges, [one.signals for one in read.judges], vehicle, found.estimate)
        if judges
        else flown
    )
    vehicle = as_estimated(vehicle, found.estimate.of_aircraft())
    compared = comparison(flights, vehicle, found.model, found.estimate.sensor_errors(), timing_of(flights, False))
    validation = validation_of(compared) if judges else None
    groups = found.estimate.results.items()
    seen = SeenEstimate(
        found.model, found.refused, validation, {group: one.feedback for group, one in groups}, "", "", sentences
    )
    return Identification(
        found.prepared, found.compatible, found.model, errors,
        unique_refusals((*found.refused, *found.compatible.refused), errors), validation,
        tuple(flight.name for flight in asked.validate_on), None, None,
        mean_motion(
            vehicle, found.model, found.prepared, found.compatible,
            None if scale is None else 1.0 - scale[0],
        ),
        tuple(dict.fromkeys((*warnings, *read.warnings()))), mistakes, compared, found.estimate,
        with_estimate(worth, seen), tuple(flown), by_posterior(found.estimate),
    )  # fmt: skip


@dataclass(frozen=True)
class _ClassicalProblem:
    """Prepared flights with the problem to solve.

    start: start values. names: coefficients that the flight moves. refused: those it does not. dead: surfaces that
    were not recorded, and what was reported of them.
    """

    asked: Request
    prepared: Sequence[Prepared]
    compatible: CompatibilityResult
    problem: Problem
    start: Model
    names: list[str]
    refused: list[Refusal]
    warnings: list[str]
    dead: Mapping[str, str]


@dataclass(frozen=True)
class _ClassicalResult:
    """What an estimation found. errors: value, standard error and unit of every sensor error."""

    model: Model
    errors: Mapping[str, tuple[float, float, str]]
    refused: list[Refusal]
    warnings: Sequence[str]
    likeliest: MaximumLikelihood | None = None
    equations: EquationEstimate | None = None


def _pose(asked: Request, prepared: Sequence[Prepared], compatible: CompatibilityResult) -> _ClassicalProblem:
    vehicle, progress, structure = asked.vehicle, asked.progress, asked.structure
    warnings = [w for flight in prepared for w in flight.warnings] + list(compatible.warnings)
    warnings += unmeasured_thrust(prepared)
    # In rough air velocity over ground holds the gusts too, which the estimate in still air does not know.
    calm = compatible.gust_sigma == 0.0
    surfaces = [name for name in SURFACES if any(name in flight.data for flight in prepared)]
    settings = [flight.data.columns for flight in prepared]
    named = moved_controls(vehicle.named_controls, settings)
    warnings += standing_controls(vehicle.named_controls, settings)
    if structure is None:
        structure = Model(vehicle.name, {name: Coefficient(0.0) for name in default_structure(surfaces, named)})
    dead: dict[str, str] = {}
    if calm:
        noise = [moment_noise(stretch.record, vehicle) for flight in prepared for stretch in flight.stretches]
        dead = frozen_commands(corrected_parts(prepared, vehicle, compatible), body_of(vehicle), noise, surfaces)
        warnings += dead.values()
    ground = calm and asked.sensors is None
    problem = make_problem(prepared, vehicle, compatible, asked.sensors, ground=ground, dead=dead)
    problem = replace(problem, known=known_before(asked.prior, structure, warnings))
    progress(0.30, "equation error")
    start = start_model(prepared, vehicle, compatible, structure, problem.motion, asked.prior)
    names = free_coefficients(list(structure.coefficients), problem.motion)
    carried = () if problem.known is None else problem.known.names
    refused = refuse_unexcited([name for name in structure.coefficients if name not in carried], names, list(dead))
    return _ClassicalProblem(asked, prepared, compatible, problem, start, names, refused, warnings, dead)


def _by_equations(posed: _ClassicalProblem) -> _ClassicalResult:
    problem, compatible = posed.problem, posed.compatible
    equations = estimate_by_equations(
        posed.prepared, posed.asked.vehicle, compatible, posed.names, problem.command_first > 0.0, problem.known,
        corrected_parts, posed.asked.systematic,
    )  # fmt: skip
    refused = [*posed.refused, *equations.refused]
    model = equation_model(posed.start, equations, refused, validity_of(posed.prepared, compatible))
    model = with_sources(model, equations.systematic)
    return _ClassicalResult(model, _kinematic_errors(compatible), refused, equations.warnings, equations=equations)


def _likeliest(posed: _ClassicalProblem, method: str) -> MaximumLikelihood:
    """The estimate by output error or filter error."""
    asked, compatible = posed.asked, posed.compatible
    progress = asked.within(0.4, 0.85).progress
    progress(0.0, "maximum likelihood")
    problem = posed.problem
    if method == "fe":
        # In longer runs: the filter follows what a free simulation would lose.
        longer = make_problem(posed.prepared, asked.vehicle, compatible, asked.sensors, MAX_STRETCH_S, dead=posed.dead)
        problem = replace(longer, known=problem.known)
    from_bench = bench_errors(posed.prepared, asked.vehicle)
    return maximum_likelihood(
        problem, posed.start, posed.names, _free_effects(posed), compatible,
        from_bench, held_errors(compatible, posed.problem), method, asked.sensors, progress,
    )  # fmt: skip


def _free_effects(posed: _ClassicalProblem) -> list[tuple[str, str]]:
    return [(e.name, key) for e in posed.start.effects for key, entry in e.parameters.items() if entry.std]


def _by_likelihood(posed: _ClassicalProblem, likeliest: MaximumLikelihood) -> _ClassicalResult:
    asked, compatible, start, names = posed.asked, posed.compatible, posed.start, posed.names
    free_effects = _free_effects(posed)
    problem, result = likeliest.problem, likeliest.estimate
    odd = unbelieved(result, names)
    unsure = refusals(
        result,
        [name for name in names if name not in {entry.name for entry in odd}],
        travel_shares(likeliest.from_bench),
    )
    refused = [*posed.refused, *odd, *unsure, *likeliest.refused]
    validity = validity_of(posed.prepared, compatible)
    model = model_of(start, asked.vehicle.name, result, names, free_effects, refused, validity, problem.known)
    if asked.systematic:
        asked.progress(0.85, "systematic errors")
    model = with_error_sources(likeliest, model, start, names, free_effects, asked.systematic)
    likeliest = replace(likeliest, linearised=None)  # its sensitivities are large, and have served
    unclear = {refusal.name for refusal in (*likeliest.refused, *compatible.refused)}
    errors = {name: error for name, error in _kinematic_errors(compatible).items() if name not in unclear}
    for name in problem.sensors:
        if name in unclear and result.std(name) > CLEAR_SHARE * LIMITS[name].std:
            continue
        errors[name] = (result.value(name), result.std(name), SENSOR_ERRORS[name][2])
    return _ClassicalResult(model, errors, refused, likeliest.warnings, likeliest)


def _kinematic_errors(compatible: CompatibilityResult) -> dict[str, tuple[float, float, str]]:
    return {name: (error.value, error.std, error.unit) for name, error in compatible.parameters.items()}
