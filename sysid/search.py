"""The search for missing effects: candidates tried, compared, and the one the data insist on added."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from sim_vehicle.model import Model
from sysid.candidates import Candidate, candidates, happens_in_flight, stepping_of
from sysid.engines import Setting, finalists, tried
from sysid.errors import EstimationError
from sysid.estimate import Problem, Progress, build_filter, model_of
from sysid.evidence import Weight, is_significant, smallest_set, weigh
from sysid.filter_error import FilterErrorResult
from sysid.filter_path import LAGGING
from sysid.filter_screen import filter_gains
from sysid.steps import inverse

# None is tried unless the best promises so much; then those that promise half of that and this share of the best: at
# most so many.
MIN_PROMISE, PROMISE_SHARE, MAX_TRIED = 12.0, 0.1, 8
# Play of servos and of the thrust sensor, whose state between samples nobody records.
_PLAY = ("thrust_sensor_hysteresis", "servo_deadband", "actuator_backlash", "sensor_time_skew")
# Steps of a fit without what was named before.
_STEPS_BACK = 12
# A memory that is known only nearly leaves this share of what it gains for others to pick up.
_IMPRECISE = 0.03


@dataclass(frozen=True)
class Named:
    """An effect that was added: its candidate, its weight, the alternatives, and the estimates."""

    candidate: Candidate
    weight: Weight
    alternatives: tuple[tuple[str, float], ...]
    values: Mapping[str, tuple[float, float]]

    @property
    def effect(self) -> str:
        """Name of its effect."""
        return self.candidate.effect.name

    @property
    def lags(self) -> bool:
        """Whether it has a memory that the filter knows only nearly."""
        return self.candidate.effect.name in (*LAGGING, *_PLAY)


def _imprecise(named: Sequence[Named]) -> float:
    return _IMPRECISE * max((one.weight.gain for one in named if one.lags), default=0.0)


@dataclass
class Search:
    """State of the search: the flights with their sensor errors, the model so far, its fit, and the effects named."""

    problem: Problem
    model: Model
    coefficients: list[str]
    effects: list[tuple[str, str]]
    result: FilterErrorResult
    named: list[Named] = field(default_factory=list)
    tried: int = 0

    @property
    def setting(self) -> Setting:
        """The model so far with its estimate."""
        return Setting(self.model, list(self.coefficients), list(self.effects), self.result)

    @property
    def imprecise(self) -> float:
        """Gain (twice the log likelihood) that lags named so far may leave to others."""
        return _imprecise(self.named)

    def imprecise_without(self, left_out: Named) -> float:
        """The same of all the others."""
        return _imprecise([one for one in self.named if one is not left_out])


def extend(search: Search, progress: Progress) -> bool:
    """Try to add one effect. Returns whether one was significant and has been added."""
    problem = search.problem
    choices = candidates(problem, search.model)
    progress(0.0, f"a first look at {len(choices)} effects")
    base = search.setting
    worth = _promising(problem, base, choices)
    fits: list[tuple[Candidate, FilterErrorResult]] = []
    for position, (candidate, start) in enumerate(worth):
        progress((position + 1.0) / (len(worth) + 2.0), f"trying {candidate.effect.name}")
        begun = tried(problem, base, candidate, start)
        if begun is not None and _is_possible(problem, candidate, begun):
            fits.append((candidate, begun))
    search.tried = len(choices)
    if not fits:
        return False
    progress((len(worth) + 1.0) / (len(worth) + 2.0), "fitting the likeliest to the end")
    found = finalists(problem, base, sorted(fits, key=lambda item: item[1].cost))
    found = [one for one in found if _is_possible(problem, one.candidate, one.result)]
    if not found:
        return False
    samples = float(sum(np.isfinite(one).sum() for one in base.result.residuals))
    weights = weigh([one.shown for one in found], [len(one.candidate.free) for one in found], samples)
    top = max(range(len(found)), key=lambda i: weights[i].probability)
    candidate, result = found[top].candidate, found[top].result
    if not is_significant(weights[top], search.tried) or weights[top].gain < search.imprecise:
        return False
    probabilities = [(one.candidate.effect.name, w.probability) for one, w in zip(found, weights, strict=True)]
    own = candidate.effect.name
    alternatives = tuple(item for item in smallest_set(probabilities) if item[0] != own)
    search.named.append(Named(candidate, weights[top], alternatives, values_of(candidate, result)))
    _add(search, candidate, result)
    return True


def _is_possible(problem: Problem, candidate: Candidate, result: FilterErrorResult) -> bool:
    values = {name: result.value(candidate.parameter(name)) for name in candidate.free}
    return happens_in_flight(candidate, values, problem)


def drop_replaced(search: Search) -> None:
    """Take out what was named first and is not needed beside what was named after it.

    One effect alone can stand for two others together until both are there: lag and misplacement of a vane look like a
    late vane. Each is judged as it was when it came in, by what the likelihood gains with it.
    """
    for one in tuple(search.named):
        if len(search.named) < 2:
            break
        _drop(search, one)


def _drop(search: Search, one: Named) -> None:
    """Leave an effect out if the others explain the flights as well without it."""
    own = {one.candidate.parameter(name) for name in one.candidate.free}
    coefficients = [name for name in search.coefficients if name not in own]
    effects = [pair for pair in search.effects if pair not in one.candidate.names]
    model = replace(
        search.model,
        coefficients={name: value for name, value in search.model.coefficients.items() if name not in own},
        effects=tuple(e for e in search.model.effects if one.candidate.coefficients or e.name != one.effect),
        correlation=None,
    )
    flight = build_filter(search.problem, model, coefficients, effects)
    known = search.result
    start = {name: value for name, value in known.values().items() if name not in own}
    try:
        result = flight.solve(start, known.turbulence, known=known, max_iterations=_STEPS_BACK)
        if 2.0 * (result.cost - known.cost) < MIN_PROMISE:
            result = min(result, flight.solve(result.values(), known.turbulence, near=result, brief=True), key=_cost)
    except EstimationError:
        return
    gain = 2.0 * (result.cost - known.cost)
    weight = weigh([gain], [len(own)], 1.0)[0]
    if is_significant(weight, search.tried) and gain > search.imprecise_without(one):
        return
    search.named = [other for other in search.named if other is not one]
    search.coefficients, search.effects, search.model = coefficients, effects, model
    settle(search, result)


def _cost(result: FilterErrorResult) -> float:
    return result.cost


def sharpen(search: Search) -> None:
    """Estimate once more where turbulence is, noise and turbulence together with everything else.

    Gains that are held fixed make standard errors of sideslip's derivatives up to three times too small
    (sysid.filter_scores). What cannot be scored stays as it is.
    """
    flight = build_filter(search.problem, search.model, search.coefficients, search.effects)
    with suppress(EstimationError):
        settle(search, flight.solve(search.result.values(), search.result.turbulence))


def is_borne_out(search: Search) -> bool:
    """Whether some named effect's sizes are, by the standard errors of `sharpen`, more than chance gives (Wald's test).

    With the gusts held fixed the likelihood gains where it only trades one noise for another; coefficients and gusts
    then explain the flight.
    """
    sharpened = search.result.together
    return not sharpened or any(is_significant(_borne(search, one), search.tried) for one in search.named)


def _borne(search: Search, one: Named) -> Weight:
    """Weight of an effect by Wald's statistic; as it was where none of its parameters is a size with a slope."""
    stepping = stepping_of(one.candidate.effect)
    sizes = [name for name in one.candidate.sizes if one.candidate.is_size(name) and name not in stepping]
    if len(sizes) < len(one.candidate.sizes):
        return one.weight
    every = [parameter.name for parameter in search.result.parameters]
    places = [every.index(one.candidate.parameter(name)) for name in sizes]
    values, spread = search.result.theta[places], search.result.covariance[np.ix_(places, places)]
    return weigh([float(values @ inverse(spread) @ values)], [len(sizes)], 1.0)[0]


def settle(search: Search, result: FilterErrorResult) -> None:
    """Take another estimate of the same model."""
    search.named = [replace(one, values=values_of(one.candidate, result)) for one in search.named]
    search.result = result
    search.model = model_of(
        search.model, search.model.name, result, search.coefficients, search.effects, (), search.model.validity
    )


def values_of(candidate: Candidate, result: FilterErrorResult) -> dict[str, tuple[float, float]]:
    """Values and standard errors of a candidate's parameters."""
    return {
        name: (result.value(candidate.parameter(name)), result.std(candidate.parameter(name)))
        for name in candidate.free
    }


def _add(search: Search, candidate: Candidate, result: FilterErrorResult) -> None:
    """Make an effect part of the search's model."""
    values = values_of(candidate, result)
    extension = search.model.with_effect(
        candidate.effect, {name: v for name, (v, _) in values.items()}, {name: s for name, (_, s) in values.items()}
    )
    search.coefficients += candidate.coefficients
    search.effects += candidate.names
    search.model = model_of(
        extension, extension.name, result, search.coefficients, search.effects, (), extension.validity
    )
    search.result = result
    # What was named before is known better beside what is new.
    search.named = [replace(one, values=values_of(one.candidate, result)) for one in search.named]


def _promising(
    problem: Problem, base: Setting, choices: Sequence[Candidate]
) -> list[tuple[Candidate, dict[str, float]]]:
    """Candidates worth a fit, with the start each promises most from."""
    gains = filter_gains(problem, base.model, base.coefficients, base.effects, base.result, choices)
    order = sorted(range(len(choices)), key=lambda i: -gains[i][0])
    best = gains[order[0]][0] if order else 0.0
    if best < MIN_PROMISE:
        return []
    limit = max(0.5 * MIN_PROMISE, PROMISE_SHARE * best)
    return [(choices[i], gains[i][1]) for i in order[:MAX_TRIED] if gains[i][0] >= limit]
