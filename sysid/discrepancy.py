"""Discrepancy: where simulation and measurement disagree, which effect is missing, and how the gap shrinks with it.

The model's own parameters are fitted again first. Then every effect of the catalogue that the flights could show is
added in turn and everything is fitted once more (generalised likelihood ratio); a regression on what is left over would
see only the few per cent that the nominal parameters have not already absorbed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy import special

from sim_vehicle.effects import EFFECTS
from sim_vehicle.model import Coefficient, Model
from sim_vehicle.parameters import flatten
from sim_vehicle.vehicle import Vehicle
from sysid.compatibility import CompatibilityResult
from sysid.errors import EstimationError
from sysid.estimate import Problem, fit, free_coefficients, likelier_timing, model_of, warmed
from sysid.evidence import log_likelihood_ratio
from sysid.flight import FlightSignals
from sysid.gap import gap
from sysid.gapstages import fixed_model, stage_gaps
from sysid.location import locate
from sysid.output_error import OutputErrorResult
from sysid.posing import make_problem
from sysid.prepare import Prepared, check_compatibility, prepare
from sysid.residuals import coefficient_path
from sysid.search import Named, Search, extend, parameter_values, unexplained
from sysid.signalcheck import told_mistakes

Progress = Callable[[float, str], None]
Start = Mapping[str, float]

# Sensor errors estimated beside every model: those that change with every power-up, and the vanes', which no effect can
# be told from. Then what a bench calibration leaves of the airspeed, with its usual size.
NUISANCE = (
    "accel_bias_x", "accel_bias_y", "accel_bias_z", "gyro_bias_p", "gyro_bias_q", "gyro_bias_r", "alpha_scale",
    "alpha_bias", "beta_scale", "beta_bias",
)  # fmt: skip
BENCH = {"airspeed_bias": 0.02, "airspeed_scale": 0.002}
# Beyond so many times that size it is an effect of its own (`airspeed_error`) and must compete with the others.
BENCH_LIMIT = 5.0
# Short free runs keep a wrong model near enough to the measurement for its likelihood to lead anywhere, s.
RUN_S = 6.0
MAX_EFFECTS = 3
# Beyond this an effect that was found has not explained them.
_UNEXPLAINED = 1.5
# Factor by which some gap must shrink for a change of the model to count.
_VISIBLE = 1.05
# The same in turbulence, where free runs feel gusts that a wrong effect can imitate in part.
_VISIBLE_IN_GUSTS = 1.3
# Gap over noise floor (sensors and gusts) beyond which turbulence does not explain what is left.
_ABOVE_GUSTS = 3.0


def discrepancy(
    flights: Sequence[FlightSignals],
    vehicle: Vehicle,
    model: Model,
    *,
    validate_on: Sequence[FlightSignals] = (),
    start_s: float | None = None,
    stop_s: float | None = None,
    progress: Progress = lambda share, text: None,
    seed: int = 0,
) -> dict[str, Any]:
    """Compare a model with flights.

    flights: used to fit. validate_on: used only to show the gap. model: the baseline, every coefficient with a value.
    seed: of the noise in the noise floor. Returns the result file (schema discrepancy/1).
    Raises SysidError subclasses, and ModelFileError for a model without a needed value, in one line.
    """
    flatten(vehicle, model)
    progress(0.02, "signals on one time base")
    prepared = [prepare(flight, vehicle, start_s, stop_s) for flight in flights]
    held_out = [prepare(flight, vehicle) for flight in validate_on]
    progress(0.05, "units, signs and axes")
    told = [line for group in (prepared, held_out) if group for line in told_mistakes(group, vehicle)]
    progress(0.08, "data compatibility")
    compatible = check_compatibility(prepared)
    problem = _problem(prepared, vehicle, compatible)
    names = free_coefficients(list(model.coefficients), problem.motion)
    if not names:
        raise EstimationError("the baseline model has no coefficient in the axes that these flights excite")
    own_effects = [(e.name, key) for e in model.effects for key in e.parameters if _is_fitted(e.name, key)]
    progress(0.16, "the model as given")
    given = fit(problem, model, ())
    progress(0.22, "its coefficients fitted again")
    before = fit(warmed(problem, given), model, names, own_effects, parameter_values(given))
    timed, retimed = likelier_timing(problem, model, names, own_effects, before)
    if timed is not problem and not unexplained(timed, retimed, compatible):
        # Only a model that explains the flight may overrule what the lift alone says of the timing.
        problem, before = replace(problem, command_first=timed.command_first), retimed
        given = fit(problem, model, ())
    if any(abs(before.value(name)) > BENCH_LIMIT * std for name, std in BENCH.items() if name in problem.sensors):
        problem = _without_bench(problem)
        given = fit(problem, model, ())
        before = fit(warmed(problem, given), model, names, own_effects, parameter_values(given))
    baseline = model_of(model, model.name, before, names, own_effects, (), model.validity)
    start = {**model.values(), **parameter_values(given)}
    search = Search(baseline, list(names), list(own_effects), before)
    while len(search.named) < MAX_EFFECTS:
        begin, width = 0.3 + 0.4 * len(search.named) / MAX_EFFECTS, 0.4 / MAX_EFFECTS
        if not extend(problem, prepared, search, start, partial(_part_of, progress, begin, width)):
            break
        if not unexplained(problem, search.result, compatible):
            break
    without = Search(baseline, list(names), list(own_effects), before)
    search, dropped = _credible(search, without, problem, compatible, prepared)
    final = search.model
    progress(0.75, "the gap on the flights used")
    stages = {"given": (model, given), "before": (baseline, before), "after": (final, search.result)}
    generator = np.random.default_rng(seed)
    gaps = {"estimation": stage_gaps(problem, prepared, stages, compatible, generator, held_out=False)}
    if held_out:
        progress(0.85, "the gap on the other flights")
        checked = check_compatibility(held_out)
        other = replace(_problem(held_out, vehicle, checked), command_first=problem.command_first)
        other = other if set(BENCH) & set(problem.sensors) else _without_bench(other)
        gaps["validation"] = stage_gaps(other, held_out, stages, checked, generator, held_out=True)
    verdict, reasons = _verdict(problem, given, before, search, names, compatible, gaps["estimation"])
    reasons = dropped + reasons
    if verdict == "unexplained" and search.named:
        # A wrong name is worse than none.
        search, final = without, baseline
        for stages_gap in gaps.values():
            stages_gap["after"] = stages_gap["before"]
    where = _where(problem, prepared, stages, compatible)
    progress(1.0, "done")
    return {
        "schema": "discrepancy/1",
        "flights": [flight.data.name for flight in prepared],
        "verdict": verdict,
        "reasons": reasons,
        "where": where if verdict != "none" else [],
        "effects": [_effect_json(named) for named in search.named],
        "gap": gaps,
        "model": final.to_json(),
        "turbulence": compatible.gust_sigma,
        "warnings": list(dict.fromkeys([*(w for one in (*prepared, *held_out) for w in one.warnings), *told])),
    }


def _problem(prepared: Sequence[Prepared], vehicle: Vehicle, compatible: CompatibilityResult) -> Problem:
    """Short runs, with the sensor errors that are estimated beside every model."""
    problem = make_problem(prepared, vehicle, compatible, [*NUISANCE, *BENCH], RUN_S)
    known = {name: value for name, value in problem.sensors.items() if name not in BENCH}
    start = {name: known.get(name, 0.0) for name in problem.sensors}
    return replace(problem, sensors=start, priors={name: (0.0, std) for name, std in BENCH.items() if name in start})


def _without_bench(problem: Problem) -> Problem:
    """The problem with the airspeed taken as it reads."""
    sensors = {name: value for name, value in problem.sensors.items() if name not in BENCH}
    return replace(problem, sensors=sensors, priors={})


def _part_of(progress: Progress, begin: float, width: float, share: float, text: str) -> None:
    progress(begin + width * share, text)


def _is_fitted(effect: str, parameter: str) -> bool:
    return any(p.name == parameter and p.fitted and not EFFECTS[effect].alias for p in EFFECTS[effect].parameters)


def _closed(gaps: Mapping[str, Mapping[str, float]], first: str, second: str) -> float:
    """Largest factor by which any output's gap shrinks between two stages."""
    ratios = [gaps[first][name] / gaps[second][name] for name in gaps[second] if gaps[first].get(name)]
    return max(ratios, default=1.0)


def _told(named: Named, tried: int) -> str:
    weight = named.weight
    return (
        f"{named.candidate.effect.name}: the likelihood gains {weight.gain:.0f} (chance {weight.p_value:.1e}, "
        f"{tried} effects looked at)"
    )


def _credible(
    search: Search,
    without: Search,
    problem: Problem,
    compatible: CompatibilityResult,
    prepared: Sequence[Prepared],
) -> tuple[Search, list[str]]:
    """The search, or the baseline `without` the effects named where they are not to be believed, and why.

    Significance alone is not enough: what changes no gap by as much as _VISIBLE is below what bench calibration can do;
    and a wrong name is worse than none where the residuals stay far above the noise.
    """
    if not search.named:
        return search, []
    told = "; ".join(_told(named, search.tried) for named in search.named)
    left = unexplained(problem, search.result, compatible)
    if left and max(left.values()) > _UNEXPLAINED:
        return without, [f"dropped, since the residuals stay far above the noise: {told}"]
    records = [stretch.record for flight in prepared for stretch in flight.stretches]
    gaps = {
        stage: gap(records, prepared[0].layout, fixed_model(problem, one.model, one.result, compatible))
        for stage, one in (("before", without), ("after", search))
    }
    if _closed(gaps, "before", "after") <= (_VISIBLE_IN_GUSTS if compatible.gust_sigma > 0.0 else _VISIBLE):
        return without, [f"dropped, since no gap shrinks visibly: {told}"]
    return search, []


def _verdict(
    problem: Problem,
    given: OutputErrorResult,
    before: OutputErrorResult,
    search: Search,
    names: Sequence[str],
    compatible: CompatibilityResult,
    gaps: Mapping[str, Mapping[str, float]],
) -> tuple[str, list[str]]:
    """Verdict and the tests it rests on, in words."""
    reasons = [_told(named, search.tried) for named in search.named]
    left = unexplained(problem, search.result, compatible)
    if left:
        listed = ", ".join(f"{name} {ratio:.2f}" for name, ratio in left.items())
        reasons.append(f"residuals exceed the sensors' noise and are not white: {listed} times")
    elif compatible.gust_sigma > 0.0:
        reasons.append(f"turbulence of {compatible.gust_sigma:.2f} m/s hides smaller effects")
        over = {name: gaps["after"][name] / floor for name, floor in gaps["noise_floor"].items() if floor > 0.0}
        worst = max(over, key=lambda name: over[name])
        if over[worst] > _ABOVE_GUSTS:
            reasons.append(f"the gap of {worst} stays {over[worst]:.1f} times what sensors and such turbulence make")
            return "unexplained", reasons
    if search.named:
        return "missing_effect", reasons
    if left:
        return "unexplained", reasons
    gained = log_likelihood_ratio(given, before, search.result.inflation)
    p_value = float(special.chdtrc(len(names), max(gained, 0.0)))
    closed = _closed(gaps, "given", "before")
    reasons.append(
        f"fitting the coefficients again gains {gained:.0f} (chance {p_value:.1e}) and shrinks a gap {closed:.3f} times"
    )
    visible = _VISIBLE_IN_GUSTS if compatible.gust_sigma > 0.0 else _VISIBLE
    return ("parameter_error" if p_value < 1e-3 and closed > visible else "none"), reasons


def _where(
    problem: Problem,
    prepared: Sequence[Prepared],
    stages: Mapping[str, tuple[Model, OutputErrorResult]],
    compatible: CompatibilityResult,
) -> list[dict[str, Any]]:
    axes = [a for a in ("CL", "CD", "Cm") if problem.motion.longitudinal]
    axes += [a for a in ("CY", "Cl", "Cn") if problem.motion.lateral]
    paths, floors = [], []
    for flight in prepared:
        for stretch in flight.stretches:
            before, after = (
                coefficient_path(
                    stretch.record, flight.layout, problem.vehicle, fixed_model(problem, *stages[stage], compatible)
                )
                for stage in ("given", "after")
            )
            paths.append((flight.data.name, before))
            floors.append(after)
    return locate(paths, floors, axes)


def _effect_json(named: Named) -> dict[str, Any]:
    effect = named.candidate.effect
    return {
        "name": effect.name,
        "title": effect.title,
        "probability": round(min(named.weight.probability, 0.9999), 4),
        "parameters": {name: Coefficient(value, std).to_json() for name, (value, std) in named.values.items()},
        "alternatives": [{"name": name, "probability": round(p, 4)} for name, p in named.alternatives],
        "separating_manoeuvre": effect.separated_by,
    }
