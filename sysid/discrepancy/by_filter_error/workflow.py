"""The comparison by filter error: flights of the textbooks, calm or in gusts of a known shape.

The model's own parameters are fitted again first. Then every effect of the catalogue that the flights could show is
looked at (score test), the promising ones are added in turn and everything is fitted once more (generalised likelihood
ratio); a regression on what is left over would see only the few per cent that the nominal parameters have not already
absorbed. In calm air too: a model that lacks something still follows the flight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

from sim_vehicle.effects.sensor import AIRSPEED_ERROR
from sim_vehicle.model.model_file import Model
from sysid.compatibility.reconstruction import CompatibilityResult, check_compatibility
from sysid.discrepancy.by_filter_error.baseline import (
    BENCH,
    Baseline,
    Flights,
    fitted_again,
    is_beyond_bench,
    posed,
    sensors_alone,
    timed,
    without_bench,
)
from sysid.discrepancy.by_filter_error.candidate_fits import fitted
from sysid.discrepancy.by_filter_error.forward_selection import (
    Search,
    eliminate_insignificant,
    eliminate_redundant,
    extend,
    refit_jointly,
    settle_names,
    update_estimate,
)
from sysid.discrepancy.by_filter_error.verdict import found_model, is_rough, refitted_model, verdict_of
from sysid.discrepancy.comparison_types import MAX_EFFECTS, Asked, Compared, Outcome, Progress
from sysid.discrepancy.gap import fixed_model
from sysid.discrepancy.identified_effect import Named
from sysid.errors import EstimationError, SysidError
from sysid.filter_error.estimation import build_filter
from sysid.filter_error.estimator import FilterErrorResult
from sysid.identification.moving_surfaces import with_surfaces_as_they_moved
from sysid.identification.output_or_filter_error import MaximumLikelihood, with_error_sources
from sysid.identification.repaired_flight import FlightsRead
from sysid.numerics.dryden import Turbulence
from sysid.output_error.from_problem import fit
from sysid.problem.estimation_problem import Estimates, Problem, model_of
from sysid.quality.flight_rules import flights_quality
from sysid.signals.preparation import Prepared, require_thrust
from sysid.uncertainty.bench_errors import bench_errors, carry_filtered, is_of_surfaces
from sysid.uncertainty.total import with_total_errors


def compare(asked: Asked, read: FlightsRead, proposed: Sequence[Named] = ()) -> Outcome:
    """What the flights say of the model. read: the flights as their sensors meant them. proposed: effects that were
    found elsewhere, which the search tries beside what it finds promising itself.

    Raises SysidError subclasses in one line.
    """
    progress, vehicle, model = asked.progress, asked.vehicle, asked.model
    read.require_airspeed()
    read, prepared = read.as_measured(vehicle, asked.start_s, asked.stop_s)
    progress(0.08, "data compatibility")
    compatible, span = check_compatibility(prepared), (asked.start_s, asked.stop_s)
    worth = flights_quality([one.signals for one in read.fitted], prepared, vehicle, compatible.gust_sigma, False)
    for one in worth.not_flown:
        if one.no_numbers:
            raise EstimationError(f"{one.sentence}; use --method map, which leaves these axes out")
    moving = with_surfaces_as_they_moved(read, vehicle, span, prepared, compatible)
    if moving is not None:
        prepared, compatible, vehicle = moving.prepared, moving.compatible, moving.vehicle
    held_out = [one.as_measured(vehicle, anew=moving is not None) for one in read.judges]
    require_thrust([*prepared, *held_out])
    used = Flights(prepared, compatible, vehicle, progress)
    base = fitted_again(used, model, asked.ruled_out)
    search = _searched(used, base, proposed)
    settle_names(search)
    verdict = verdict_of(used, base, search)
    if verdict.name == "unexplained" and search.named:
        # A wrong name is worse than none.
        search = _without(base)
    stages = {
        "given": fixed_model(base.problem, model, base.given, used.compatible),
        "before": refitted_model(used, base),
    }
    stages["after"] = found_model(used, search) if search.result is not base.before else stages["before"]
    progress(0.74, "standard errors")
    whole, lacking = search.model, list[str]()
    try:
        whole = _with_whole_errors(used, search)
    except SysidError as error:
        lacking = [f"errors of what was taken as known could not be estimated: {error}"]
    air = search.result.turbulence
    judged = None
    if held_out:
        progress(0.75, "sensor errors of the other flights")
        models = {"given": model, "before": base.refitted, "after": search.model}
        judged = _held_out(held_out, search.problem, models)
    return Outcome(
        "fe", verdict, tuple(search.named), whole, base.ruled_out,
        Compared(tuple(prepared), base.problem.motion, stages, used.compatible, air), judged,
        max(air.horizontal, air.vertical),
        worth,
        (
            *(w for one in prepared for w in one.warnings), *(one.sentence for one in read.mistakes()),
            *read.warnings(), *lacking,
        ),
    )  # fmt: skip


def _part_of(progress: Progress, begin: float, width: float, share: float, text: str) -> None:
    progress(begin + width * share, text)


def _without(base: Baseline) -> Search:
    return Search(
        base.problem, base.refitted, list(base.names), list(base.effects), base.before, base.before.cost,
        given=base.own_values, ruled_out=base.ruled_out,
    )  # fmt: skip


def _searched(used: Flights, base: Baseline, proposed: Sequence[Named]) -> Search:
    """Effects added one after the other until nothing is left. proposed: what else to try first."""
    search = replace(_without(base), proposed=proposed)
    while len(search.named) < MAX_EFFECTS:
        begin, width = 0.3 + 0.4 * len(search.named) / MAX_EFFECTS, 0.4 / MAX_EFFECTS
        if not extend(search, partial(_part_of, used.progress, begin, width)):
            break
        _with_bench(used, search)
        _with_timing(search)
    eliminate_redundant(search)
    if search.named and is_rough(search.result):
        used.progress(0.72, "standard errors in turbulence")
        if not search.result.together:
            refit_jointly(search)
        eliminate_insignificant(search)
        if not search.named:
            return replace(_without(base), dropped=search.dropped)
    return search


def _with_bench(used: Flights, search: Search) -> None:
    """Estimate what a bench leaves of the airspeed's error again, where the model now explains the flight with that."""
    problem = replace(posed(used.prepared, used.vehicle, used.compatible), command_first=search.problem.command_first)
    last = search.named[-1].effect
    if problem.sensors.keys() == search.problem.sensors.keys() or last == AIRSPEED_ERROR.name:
        return
    known = search.result
    flight = build_filter(problem, search.model, search.coefficients, search.effects)
    with suppress(EstimationError):
        result = flight.solve(known.values(), known.turbulence, known=known)
        if not is_beyond_bench(result, problem):
            search.problem = problem
            update_estimate(search, result)


def _with_timing(search: Search) -> None:
    """Choose the timing of the commands again: what was missing may have made the other one the likelier."""
    problem, result = timed(search.problem, search.model, search.coefficients, search.effects, search.result)
    if problem is not search.problem:
        search.problem = problem
        update_estimate(search, result)


def _with_whole_errors(used: Flights, search: Search) -> Model:
    """The model that was found with its whole errors, of the flights and of what was taken as known."""
    problem, free = search.problem, (search.coefficients, search.effects)
    bench = bench_errors(used.prepared, used.vehicle)
    result, shares = carry_filtered(bench, problem, search.model, *free, search.result)
    likeliest = MaximumLikelihood(problem, result, "fe", (), (), shares)
    model = model_of(search.model, search.model.name, result, *free, (), search.model.validity)
    return with_total_errors(with_error_sources(likeliest, model, search.model, *free), is_of_surfaces)


def _held_out(held_out: Sequence[Prepared], problem: Problem, models: Mapping[str, Model]) -> Compared:
    """On flights held out sensor errors alone are fitted for each stage: they change with every power-up."""
    checked = check_compatibility(held_out)
    other = replace(posed(held_out, problem.vehicle, checked), command_first=problem.command_first)
    other = other if set(BENCH) & set(problem.sensors) else without_bench(other)
    best = _own_errors(other, models["after"], checked)
    stages = {}
    for name, model in models.items():
        own = best
        if name != "after" and isinstance(best, FilterErrorResult):
            own = sensors_alone(other, model, best)
        stages[name] = fixed_model(other, model, own, checked)
    # Kinematics alone mistake what an effect does to a vane for gusts; the model that has it knows better.
    air = Turbulence(checked.gust_sigma, checked.gust_sigma)
    if isinstance(best, FilterErrorResult):
        air = best.turbulence
    return Compared(tuple(held_out), other.motion, stages, checked, air)


def _own_errors(problem: Problem, model: Model, checked: CompatibilityResult) -> Estimates:
    """Sensor errors of a flight under a model: by filter error, or in free runs of output error where that is lost."""
    try:
        return fitted(problem, model, (), (), {}, checked.gust_sigma)
    except EstimationError:
        return fit(problem, model, ())
