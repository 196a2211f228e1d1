"""Discrepancy: where simulation and measurement disagree, which effect is missing, and how the gap shrinks with it.

The model's own parameters are fitted again first. Then every effect of the catalogue that the flights could show is
looked at (score test), the promising ones are added in turn and everything is fitted once more (generalised likelihood
ratio); a regression on what is left over would see only the few per cent that the nominal parameters have not already
absorbed. All by filter error, in calm air too: a model that lacks something still follows the flight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy import special

from sim_vehicle.effects import effect_called
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.flat_model import flatten
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.compatibility.reconstruction import CompatibilityResult, check_compatibility
from sysid.discrepancy.baseline import (
    BENCH,
    Baseline,
    Flights,
    Progress,
    fitted_again,
    is_beyond_bench,
    posed,
    sensors_alone,
    without_bench,
)
from sysid.discrepancy.candidate_fits import fitted
from sysid.discrepancy.forward_selection import (
    Search,
    eliminate_insignificant,
    eliminate_redundant,
    extend,
    refit_jointly,
    update_estimate,
)
from sysid.discrepancy.gap import fixed_model, stage_gaps, widening
from sysid.discrepancy.gap_series import gap_series
from sysid.discrepancy.identified_effect import effect_json, reason
from sysid.discrepancy.lack_of_fit import left_over
from sysid.discrepancy.localisation import locate
from sysid.discrepancy.summary import sentence
from sysid.discrepancy.wording import moved_words
from sysid.errors import EstimationError
from sysid.filter_error.estimation import build_filter
from sysid.filter_error.estimator import FilterErrorResult
from sysid.numerics.dryden import Turbulence
from sysid.numerics.normal_equations import inverse
from sysid.output_error.fit import fit
from sysid.problem.coefficient_residuals import CoefficientPath, coefficient_path
from sysid.problem.free_run import Fixed
from sysid.problem.problem import Estimates, Problem
from sysid.quality.flight_rules import flights_quality
from sysid.quality.verdict import CARE, Reason
from sysid.signal_check.check import told_mistakes
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import Prepared, prepare, require_thrust

MAX_EFFECTS = 3
_AIRSPEED = "airspeed_error"
_NOTHING_NAMED = "flight and model disagree in a way that nothing in the catalogue names"
# Chance of coefficients as far from those given, below which those are wrong.
_CHANCE = 1e-4
# What names do not widen the gap by more than noise does: right ones have been seen to by 4 %.
_WIDER = 1.1
# Turbulence, m/s, from which on gains that are held fixed make standard errors of sideslip's derivatives too small
# (sysid.discrepancy.forward_selection.refit_jointly), and what those are multiplied with before coefficients are called
# wrong.
_GUSTS, _FIXED_GAINS = 0.02, 2.0


def discrepancy(
    flights: Sequence[FlightSignals],
    vehicle: Vehicle,
    model: Model,
    *,
    validate_on: Sequence[FlightSignals] = (),
    start_s: float | None = None,
    stop_s: float | None = None,
    ruled_out: Sequence[str] = (),
    progress: Progress = lambda share, text: None,
    seed: int = 0,
) -> dict[str, Any]:
    """Compare a model with flights.

    flights: used to fit. validate_on: used only to show the gap. model: the baseline, every coefficient with a value.
    ruled_out: effects that are known not to be there, because the aircraft was weighed or a sensor was on the bench.
    seed: of the noise in the noise floor. Returns the result file (schema discrepancy/1).
    Raises SysidError subclasses, and ModelFileError for a model without a needed value or
    an effect that nobody knows, in one line.
    """
    flatten(vehicle, model)
    for name in ruled_out:
        effect_called(name)
    progress(0.02, "signals on one time base")
    prepared = [prepare(flight, vehicle, start_s, stop_s) for flight in flights]
    held_out = [prepare(flight, vehicle) for flight in validate_on]
    require_thrust([*prepared, *held_out])
    progress(0.05, "units, signs and axes")
    told = [line for group in (prepared, held_out) if group for line in told_mistakes(group, vehicle)]
    progress(0.08, "data compatibility")
    used = Flights(prepared, check_compatibility(prepared), vehicle, progress)
    base = fitted_again(used, model, ruled_out)
    search = _searched(used, base)
    verdict, reasons = _verdict(used, base, search)
    if verdict == "unexplained" and search.named:
        # A wrong name is worse than none.
        search = _without(base)
    stages = {"given": fixed_model(base.problem, model, base.given, used.compatible), "before": _refitted(used, base)}
    stages["after"] = _found(used, search) if search.result is not base.before else stages["before"]
    air = search.result.turbulence
    progress(0.75, "the gap on the flights used")
    generator = np.random.default_rng(seed)
    gaps = {"estimation": stage_gaps(base.problem.motion, prepared, stages, used.compatible, air, generator)}
    shown = ("before", "after") if search.named else ("given", "before")
    series = {"estimation": gap_series(prepared, stages, shown)}
    if held_out:
        progress(0.85, "the gap on the other flights")
        models = {"given": model, "before": base.refitted, "after": search.model}
        gaps["validation"], series["validation"] = _held_out_gaps(held_out, search.problem, models, shown, generator)
    # What coefficients fitted again explain is not where an effect is missing.
    stage_before = "given" if verdict == "parameter_error" else "before"
    where = _where(base.problem, prepared, stages, stage_before) if verdict != "none" else []
    progress(1.0, "done")
    quality = flights_quality(flights, prepared, vehicle, used.compatible.gust_sigma)
    if verdict == "unexplained":
        quality = replace(quality, reasons=(*quality.reasons, Reason(CARE, _NOTHING_NAMED)))
    result = {
        "schema": "discrepancy/1",
        "flights": [flight.data.name for flight in prepared],
        "ruled_out": sorted(base.ruled_out),
        "verdict": verdict,
        "reasons": reasons,
        "where": where,
        "effects": [effect_json(named) for named in search.named],
        "gap": gaps,
        "series": series,
        "model": search.model.to_json(),
        "turbulence": max(air.horizontal, air.vertical),
        "quality": quality.to_json(),
        "warnings": list(dict.fromkeys([*(w for one in (*prepared, *held_out) for w in one.warnings), *told])),
    }
    return {"schema": result["schema"], "sentence": sentence(result), **result}


def _part_of(progress: Progress, begin: float, width: float, share: float, text: str) -> None:
    progress(begin + width * share, text)


def _without(base: Baseline) -> Search:
    return Search(
        base.problem, base.refitted, list(base.names), list(base.effects), base.before,
        given=base.own_values, ruled_out=base.ruled_out,
    )  # fmt: skip


def _left(base: Baseline, search: Search) -> str:
    """What the search's model leaves unexplained, in words; empty for nothing."""
    found = left_over(search.problem, search.setting, search.unmodelled_memory_gain)
    return "; ".join(f"{name} ({why})" for name, why in found.items())


def _searched(used: Flights, base: Baseline) -> Search:
    """Effects added one after the other until nothing is left."""
    search = _without(base)
    while len(search.named) < MAX_EFFECTS:
        begin, width = 0.3 + 0.4 * len(search.named) / MAX_EFFECTS, 0.4 / MAX_EFFECTS
        if not extend(search, partial(_part_of, used.progress, begin, width)):
            break
        _with_bench(used, search)
    eliminate_redundant(search)
    if search.named and _is_rough(search.result):
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
    if problem.sensors.keys() == search.problem.sensors.keys() or search.named[-1].candidate.effect.name == _AIRSPEED:
        return
    known = search.result
    flight = build_filter(problem, search.model, search.coefficients, search.effects)
    with suppress(EstimationError):
        result = flight.solve(known.values(), known.turbulence, known=known)
        if not is_beyond_bench(result, problem):
            search.problem = problem
            update_estimate(search, result)


def _is_rough(result: FilterErrorResult) -> bool:
    return max(result.turbulence.vertical, result.turbulence.horizontal) > _GUSTS


def _verdict(used: Flights, base: Baseline, search: Search) -> tuple[str, list[str]]:
    """Verdict and the tests it rests on, in words."""
    reasons = [*(reason(named) for named in search.named), *search.dropped, *([search.nearly] if search.nearly else [])]
    if _is_rough(search.result):
        gusts = search.result.turbulence
        reasons.append(
            f"turbulence of {gusts.horizontal:.2f} m/s, {gusts.vertical:.2f} up and down, is counted as process noise"
        )
    left = _left(base, search)
    if left:
        return "unexplained", [*reasons, f"beyond noise and gusts: {left}"]
    if search.named:
        wider = widening(used.prepared, _refitted(used, base), _found(used, search))
        if wider < _WIDER:
            return "missing_effect", reasons
        return "unexplained", [*reasons, f"with what was named the gap on these flights is {wider:.2f} times as wide"]
    moved, chance = _moved(base)
    reasons.append(moved_words(moved, len(base.names) + len(base.effects), chance))
    return ("parameter_error" if chance < _CHANCE else "none"), reasons


def _refitted(used: Flights, base: Baseline) -> Fixed:
    return fixed_model(base.problem, base.refitted, base.before, used.compatible)


def _found(used: Flights, search: Search) -> Fixed:
    return fixed_model(search.problem, search.model, search.result, used.compatible)


def _moved(base: Baseline) -> tuple[float, float]:
    """How far the model's own parameters are from those given (Wald's test), and the chance of that."""
    values = base.own_values
    every = [parameter.name for parameter in base.before.parameters]
    names = [*base.names, *(f"{effect}.{name}" for effect, name in base.effects)]
    places = [every.index(name) for name in names]
    away = base.before.theta[places] - np.array([values[name] for name in names])
    distance = float(away @ inverse(base.before.covariance[np.ix_(places, places)]) @ away)
    if _is_rough(base.before):
        distance /= _FIXED_GAINS**2
    return distance, float(special.chdtrc(len(places), max(distance, 0.0)))


def _held_out_gaps(
    held_out: Sequence[Prepared],
    problem: Problem,
    models: Mapping[str, Model],
    shown: Sequence[str],
    generator: np.random.Generator,
) -> tuple[dict[str, dict[str, float]], list[dict[str, Any]]]:
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
    # Kinematics alone take for gusts what an effect makes of a vane; the model that has it knows better.
    air = Turbulence(checked.gust_sigma, checked.gust_sigma)
    if isinstance(best, FilterErrorResult):
        air = best.turbulence
    return stage_gaps(other.motion, held_out, stages, checked, air, generator), gap_series(held_out, stages, shown)


def _own_errors(problem: Problem, model: Model, checked: CompatibilityResult) -> Estimates:
    """Sensor errors of a flight under a model: by filter error, or in free runs of output error where that is lost."""
    try:
        return fitted(problem, model, (), (), {}, checked.gust_sigma)
    except EstimationError:
        return fit(problem, model, ())


def _where(
    problem: Problem, prepared: Sequence[Prepared], stages: Mapping[str, Fixed], stage_before: str
) -> list[dict[str, Any]]:
    axes = [a for a in ("CL", "CD", "Cm") if problem.motion.longitudinal]
    axes += [a for a in ("CY", "Cl", "Cn") if problem.motion.lateral]
    paths: dict[str, list[tuple[str, CoefficientPath]]] = {stage_before: [], "after": []}
    for flight in prepared:
        for stretch in flight.stretches:
            for stage, found in paths.items():
                along = coefficient_path(stretch.record, flight.layout, problem.vehicle, stages[stage])
                found.append((flight.data.name, along))
    found_better = stages[stage_before] is not stages["after"]
    return locate(paths[stage_before], [path for _, path in paths["after"]] if found_better else (), axes)
