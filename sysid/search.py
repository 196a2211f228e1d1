"""The search for missing effects: candidates tried, compared, and the one the data insist on added."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from sim_vehicle.model import Model
from sysid.candidates import Candidate, candidates
from sysid.engines import Setting, finalists, tried
from sysid.errors import EstimationError
from sysid.estimate import Problem, Progress, build_filter, model_of
from sysid.evidence import Weight, is_significant, smallest_set, weigh
from sysid.filter_error import FilterErrorResult
from sysid.filter_path import LAGGING
from sysid.filter_screen import filter_gains

# Only candidates that promise at least this much, and this share of the best promise, are tried: at most so many.
MIN_PROMISE, PROMISE_SHARE, MAX_TRIED = 12.0, 0.1, 8
# Play of servos and of the thrust sensor, whose state between samples nobody records.
_PLAY = ("thrust_sensor_hysteresis", "servo_deadband", "actuator_backlash", "sensor_time_skew")
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
    def lags(self) -> bool:
        """Whether it has a memory that the filter knows only nearly."""
        return self.candidate.effect.name in (*LAGGING, *_PLAY)


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
        return _IMPRECISE * max((one.weight.gain for one in self.named if one.lags), default=0.0)


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
        if begun is not None:
            fits.append((candidate, begun))
    search.tried = len(choices)
    if not fits:
        return False
    progress((len(worth) + 1.0) / (len(worth) + 2.0), "fitting the likeliest to the end")
    found = finalists(problem, base, sorted(fits, key=lambda item: item[1].cost))
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


def sharpen(search: Search) -> None:
    """Estimate once more where turbulence is, noise and turbulence together with everything else.

    Gains that are held fixed make standard errors of sideslip's derivatives up to three times too small
    (sysid.filter_scores). What cannot be scored stays as it is.
    """
    flight = build_filter(search.problem, search.model, search.coefficients, search.effects)
    with suppress(EstimationError):
        settle(search, flight.solve(search.result.values(), search.result.turbulence))


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


def _promising(
    problem: Problem, base: Setting, choices: Sequence[Candidate]
) -> list[tuple[Candidate, dict[str, float]]]:
    """Candidates worth a fit, with the start each promises most from."""
    gains = filter_gains(problem, base.model, base.coefficients, base.effects, base.result, choices)
    order = sorted(range(len(choices)), key=lambda i: -gains[i][0])
    limit = max(MIN_PROMISE, PROMISE_SHARE * gains[order[0]][0]) if order else 0.0
    return [(choices[i], gains[i][1]) for i in order[:MAX_TRIED] if gains[i][0] >= limit]
