"""How candidates are looked at, fitted and compared: filter error, in calm air and in turbulence alike.

Its innovations are white even where a model lacks something: what is missing looks like gusts and noise, so that a free
simulation need not follow the flight for its likelihood to lead somewhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from sim_vehicle.effects import Remembers
from sim_vehicle.model.model_file import Model
from sysid.discrepancy.candidates import Candidate, extended, stepping_of, within
from sysid.discrepancy.naming_rule import BORNE_OUT
from sysid.errors import EstimationError
from sysid.filter_error.estimation import build_filter
from sysid.filter_error.estimator import MAX_ITERATIONS, FilterErrorResult
from sysid.filter_error.noise_scoring import FAINT, SEARCH_S
from sysid.numerics.dryden import Turbulence
from sysid.numerics.normal_equations import inverse
from sysid.problem.estimation_problem import Problem, start_values

Start = Mapping[str, float]
Effects = Sequence[tuple[str, str]]

_FINALISTS = 3  # candidates fitted to the end
# Of log likelihood, within which a candidate is as near as the first.
_CLOSE = 12.5
# Twice the log likelihood up to which what is missing has not spoiled the estimates of noise and turbulence.
_LITTLE = 150.0
# Shares of the best gain below which a candidate is out of the race: with noise of the model without it, and with its
# own.
_SHARE_OF_BEST, _STILL_IN = 0.5, 0.7
# Rounds of a fit that has far to go.
_ROUNDS = 4
_TRIAL_STEPS = 12
# Effects with a local maximum of the likelihood for every sample of a delay, and steps to find the highest.
_HILLY, _FIRST_STEPS = Remembers.LATENESS, 3
# Log likelihood by which one step is like another.
_ALIKE = 1.0
_LEAST_GUSTS = 0.02  # m/s, to start from
# Starts of a candidate, as shares of what its score promises: a size too large may lie over the hill.
_SHARES = (1.0, 0.3)


@dataclass(frozen=True)
class FittedModel:
    """A model with its free coefficients and effect parameters, and its estimate.

    given: values of its own parameters before they were fitted, as far as those may be nearer the truth.
    """

    model: Model
    coefficients: Sequence[str]
    effects: Effects
    result: FilterErrorResult
    given: Start = field(default_factory=dict)


@dataclass(frozen=True)
class Finalist:
    """A candidate with its estimate, and twice the log likelihood that it gains."""

    candidate: Candidate
    result: FilterErrorResult
    gain: float

    @property
    def shown(self) -> float:
        """The gain, as far as the estimates of its sizes bear it out (Wald's statistic).

        A gain far beyond what the sizes are in standard errors is that of a fit which went on, not of the effect.
        """
        borne = wald_statistic(self.candidate, self.result)
        return self.gain if borne is None else min(self.gain, BORNE_OUT * borne)


def values_of(candidate: Candidate, result: FilterErrorResult) -> dict[str, tuple[float, float]]:
    """Values and standard errors of a candidate's parameters."""
    return {
        name: (result.value(candidate.parameter(name)), result.std(candidate.parameter(name)))
        for name in candidate.free
    }


def wald_statistic(candidate: Candidate, result: FilterErrorResult) -> float | None:
    """Wald's statistic of a candidate's sizes (chi-squared, one degree each), None where not every one is a size.

    A limit has no size that vanishes, and what goes in steps has no slope.
    """
    stepping = stepping_of(candidate.effect)
    sizes = [name for name in candidate.sizes if candidate.is_size(name) and name not in stepping]
    if len(sizes) < len(candidate.sizes):
        return None
    every = [parameter.name for parameter in result.parameters]
    places = [every.index(candidate.parameter(name)) for name in sizes]
    values, spread = result.theta[places], result.covariance[np.ix_(places, places)]
    return float(values @ inverse(spread) @ values)


def fitted(
    problem: Problem, model: Model, coefficients: Sequence[str], effects: Effects, start: Start,
    gust_sigma: float = 0.0, max_iterations: int = MAX_ITERATIONS,
) -> FilterErrorResult:  # fmt: skip
    """The estimate of a model from start values by name. gust_sigma: m/s, to start from."""
    values = start_values(problem, model, coefficients, effects) | dict(start)
    sigma = max(gust_sigma, _LEAST_GUSTS)
    flight = build_filter(problem, model, coefficients, effects)
    found = flight.solve(values, Turbulence(sigma, sigma), brief=True, max_iterations=max_iterations)
    if not is_gusty(found) or max_iterations == 0:
        return found
    # Gusts can stand where the likelihood is flat, far above those that are there, until all has been moved once.
    with suppress(EstimationError):
        again = flight.solve(found.values(), found.turbulence, near=found, brief=True)
        found = min(found, again, key=lambda one: one.cost)
    return found


def is_gusty(result: FilterErrorResult) -> bool:
    """Whether an estimate has found gusts at all."""
    return max(result.turbulence.horizontal, result.turbulence.vertical) > _LEAST_GUSTS


def fit_short(problem: Problem, base: FittedModel, candidate: Candidate, promised: Start) -> FilterErrorResult | None:
    """A candidate added, noise and turbulence as they were without it; None where it can be fitted from nowhere."""
    best: FilterErrorResult | None = None
    for share in _SHARES:
        sizes = {name: share if candidate.is_size(name) else 1.0 for name in promised}
        start = {name: sizes[name] * value for name, value in promised.items()}
        best = _likelier(best, _trial(problem, base, candidate, start, _TRIAL_STEPS))
        if best is not None and best.cost < base.result.cost:
            break
    if candidate.effect.memory is _HILLY:
        begun = [_trial(problem, base, candidate, start, _FIRST_STEPS) for start in candidate.starts]
        known = [one for one in begun if one is not None]
        if known:
            values = min(known, key=lambda one: one.cost).values()
            start = {name: values[candidate.parameter(name)] for name in candidate.free}
            best = _likelier(best, _trial(problem, base, candidate, start, _TRIAL_STEPS))
    if stepping_of(candidate.effect):
        likeliest = _on_its_step(problem, base, candidate)
        if likeliest is not None:
            best = _likelier(best, _trial(problem, base, candidate, likeliest, _TRIAL_STEPS))
    return best


def _on_its_step(problem: Problem, base: FittedModel, candidate: Candidate) -> Start | None:
    """The start in the middle of the likeliest step, for a candidate whose likelihood goes in steps; None where the
    filter loses the flight on all of them.
    """
    (name,) = stepping_of(candidate.effect)
    sizes = [start[name] for start in candidate.starts]
    found = [_trial(problem, base, candidate, start, 0) for start in candidate.starts]
    costs = np.array([np.inf if one is None else one.cost for one in found])
    best = int(np.argmin(costs))
    if not np.isfinite(costs[best]):
        return None
    first = last = best
    while first > 0 and costs[first - 1] < costs[best] + _ALIKE:
        first -= 1
    while last + 1 < len(sizes) and costs[last + 1] < costs[best] + _ALIKE:
        last += 1
    return {**candidate.starts[0], name: 0.5 * (sizes[first] + sizes[last])}


def _trial(
    problem: Problem, base: FittedModel, candidate: Candidate, start: Start, steps: int, given: Start | None = None
) -> FilterErrorResult | None:
    """A candidate's fit from one start; None where the filter loses the flight from there. given: of other parameters,
    instead of the base's estimates.
    """
    known, values = base.result, within(candidate, dict(start))
    flight = build_filter(problem, extended(base.model, candidate, values), *_free(base, candidate))
    with suppress(EstimationError):
        begin = known.values() | dict(given or {})
        begin |= {candidate.parameter(name): value for name, value in values.items()}
        return flight.solve(begin, known.turbulence, known=known, max_iterations=steps)
    return None


def _likelier(one: FilterErrorResult | None, other: FilterErrorResult | None) -> FilterErrorResult | None:
    return min((found for found in (one, other) if found is not None), key=lambda found: found.cost, default=None)


def rank(problem: Problem, base: FittedModel, fits: Sequence[tuple[Candidate, FilterErrorResult]]) -> list[Finalist]:
    """Those that have come furthest, the first brought to its end. fits: of `fit_short`, the likeliest first.

    Where little is missing in calm air, the noise without it is right for all, and who is near the first stays. Else
    noise and turbulence hold what is missing, and the first few are judged with their own.
    """
    gains = [2.0 * (base.result.cost - found.cost) for _, found in fits]
    if gains[0] < _LITTLE:
        kept = [i for i, gain in enumerate(gains) if gain > gains[0] - 2.0 * _CLOSE]
        if is_gusty(base.result):
            return _by_own_gusts(problem, base, [fits[i] for i in kept[:_FINALISTS]])
        ended = [fit_full(problem, base, *fits[0]), *(fits[i][1] for i in kept[1:])]
        return [Finalist(fits[i][0], found, gains[i]) for i, found in zip(kept, ended, strict=True)]
    near = [i for i, gain in enumerate(gains[:_FINALISTS]) if gain > _SHARE_OF_BEST * gains[0]]
    begun = [(*fits[i], with_own_noise(problem, base, *fits[i])) for i in near]
    found: list[tuple[Candidate, FilterErrorResult]] = []
    first = base.result.cost
    for candidate, rough, own in sorted(begun, key=lambda item: item[2].cost):
        # Who has come least far with noise of its own does not catch up with who is at its end, and is not brought
        # there.
        if base.result.cost - own.cost > _STILL_IN * (base.result.cost - first):
            own = _ended_from_both(problem, base, candidate, own, rough)
        found.append((candidate, own))
        first = min(first, own.cost)
    least = base.result.cost
    if is_gusty(base.result):
        # Gusts far above those that are there are a hill of their own.
        without = (base.model, base.coefficients, base.effects)
        best = min((one for _, one in found), key=lambda one: one.cost)
        least = min(least, _refit_noise(problem, without, base.result, best, None).cost)
    return [Finalist(candidate, one, 2.0 * (least - one.cost)) for candidate, one in found]


def _ended_from_both(
    problem: Problem, base: FittedModel, candidate: Candidate, own: FilterErrorResult, rough: FilterErrorResult
) -> FilterErrorResult:
    """The fit brought to its end; where a size ends on a bound, from the model as given too, and with the other sign.

    The base's own parameters stand for what is missing as well as they can, and can be on the far side of a hill.
    """
    best = _ended(problem, base, candidate, own, rough.cost)
    if not base.given or not _is_bound(candidate, best):
        return best
    values = rough.values()
    starts = [
        {
            name: values[candidate.parameter(name)] * (sign if candidate.is_size(name) else 1.0)
            for name in candidate.free
        }
        for sign in (1.0, -1.0)
    ]
    other: FilterErrorResult | None = None
    for start in starts:
        other = _likelier(other, _trial(problem, base, candidate, start, _TRIAL_STEPS, base.given))
    if other is None or other.cost > base.result.cost:
        return best
    return min(best, fit_full(problem, base, candidate, other), key=lambda one: one.cost)


def _is_bound(candidate: Candidate, result: FilterErrorResult) -> bool:
    """Whether a size of the candidate, but for nothing at all, lies on one of its bounds."""
    parameters = {p.name: p for p in candidate.effect.parameters}
    for name in candidate.sizes:
        value, p = result.value(candidate.parameter(name)), parameters[name]
        if value >= p.high or (value <= p.low and p.low < 0.0):
            return True
    return False


def _by_own_gusts(
    problem: Problem, base: FittedModel, fits: Sequence[tuple[Candidate, FilterErrorResult]]
) -> list[Finalist]:
    """Candidates judged with the noise and turbulence that each of them leaves, the model without them with its own.

    Gusts of a model that lacks something hold some of that: judged by them it weighs too little. All noise is estimated
    from the same flight in the same way, else a candidate gains what the estimate of the noise does.
    """
    found = [_refit_noise(problem, _extended(base, *fit), fit[1]) for fit in fits]
    without = (base.model, base.coefficients, base.effects)
    least = min(_refit_noise(problem, without, base.result, start).cost for start in (base.result, found[0]))
    return [Finalist(candidate, one, 2.0 * (least - one.cost)) for (candidate, _), one in zip(fits, found, strict=True)]


_Built = tuple[Model, Sequence[str], Effects]


def _extended(base: FittedModel, candidate: Candidate, result: FilterErrorResult) -> _Built:
    """The base's model with a candidate as a fit has it, and its free parameters."""
    values = result.values()
    model = extended(base.model, candidate, {name: values[candidate.parameter(name)] for name in candidate.free})
    return model, *_free(base, candidate)


def _refit_noise(
    problem: Problem, built: _Built, result: FilterErrorResult, start: FilterErrorResult | None = None,
    search_s: float | None = SEARCH_S,
) -> FilterErrorResult:  # fmt: skip
    """A model's fit with noise and turbulence of all flights, from those of `start`; as it was where that is lost."""
    near = start or result
    with suppress(EstimationError):
        return build_filter(problem, *built).solve(
            result.values(), near.turbulence, near=near, brief=True, search_s=search_s
        )
    return result


def fit_full(problem: Problem, base: FittedModel, candidate: Candidate, rough: FilterErrorResult) -> FilterErrorResult:
    """The fit with noise and turbulence of its own; as it was where that leads nowhere."""
    return _ended(problem, base, candidate, with_own_noise(problem, base, candidate, rough), rough.cost)


def with_own_noise(
    problem: Problem, base: FittedModel, candidate: Candidate, rough: FilterErrorResult
) -> FilterErrorResult:
    """The fit with noise and turbulence of its own, changed by turns with the rest; as it was where that is no better.

    Gusts that stood for what was missing go on doing so while they and the effect grow and shrink by turns. Where the
    air was still a filter that expects no gusts finds the effect at once: both ways are gone.
    """
    still = _in_still_air(problem, base, candidate, rough) if is_gusty(rough) else None
    ways = [_refit(problem, base, candidate, near, False) for near in (still, rough) if near is not None]
    return min([rough, *(one for one in ways if one is not None)], key=lambda one: one.cost)


def _in_still_air(
    problem: Problem, base: FittedModel, candidate: Candidate, rough: FilterErrorResult
) -> FilterErrorResult | None:
    """A candidate's fit taken on with the noise that it has and no gusts; None where the filter loses the flight."""
    flight = build_filter(problem, *_extended(base, candidate, rough))
    with suppress(EstimationError):
        return flight.solve(rough.values(), Turbulence(FAINT, FAINT), known=rough, max_iterations=_TRIAL_STEPS)
    return None


def _ended(
    problem: Problem, base: FittedModel, candidate: Candidate, own: FilterErrorResult, began: float
) -> FilterErrorResult:
    """A fit with noise of its own brought to its end: where gusts are left that could hold it far short of its best,
    all is estimated together. began: its cost with the noise of the model without it.
    """
    best = own
    for _ in range(_ROUNDS):
        if not is_gusty(best) or began - best.cost < _LITTLE:
            break
        found = _refit(problem, base, candidate, best, True)
        gained = best.cost - found.cost if found is not None else 0.0
        best = found if found is not None and gained > 0.0 else best
        if gained <= _LITTLE:
            break
    return best


def _refit(
    problem: Problem, base: FittedModel, candidate: Candidate, near: FilterErrorResult, together: bool
) -> FilterErrorResult | None:
    """A candidate's fit taken on from where it is, noise and turbulence too; None where the flight is lost."""
    flight = build_filter(problem, *_extended(base, candidate, near))
    with suppress(EstimationError):
        return flight.solve(near.values(), near.turbulence, near=near, brief=not together)
    return None


def _free(base: FittedModel, candidate: Candidate) -> tuple[list[str], list[tuple[str, str]]]:
    return [*base.coefficients, *candidate.coefficients], [*base.effects, *candidate.names]
