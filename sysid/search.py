"""The search for missing effects: candidates tried, compared, and the one the data insist on added."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from sim_vehicle.model import Model
from sysid.candidates import Candidate, candidates, extended
from sysid.compatibility import CompatibilityResult
from sysid.errors import EstimationError
from sysid.estimate import Problem, fit, model_of, warmed
from sysid.evidence import Weight, is_significant, smallest_set, weigh
from sysid.output_error import OutputErrorResult
from sysid.prepare import Prepared
from sysid.records import OUTPUTS
from sysid.screening import PathScreen, sensitivity_gains
from sysid.smoothing import noise_sigma

Progress = Callable[[float, str], None]
Start = Mapping[str, float]

# Only candidates that promise at least this much, and this share of the best promise, are tried: at most so many of
# each of the two looks. Each gets a few steps; those that have come furthest are fitted to the end.
MIN_PROMISE, PROMISE_SHARE, MAX_TRIED = 12.0, 0.1, 4
FIRST_STEPS, FINALISTS = 4, 3
# Residuals may exceed the sensors' noise by this much before something is called unexplained.
_EXCESS = 1.08


@dataclass(frozen=True)
class Named:
    """An effect that was added: its candidate, its weight, the alternatives, and the estimates."""

    candidate: Candidate
    weight: Weight
    alternatives: tuple[tuple[str, float], ...]
    values: Mapping[str, tuple[float, float]]


@dataclass
class Search:
    """State of the search: the model so far, its fit, and the effects named."""

    model: Model
    coefficients: list[str]
    effects: list[tuple[str, str]]
    result: OutputErrorResult
    named: list[Named] = field(default_factory=list)
    tried: int = 0


def extend(problem: Problem, flights: Sequence[Prepared], search: Search, given: Start, progress: Progress) -> bool:
    """Try to add one effect. Returns whether one was significant and has been added."""
    choices = candidates(problem, search.model)
    progress(0.0, f"a first look at {len(choices)} effects")
    tried = _promising(problem, flights, search, choices)
    fits: list[tuple[Candidate, OutputErrorResult]] = []
    for position, (candidate, start) in enumerate(tried):
        progress((position + 1.0) / (len(tried) + FINALISTS + 1.0), f"trying {candidate.effect.name}")
        found = _fit_candidate(problem, search, candidate, start, given)
        if found is not None:
            fits.append((candidate, found))
    fits.sort(key=lambda item: item[1].cost)
    for position, (candidate, rough) in enumerate(fits[:FINALISTS]):
        progress((len(tried) + position + 1.0) / (len(tried) + FINALISTS + 1.0), f"fitting {candidate.effect.name}")
        fits[position] = (candidate, _finish(problem, search, candidate, rough))
    search.tried = len(choices)
    if not fits:
        return False
    leader = min(fits, key=lambda item: item[1].cost)[1]
    weights, _ = weigh(search.result, [(f, len(c.free)) for c, f in fits], leader.inflation)
    top = max(range(len(fits)), key=lambda i: weights[i].probability)
    candidate, result = fits[top]
    if not is_significant(weights[top], search.tried):
        return False
    probabilities = [(c.effect.name, w.probability) for (c, _), w in zip(fits, weights, strict=True)]
    own = candidate.effect.name
    alternatives = tuple(item for item in smallest_set(probabilities) if item[0] != own)
    values = {
        name: (result.value(candidate.parameter(name)), result.std(candidate.parameter(name)))
        for name in candidate.free
    }
    search.named.append(Named(candidate, weights[top], alternatives, values))
    extension = search.model.with_effect(
        candidate.effect, {name: v for name, (v, _) in values.items()}, {name: s for name, (_, s) in values.items()}
    )
    search.coefficients += candidate.coefficients
    search.effects += candidate.names
    search.model = model_of(
        extension, extension.name, result, search.coefficients, search.effects, (), extension.validity
    )
    search.result = result
    return True


def _promising(
    problem: Problem, flights: Sequence[Prepared], search: Search, choices: Sequence[Candidate]
) -> list[tuple[Candidate, dict[str, float]]]:
    """Candidates worth a fit, with the start each promises most from: the best of either look."""
    errors = {name: search.result.value(name) for name in problem.sensors}
    looks = [
        *(
            sensitivity_gains(
                problem, search.model, search.coefficients, search.effects, search.result, choices, coloured
            )
            for coloured in (True, False)
        ),
        PathScreen(problem, flights, errors).gains(search.model, search.coefficients, choices),
    ]
    chosen: dict[int, dict[str, float]] = {}
    for look in looks:
        order = sorted(range(len(choices)), key=lambda i: -look[i][0])
        limit = max(MIN_PROMISE, PROMISE_SHARE * look[order[0]][0]) if order else 0.0
        for i in order[:MAX_TRIED]:
            if look[i][0] >= limit:
                chosen[i] = look[i][1]
    return [(choices[i], start) for i, start in chosen.items()]


def _fit_candidate(
    problem: Problem, search: Search, candidate: Candidate, promised: Mapping[str, float], given: Start
) -> OutputErrorResult | None:
    """First steps with the effect added: from the model so far, and from the model as handed in; the better."""
    so_far = parameter_values(search.result)
    rough = warmed(replace(problem, sub_steps=1), search.result)
    model = extended(search.model, candidate, dict(promised))
    named = {candidate.parameter(name): value for name, value in promised.items()}
    free = [*search.coefficients, *candidate.coefficients], [*search.effects, *candidate.names]
    begun = []
    for origin in (so_far, {**so_far, **given}):
        with suppress(EstimationError):
            begun.append(fit(rough, model, *free, {**origin, **named}, max_iterations=1))
    if not begun:
        return None
    best = min(begun, key=lambda found: found.cost)
    return fit(warmed(rough, best), model, *free, parameter_values(best), max_iterations=FIRST_STEPS - 1)


def _finish(problem: Problem, search: Search, candidate: Candidate, rough: OutputErrorResult) -> OutputErrorResult:
    """The fit brought to its end from where its first steps have led."""
    values = parameter_values(rough)
    model = extended(search.model, candidate, {name: values[candidate.parameter(name)] for name in candidate.free})
    return fit(
        warmed(problem, rough),
        model,
        [*search.coefficients, *candidate.coefficients],
        [*search.effects, *candidate.names],
        values,
    )


def parameter_values(result: OutputErrorResult) -> dict[str, float]:
    """Estimates by parameter name, initial states left out."""
    return {p.name: float(v) for p, v in zip(result.parameters, result.theta[: len(result.parameters)], strict=True)}


def _excess(problem: Problem, result: OutputErrorResult) -> dict[str, float]:
    """Residual over sensor noise per output, the noise estimated from the measurement alone."""
    ratios = {}
    for name in problem.motion.outputs:
        j = OUTPUTS.index(name)
        noise = [noise_sigma(record.z[:, j], record.interval_s) for record in problem.records]
        level = float(np.sqrt(np.mean(np.square(noise))))
        if level > 0.0 and np.isfinite(result.sigma[j]):
            ratios[name] = float(result.sigma[j]) / level
    return ratios


def unexplained(problem: Problem, result: OutputErrorResult, compatible: CompatibilityResult) -> dict[str, float]:
    """Outputs whose residuals exceed the sensors' noise and are not white, with the ratio; none in turbulence.

    Gusts leave such residuals too, and the kinematics alone (data compatibility) tell whether there are any.
    """
    if compatible.gust_sigma > 0.0:
        return {}
    return {
        name: ratio
        for name, ratio in _excess(problem, result).items()
        if ratio > _EXCESS and result.inflation[OUTPUTS.index(name)] > 2.0
    }
