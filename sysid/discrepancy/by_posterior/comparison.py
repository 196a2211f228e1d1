"""The comparison by the posterior: the model fitted again, effects named, the gap with and without them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from sim_vehicle.effects import EFFECTS
from sim_vehicle.effects.thrust_scale import THRUST_SCALE
from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.flat_model import flatten
from sysid.compatibility.reconstruction import CompatibilityResult
from sysid.discrepancy.by_posterior.group_fits import fit_of
from sysid.discrepancy.by_posterior.rules import RULES
from sysid.discrepancy.by_posterior.search import Found, search
from sysid.discrepancy.by_posterior.textbooks import as_of_textbooks, is_of_the_field, with_airspeed_at_once
from sysid.discrepancy.gap import widening
from sysid.discrepancy.identified_effect import reason
from sysid.discrepancy.outcome import MAX_EFFECTS, Asked, Compared, Outcome
from sysid.discrepancy.wording import moved_words
from sysid.errors import EstimationError
from sysid.identification.flight_as_meant import FlightsRead
from sysid.identification.posterior_method import Flown, effects_with, flown
from sysid.numerics.dryden import Turbulence
from sysid.numerics.normal_equations import inverse
from sysid.posterior.analysis import estimate
from sysid.posterior.estimates import PosteriorEstimate
from sysid.posterior.part import FlightPart
from sysid.posterior.replay import as_moved
from sysid.problem.formulation import timing_of
from sysid.problem.free_run import Fixed
from sysid.problem.problem import Motion, Problem, excited_motion
from sysid.quality.flight_rules import flights_quality
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import Prepared, require_thrust

# What is estimated beside the coefficients: reported where it is so many standard errors off, and
# where the flight determines it so much better than was known before.
_SEEN, _INFORMED = 3.0, 0.5
_TRIMS = ("Cl_0", "Cn_0")
# Name -> what is reported where it is above its null and below it, "" for nothing, the null, the factor to
# its unit.
_BESIDE = {
    "servo_delay": ("the servos are delayed by {:.0f} ms", "", 0.0, 1e3),
    "servo_lag": ("the servos lag by {:.0f} ms", "", 0.0, 1e3),
    "servo_backlash": ("the linkages have {:.2f} deg of play to either side", "", 0.0, 180.0 / np.pi),
    "airspeed_error": ("the airspeed reads {:.1f} % too much", "the airspeed reads {:.1f} % too little", 0.0, 100.0),
    "alpha_scale": ("the alpha vane turns {:.0f} % too far", "the alpha vane turns {:.0f} % too little", 1.0, 100.0),
    "beta_scale": ("the beta vane turns {:.0f} % too far", "the beta vane turns {:.0f} % too little", 1.0, 100.0),
    "vane_clock": ("the vanes are stamped {:.0f} ms late", "the vanes are stamped {:.0f} ms early", 0.0, 1e3),
    "thrust_error": ("the thrust reads {:.0f} % too much", "the thrust reads {:.0f} % too little", 0.0, 100.0),
}


def compare(asked: Asked, read: FlightsRead) -> Outcome | None:
    """What the flights say of the model; None where they are of the textbooks.

    read: the flights as their sensors meant them. Raises SysidError subclasses in one line.
    """
    seen = flown(read.fitted, asked.vehicle)
    require_thrust(seen.prepared)
    model = _with_trims(asked.model)
    try:
        base = _fitted(seen.parts, asked, model)
    except EstimationError:
        return None
    return _searched(asked, read, seen, model, base, False) if is_of_the_field(base) else None


def compare_textbooks(asked: Asked, read: FlightsRead) -> Outcome:
    """The same of flights of the textbooks: what servos, vanes and the pitot do is an effect like others.

    Raises SysidError subclasses in one line.
    """
    asked = replace(asked, vehicle=as_of_textbooks(asked.vehicle))
    seen = flown(read.fitted, asked.vehicle)
    require_thrust(seen.prepared)
    asked = replace(asked, vehicle=with_airspeed_at_once(asked.vehicle))
    return _searched(asked, read, seen, asked.model, _fitted(seen.parts, asked, asked.model), True)


def _searched(
    asked: Asked, read: FlightsRead, seen: Flown, model: Model, base: PosteriorEstimate, textbook: bool
) -> Outcome:
    """Effects named beside the model fitted again, and the gap with them."""
    progress, effects = asked.progress, _free_effects(asked.model)
    vehicle = asked.vehicle
    records = [stretch.record for flight in seen.prepared for stretch in flight.stretches]
    motion = replace(
        excited_motion(records), longitudinal="longitudinal" in base.groups, lateral="lateral" in base.groups
    )
    problem = Problem(vehicle, tuple(records), (), motion, {})
    fits = {group: fit_of(one, model, effects) for group, one in base.groups.items()}
    own = {f"{effect}.{key}": (asked.model.effect(effect) or {})[key] for effect, key in effects}
    found = Found(problem, model, fits, frozenset(asked.ruled_out), {**model.values(), **own}, textbook)
    search(found, MAX_EFFECTS, lambda share, text: progress(0.28 + 0.42 * share, text))
    best = base
    if found.named:
        progress(0.72, "standard errors")
        best = base.of({group: fit.ended() for group, fit in found.groups.items()})
        found.named = [replace(one, values=_values(one.candidate.names, one.values, best)) for one in found.named]
    before, after = _updated(model, base), _updated(found.model, best)
    signals = [one.signals for one in read.fitted]
    used = _beside(seen.prepared, signals, asked, motion, (base, before), (best, after), seen.compatible)
    verdict, reasons = _verdict(asked, base, found, used)
    if verdict == "unexplained":
        # A wrong name is worse than none: what was likeliest stands in the reasons.
        found.named, after = [], before
        used = replace(used, stages={**used.stages, "after": used.stages["before"]})
    judged = None
    if read.judges:
        kinematics = flown(read.judges, vehicle).compatible
        judged = _beside(
            [one.prepared for one in read.judges], [one.signals for one in read.judges], asked, motion, (base, before),
            (best, after), kinematics,
        )  # fmt: skip
    warnings = [*seen.warnings, *(one.sentence for one in read.mistakes()), *read.judged_warnings(), *base.warnings]
    return Outcome(
        "map", verdict, tuple(reasons), tuple(found.named), after, found.ruled_out, used, judged,
        seen.compatible.gust_sigma,
        flights_quality(asked.flights, seen.prepared, vehicle, seen.compatible.gust_sigma), tuple(warnings),
    )  # fmt: skip


def _free_effects(model: Model) -> list[tuple[str, str]]:
    """Parameters of the model's own effects that are fitted again."""
    return [
        (e.name, key)
        for e in model.effects
        for key in e.parameters
        if EFFECTS[e.name].parameter(key).fitted and not EFFECTS[e.name].alias
    ]


def _fitted(parts: Sequence[FlightPart], asked: Asked, model: Model) -> PosteriorEstimate:
    def report(share: float, text: str) -> None:
        asked.progress(0.08 + 0.2 * share, text)

    report(0.0, "its coefficients fitted again")
    return estimate(parts, asked.vehicle, model, _free_effects(model), systematic=False, progress=report)


def _with_trims(model: Model) -> Model:
    """The model with moments about roll and yaw at rest: linkages with play stand at one side of it, surfaces are not
    neutral to a tenth of a degree, and nobody calls that an effect.
    """
    missing = {name: Coefficient(0.0) for name in _TRIMS if name not in model.coefficients}
    return replace(model, coefficients={**model.coefficients, **missing}, correlation=None)


def _values(
    names: Sequence[tuple[str, str]], found: Mapping[str, tuple[float, float]], best: PosteriorEstimate
) -> dict[str, tuple[float, float]]:
    """Values and standard errors of an effect's parameters, with bars that count all."""
    entries = best.joint.entries()
    keys = {name: f"{effect}.{name}" for effect, name in names}
    return {name: entries.get(keys.get(name, name), entry) for name, entry in found.items()}


def _updated(model: Model, found: PosteriorEstimate) -> Model:
    """The model with its estimates from the flights; what they do not identify stays as given."""
    entries = found.joint.entries()
    coefficients = {
        name: Coefficient(*entries[name]) if name in entries else e for name, e in model.coefficients.items()
    }
    return replace(model, coefficients=coefficients, effects=effects_with(model.effects, entries), correlation=None)


def _beside(
    prepared: Sequence[Prepared],
    signals: Sequence[FlightSignals],
    asked: Asked,
    motion: Motion,
    before: tuple[PosteriorEstimate, Model],
    after: tuple[PosteriorEstimate, Model],
    compatible: CompatibilityResult,
) -> Compared:
    """Flights beside the stages, surfaces moved as the servos were found to move them."""
    flights = as_moved(prepared, signals, asked.vehicle, after[0])
    first = timing_of(flights, False)

    def fixed(found: PosteriorEstimate, model: Model) -> Fixed:
        errors = {name: value for name, (value, _, _) in found.sensor_errors().items()}
        less = next((one.value for one in found.nuisances if one.name == "thrust_error"), 0.0)
        if less and model.effect(THRUST_SCALE.name) is None:
            # Drag was estimated beside the thrust as it is, not as it was measured.
            model = model.with_effect(THRUST_SCALE, {"scale": -less})
        return Fixed(flatten(asked.vehicle, model), errors, first)

    stages = {"given": fixed(before[0], asked.model), "before": fixed(*before)}
    stages["after"] = stages["before"] if after[0] is before[0] else fixed(*after)
    air = Turbulence(compatible.gust_sigma, compatible.gust_sigma)
    return Compared(tuple(flights), motion, stages, compatible, air)


def _verdict(asked: Asked, base: PosteriorEstimate, found: Found, used: Compared) -> tuple[str, list[str]]:
    """Verdict, and what it rests on in words: rules of sysid.discrepancy.by_posterior.rules."""
    reasons = [*(reason(named) for named in found.named), *found.notes, *_nuisances(base)]
    if found.left:
        reasons.append("left without a name: " + "; ".join(f"{axis} ({why})" for axis, why in found.left.items()))
    if found.named:
        if found.left_gain > RULES.left_share * found.named[0].came_with:
            return "unexplained", reasons
        # Airspeed and attitude were imposed, and what they are off by was not asked for.
        asked_of = {name for fit in found.groups.values() for name in fit.posterior.model.outputs}
        wider = widening(used.flights, used.stages["before"], used.stages["after"], asked_of)
        if wider < RULES.wider:
            return "missing_effect", reasons
        return "unexplained", [*reasons, f"with what was named the gap on these flights is {wider:.2f} times as wide"]
    if found.left:
        return "unexplained", reasons
    distance, count = _moved(asked.model, base)
    chance = float(special.chdtrc(count, distance)) if count else 1.0
    reasons.append(moved_words(distance, count, chance))
    return ("parameter_error" if chance < RULES.chance else "none"), reasons


def _moved(model: Model, base: PosteriorEstimate) -> tuple[float, int]:
    """How far the estimates are from what was given (Wald's test), and of how many coefficients."""
    given = model.values()
    names = [name for name in base.joint.names if name in given and name not in base.not_believed]
    places = [base.joint.names.index(name) for name in names]
    away = base.joint.mean[places] - np.array([given[name] for name in names])
    return float(away @ inverse(base.joint.covariance[np.ix_(places, places)]) @ away), len(names)


def _nuisances(base: PosteriorEstimate) -> list[str]:
    """What servos and sensors do that the model does not hold, in words, the surer group of each."""
    surest = {one.name: one for one in sorted(base.nuisances, key=lambda one: -one.std)}
    sentences = []
    for name, (more, less, null, factor) in _BESIDE.items():
        one = surest.get(name)
        if one is None or abs(one.value - null) < _SEEN * one.std or one.std > _INFORMED * one.prior_std:
            continue
        if words := more if one.value > null else less:
            sentences.append(
                f"{words.format(factor * abs(one.value - null))} (± {factor * one.std:.2g}), beside the model"
            )
    return sentences
