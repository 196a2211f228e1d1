"""Which effects may explain a disagreement."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from sim_vehicle.effects import EFFECTS, Effect, Need, Stage
from sim_vehicle.model.model_file import Model
from sysid.discrepancy.event_times import is_in_flight, likely_events
from sysid.problem.estimation_problem import Problem
from sysid.problem.free_parameters import effect_parameter
from sysid.signals.record import Record

# Half steps that are looked at of a parameter over which the likelihood goes in steps: one is then on the right step.
_HALF_STEPS = 40
# Moments tried for something that happens once.
_EVENTS = 3
# Above this height nothing is left of the ground's effect.
_LOW_SPANS = 2.0

# Standard errors about its default in which a parameter that an effect does without is left out.
_ABSENT = 2.0
# A parameter that can be as small as this makes its effect vanish.
_VANISHES = 1e-3


@dataclass(frozen=True)
class Candidate:
    """An effect that the model lacks, with the parameters that would be estimated and values to start from.

    free: names of its fitted parameters. starts: one set of values per hill of the likelihood.
    """

    effect: Effect
    free: tuple[str, ...]
    starts: tuple[dict[str, float], ...]

    @property
    def names(self) -> list[tuple[str, str]]:
        """(effect, parameter) pairs to estimate, empty for a coefficient effect."""
        return [] if self.effect.is_coefficient else [(self.effect.name, name) for name in self.free]

    @property
    def coefficients(self) -> list[str]:
        """Coefficients to estimate, empty for any other effect."""
        return list(self.free) if self.effect.is_coefficient else []

    @property
    def sizes(self) -> tuple[str, ...]:
        """Its free parameters less the moments at which it begins."""
        moments = {p.name for p in self.effect.parameters if p.moment}
        return tuple(name for name in self.free if name not in moments)

    def is_size(self, name: str) -> bool:
        """Whether one of its parameters is a size that may be small, not a limit beyond which the effect begins."""
        return next(p for p in self.effect.parameters if p.name == name).low <= _VANISHES

    def parameter(self, name: str) -> str:
        """Name of one of its parameters among the estimated ones."""
        return name if self.effect.is_coefficient else f"{self.effect.name}.{name}"


def is_possible(candidate: Candidate, values: Mapping[str, tuple[float, float]], records: Sequence[Record]) -> bool:
    """Whether an effect as fitted is one: its moment well within some flight, and no less than a step of what goes in
    steps, which is known to half of one. values: parameter -> value and standard error.
    """
    moments, steps = set(candidate.free) - set(candidate.sizes), stepping_of(candidate.effect)
    return all(is_in_flight(records, values[name][0]) for name in moments & values.keys()) and all(
        values[name][0] >= step for name, step in steps.items()
    )


def without_absent(candidate: Candidate, values: Mapping[str, tuple[float, float]]) -> Candidate | None:
    """The candidate without parameters that it does without, where those are as good as absent; None where it needs all
    of them, or none: a pitot's gain is one cause, its zero another, and both together are not less likely than either.

    values: parameter -> value and standard error. What is left starts from them.
    """
    defaults = {p.name: None if candidate.coefficients else p.default for p in candidate.effect.parameters}
    needed = tuple(
        name
        for name, (value, std) in values.items()
        if (default := defaults[name]) is None or abs(value - default) > _ABSENT * std
    )
    if not needed or len(needed) == len(values):
        return None
    return replace(candidate, free=needed, starts=({name: values[name][0] for name in needed},))


def alone(candidate: Candidate, start: Mapping[str, float], name: str) -> dict[str, float]:
    """The start values with one size of the effect, off the point where it vanishes, and no other one."""
    parameter = next(p for p in candidate.effect.parameters if p.name == name)
    values = {key: 0.0 if key in candidate.sizes and candidate.is_size(key) else start[key] for key in start}
    values[name] = start[name] if start[name] != 0.0 else 0.02 * max(abs(parameter.low), abs(parameter.high))
    return values


def within(candidate: Candidate, values: Mapping[str, float]) -> dict[str, float]:
    """Values brought within the bounds of the effect's parameters."""
    bounds = {p.name: (p.low, p.high) for p in candidate.effect.parameters}
    return {name: min(max(value, bounds[name][0]), bounds[name][1]) for name, value in values.items()}


def _plausible(effect: Effect, problem: Problem, model: Model) -> bool:
    """Whether the flights can show an effect at all."""
    if model.effect(effect.name) is not None:
        return False
    if not all(_HAS[need](problem) for need in effect.needs):
        return False
    if effect.stage is Stage.ENVIRONMENT:
        return bool(effect.needs)
    return not effect.alias or effect.by_curvature


def _measures_thrust(problem: Problem) -> bool:
    return any(np.isfinite(record.thrust).any() for record in problem.records)


def _has_rotor_speed(problem: Problem) -> bool:
    propulsion = problem.vehicle.propulsion
    return propulsion is not None and bool(propulsion.CT or (propulsion.max_rpm and propulsion.max_thrust))


def _near_the_ground(problem: Problem) -> bool:
    """Whether every record's height is known, and one comes within two spans of the ground."""
    heights = [record.heights for record in problem.records]
    limit = _LOW_SPANS * problem.vehicle.geometry.b
    return all(one.size for one in heights) and min(float(np.min(one)) for one in heights) < limit


_HAS: Mapping[Need, Callable[[Problem], bool]] = {
    Need.THRUST_BY_THROTTLE: lambda problem: not _measures_thrust(problem),
    Need.NO_ROTOR_SPEED: lambda problem: all(one.thrust_source.signal != "rpm" for one in problem.records),
    Need.MEASURED_THRUST: _measures_thrust,
    Need.NEAR_GROUND: _near_the_ground,
    Need.HEIGHT: lambda problem: all(one.relative_height.size for one in problem.records),
    # Whoever reads true airspeed has an error of the density in all coefficients alike.
    Need.CALIBRATED_AIRSPEED: lambda problem: problem.vehicle.sensors["airspeed"].kind != "true",
    Need.DIAMETER: lambda problem: problem.vehicle.propulsion is not None and bool(problem.vehicle.propulsion.diameter),
    Need.ROTOR_SPEED: _has_rotor_speed,
}


def stepping_of(effect: Effect) -> dict[str, float]:
    """Its parameters over which the likelihood goes in steps, up and down at every sample that they let through: name
    -> size of a step.
    """
    fitted = {p.name: effect_parameter(effect.name, p.name) for p in effect.parameters if p.fitted}
    return {name: one.step for name, one in fitted.items() if one.is_stepping}


def _starts(effect: Effect, events: Sequence[Mapping[str, float]]) -> tuple[dict[str, float], ...]:
    """Values to start from: the effect's own, or half steps where the likelihood goes in steps."""
    starts = effect.starts(events)
    for name, step in stepping_of(effect).items():
        starts = tuple({**starts[0], name: 0.5 * step * count} for count in range(1, _HALF_STEPS + 1))
    return starts


def candidates(problem: Problem, model: Model) -> list[Candidate]:
    """Every effect of the catalogue that the model lacks and the flights could show, once for each thing it may choose.

    A choice is the default of the candidate's own effect.
    """
    events = likely_events(problem.records, problem.vehicle, _EVENTS)
    found = []
    for effect in chain.from_iterable(entry.variants() for entry in EFFECTS.values()):
        if not _plausible(effect, problem, model):
            continue
        if effect.is_coefficient:
            free = tuple(
                p.name for p in effect.parameters if p.name not in model.coefficients and problem.motion.takes(p.name)
            )
            starts: tuple[dict[str, float], ...] = (dict.fromkeys(free, 0.0),)
        else:
            free = tuple(p.name for p in effect.parameters if p.fitted)
            if not events and any(p.moment for p in effect.parameters):
                continue
            starts = _starts(effect, events)
        if free and starts:
            found.append(Candidate(effect, free, starts))
    return found


def extended(model: Model, candidate: Candidate, values: dict[str, float]) -> Model:
    """The model with the effect added at these values."""
    return model.with_effect(candidate.effect, values)
