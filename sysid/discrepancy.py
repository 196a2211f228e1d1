"""Discrepancy: where simulation and measurement disagree, which effect is missing, and how the gap shrinks with it.

The model's own parameters are fitted again first. Then every effect of the catalogue that the flights could show is
added in turn and everything is fitted once more (generalised likelihood ratio); a regression on what is left over would
see only the few per cent that the nominal parameters have not already absorbed. In calm air that is output error, in
turbulence filter error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy import special

from sim_vehicle.effects import EFFECTS
from sim_vehicle.model import Coefficient, Model
from sim_vehicle.parameters import flatten
from sim_vehicle.vehicle import Vehicle
from sysid.adequacy import left_in_gusts, unexplained
from sysid.compatibility import CompatibilityResult
from sysid.engines import Calm, Engine, Result, Rough, Setting, parameter_values
from sysid.errors import EstimationError
from sysid.estimate import MAX_RUN_S, Problem, fit, free_coefficients, likelier_timing, model_of, warmed
from sysid.flight import FlightSignals
from sysid.gap import Fixed, gap
from sysid.gapstages import fixed_model, held_out_models, stage_gaps
from sysid.location import locate
from sysid.output_error import OutputErrorResult
from sysid.posing import make_problem
from sysid.prepare import Prepared, check_compatibility, prepare
from sysid.residuals import coefficient_path
from sysid.search import Named, Search, extend
from sysid.signalcheck import told_mistakes
from sysid.steps import inverse

Progress = Callable[[float, str], None]

# Sensor errors estimated beside every model: those that change with every power-up, and the vanes', which no effect can
# be told from. Then what a bench calibration leaves of the airspeed, with its usual size.
NUISANCE = (
    "accel_bias_x", "accel_bias_y", "accel_bias_z", "gyro_bias_p", "gyro_bias_q", "gyro_bias_r", "alpha_scale",
    "alpha_bias", "beta_scale", "beta_bias",
)  # fmt: skip
BENCH = {"airspeed_bias": 0.02, "airspeed_scale": 0.002}
WIND = ("wind_north", "wind_east", "wind_down")
# Beyond so many times that size it is an effect of its own (`airspeed_error`) and must compete with the others.
BENCH_LIMIT = 5.0
# Short free runs keep a wrong model near enough to the measurement for its likelihood to lead anywhere, s.
RUN_S = 6.0
MAX_EFFECTS = 3
# Beyond this an effect that was found has not explained them.
_UNEXPLAINED = 1.5
# Factor by which some gap must shrink for a change of the model to count in calm air.
_VISIBLE = 1.05


@dataclass(frozen=True)
class _Flights:
    """What every step of a comparison needs: flights, what kinematics say of them, and the wish to be told."""

    prepared: Sequence[Prepared]
    compatible: CompatibilityResult
    vehicle: Vehicle
    progress: Progress


@dataclass(frozen=True)
class _Baseline:
    """The model handed in, and with its own parameters fitted again.

    problem: of the fit in calm air; engine: by which effects are compared. given: fit of the sensor errors alone.
    """

    problem: Problem
    engine: Engine
    model: Model
    names: Sequence[str]
    effects: Sequence[tuple[str, str]]
    given: OutputErrorResult
    before: Result

    @property
    def refitted(self) -> Model:
        """The model with its parameters fitted again."""
        return model_of(
            self.model, self.model.name, self.before, self.names, self.effects, (), self.model.validity
        )  # fmt: skip


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
    used = _Flights(prepared, check_compatibility(prepared), vehicle, progress)
    base = _fitted_again(used, model)
    search, reasons = _searched(used, base)
    verdict, more = _verdict(used, base, search)
    reasons += more
    if verdict == "unexplained" and search.named:
        # A wrong name is worse than none.
        search = _without(base)
    engine, compatible = base.engine, used.compatible
    stages = {
        "given": fixed_model(base.problem, model, base.given, compatible),
        "before": fixed_model(engine.problem, base.refitted, base.before, compatible),
        "after": fixed_model(engine.problem, search.model, search.result, compatible),
    }
    progress(0.75, "the gap on the flights used")
    generator = np.random.default_rng(seed)
    gaps = {"estimation": stage_gaps(base.problem.motion, prepared, stages, compatible, generator)}
    if held_out:
        progress(0.85, "the gap on the other flights")
        models = {"given": model, "before": base.refitted, "after": search.model}
        gaps["validation"] = _held_out_gaps(held_out, base, models, generator)
    where = _where(base.problem, prepared, stages) if verdict != "none" else []
    progress(1.0, "done")
    return {
        "schema": "discrepancy/1",
        "flights": [flight.data.name for flight in prepared],
        "verdict": verdict,
        "reasons": reasons,
        "where": where,
        "effects": [_effect_json(named) for named in search.named],
        "gap": gaps,
        "model": search.model.to_json(),
        "turbulence": compatible.gust_sigma,
        "warnings": list(dict.fromkeys([*(w for one in (*prepared, *held_out) for w in one.warnings), *told])),
    }


def _fitted_again(used: _Flights, model: Model) -> _Baseline:
    """The model as given and with its own parameters fitted again, in the way that the air asks for."""
    problem = _problem(used.prepared, used.vehicle, used.compatible)
    names = free_coefficients(list(model.coefficients), problem.motion)
    if not names:
        raise EstimationError("the baseline model has no coefficient in the axes that these flights excite")
    effects = [(e.name, key) for e in model.effects for key in e.parameters if _is_fitted(e.name, key)]
    used.progress(0.16, "the model as given")
    given = fit(problem, model, ())
    used.progress(0.22, "its coefficients fitted again")
    before = fit(warmed(problem, given), model, names, effects, parameter_values(given))
    timed, retimed = likelier_timing(problem, model, names, effects, before)
    if timed is not problem and not (used.compatible.gust_sigma == 0.0 and unexplained(timed, retimed)):
        # Only a model that explains the flight may overrule what the lift alone says of the timing.
        problem, before = replace(problem, command_first=timed.command_first), retimed
        given = fit(problem, model, ())
    if any(abs(before.value(name)) > BENCH_LIMIT * std for name, std in BENCH.items() if name in problem.sensors):
        problem = _without_bench(problem)
        given = fit(problem, model, ())
        before = fit(warmed(problem, given), model, names, effects, parameter_values(given))
    if used.compatible.gust_sigma == 0.0:
        return _Baseline(problem, Calm(problem, used.prepared), model, names, effects, given, before)
    used.progress(0.26, "its coefficients fitted again, with gusts")
    whole = _problem(used.prepared, used.vehicle, used.compatible, rough=True)
    whole = whole if set(BENCH) & set(problem.sensors) else _without_bench(whole)
    engine = Rough(replace(whole, command_first=problem.command_first), used.compatible.gust_sigma)
    start = {name: value for name, value in parameter_values(before).items() if name not in BENCH}
    return _Baseline(problem, engine, model, names, effects, given, engine.fit(model, names, effects, start))


def _problem(
    prepared: Sequence[Prepared], vehicle: Vehicle, compatible: CompatibilityResult, rough: bool = False
) -> Problem:
    """Short runs, or in rough air long ones, with the sensor errors that are estimated beside every model."""
    names = [*NUISANCE, *BENCH, *(WIND if rough else ())]
    problem = make_problem(prepared, vehicle, compatible, names, MAX_RUN_S if rough else RUN_S, rough)
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


def _without(base: _Baseline) -> Search:
    return Search(base.refitted, list(base.names), list(base.effects), base.before)


def _left(base: _Baseline, search: Search) -> tuple[float, str]:
    """How much the search's model leaves unexplained, 0 for nothing, and what, in words."""
    if isinstance(search.result, OutputErrorResult):
        ratios = unexplained(base.problem, search.result)
        listed = ", ".join(f"{name} {ratio:.2f}" for name, ratio in ratios.items())
        return max(
            ratios.values(), default=0.0
        ), f"residuals exceed the sensors' noise and are not white: {listed} times"
    setting = Setting(search.model, search.coefficients, search.effects, search.result)
    found = left_in_gusts(base.engine.problem, setting, search.imprecise)
    return float(len(found)), f"beyond noise and gusts: {'; '.join(f'{name} ({why})' for name, why in found.items())}"


def _searched(used: _Flights, base: _Baseline) -> tuple[Search, list[str]]:
    """Effects added one after the other until nothing is left, and why some were dropped again."""
    start = {**base.model.values(), **parameter_values(base.given)}
    search = _without(base)
    while len(search.named) < MAX_EFFECTS:
        begin, width = 0.3 + 0.4 * len(search.named) / MAX_EFFECTS, 0.4 / MAX_EFFECTS
        if not extend(base.engine, search, start, partial(_part_of, used.progress, begin, width)):
            break
        if not _left(base, search)[0]:
            break
    if not search.named or not isinstance(search.result, OutputErrorResult):
        return search, []
    # In calm air significance alone is not enough: what changes no gap by as much as _VISIBLE is below what bench
    # calibration can do; and a wrong name is worse than none where the residuals stay far above the noise.
    told = "; ".join(_told(named, search.tried) for named in search.named)
    if _left(base, search)[0] > _UNEXPLAINED:
        return _without(base), [f"dropped, since the residuals stay far above the noise: {told}"]
    stages = {
        "before": fixed_model(base.problem, base.refitted, base.before, used.compatible),
        "after": fixed_model(base.problem, search.model, search.result, used.compatible),
    }
    if _closed(used, stages, "before", "after") <= _VISIBLE:
        return _without(base), [f"dropped, since no gap shrinks visibly: {told}"]
    return search, []


def _closed(used: _Flights, stages: Mapping[str, Fixed], first: str, second: str) -> float:
    """Largest factor by which any output's gap shrinks between two stages."""
    records = [stretch.record for flight in used.prepared for stretch in flight.stretches]
    gaps = {stage: gap(records, used.prepared[0].layout, stages[stage]) for stage in (first, second)}
    ratios = [gaps[first][name] / gaps[second][name] for name in gaps[second] if gaps[first].get(name)]
    return max(ratios, default=1.0)


def _told(named: Named, tried: int) -> str:
    weight = named.weight
    return (
        f"{named.candidate.effect.name}: the likelihood gains {weight.gain:.0f} (chance {weight.p_value:.1e}, "
        f"{tried} effects looked at)"
    )


def _verdict(used: _Flights, base: _Baseline, search: Search) -> tuple[str, list[str]]:
    """Verdict and the tests it rests on, in words."""
    reasons = [_told(named, search.tried) for named in search.named]
    left, words = _left(base, search)
    if left:
        reasons.append(words)
        if not isinstance(search.result, OutputErrorResult):
            return "unexplained", reasons
    if used.compatible.gust_sigma > 0.0:
        reasons.append(f"turbulence of {used.compatible.gust_sigma:.2f} m/s is counted as process noise")
    if search.named:
        return "missing_effect", reasons
    if left:
        return "unexplained", reasons
    moved, chance = _moved(base)
    reasons.append(f"the coefficients fitted again are {moved:.0f} from those given (chi-squared, chance {chance:.1e})")
    return ("parameter_error" if chance < 1e-3 else "none"), reasons


def _moved(base: _Baseline) -> tuple[float, float]:
    """How far the model's own parameters are from those given (Wald's test), and the chance of that."""
    values = base.model.values() | {
        f"{effect}.{name}": (base.model.effect(effect) or {})[name] for effect, name in base.effects
    }
    every = [parameter.name for parameter in base.before.parameters]
    names = [*base.names, *(f"{effect}.{name}" for effect, name in base.effects)]
    places = [every.index(name) for name in names]
    away = base.before.theta[places] - np.array([values[name] for name in names])
    distance = float(away @ inverse(base.before.covariance[np.ix_(places, places)]) @ away)
    return distance, float(special.chdtrc(len(places), max(distance, 0.0)))


def _held_out_gaps(
    held_out: Sequence[Prepared], base: _Baseline, models: Mapping[str, Model], generator: np.random.Generator
) -> dict[str, dict[str, float]]:
    checked = check_compatibility(held_out)
    other = _problem(held_out, base.problem.vehicle, checked)
    other = replace(other, command_first=base.problem.command_first)
    other = other if set(BENCH) & set(base.problem.sensors) else _without_bench(other)
    return stage_gaps(other.motion, held_out, held_out_models(other, models, checked), checked, generator)


def _where(problem: Problem, prepared: Sequence[Prepared], stages: Mapping[str, Fixed]) -> list[dict[str, Any]]:
    axes = [a for a in ("CL", "CD", "Cm") if problem.motion.longitudinal]
    axes += [a for a in ("CY", "Cl", "Cn") if problem.motion.lateral]
    paths, floors = [], []
    for flight in prepared:
        for stretch in flight.stretches:
            before, after = (
                coefficient_path(stretch.record, flight.layout, problem.vehicle, stages[stage])
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
