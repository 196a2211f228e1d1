"""The search for missing effects: candidates tried, compared, and the one the data insist on added."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from sim_vehicle.model.model_file import Model
from sysid.discrepancy.by_filter_error.candidate_fits import (
    Finalist,
    FittedModel,
    fit_full,
    fit_short,
    rank,
    wald_statistic,
)
from sysid.discrepancy.by_filter_error.filter_scores import filter_gains
from sysid.discrepancy.by_filter_error.lack_of_fit import lack_of_fit
from sysid.discrepancy.candidates import (
    Candidate,
    candidates,
    happens_in_flight,
    stepping_of,
    surprise,
    without_absent,
)
from sysid.discrepancy.identified_effect import (
    Named,
    beside_first,
    nearly,
    unmodelled_memory_gain,
    within_stamps,
)
from sysid.discrepancy.naming_rule import LeftOver, is_too_little_beside, left_of_the_first
from sysid.discrepancy.significance import (
    Significance,
    by_information_criterion,
    is_significant,
    is_unlikely,
    smallest_set,
)
from sysid.errors import EstimationError
from sysid.filter_error.estimation import build_filter
from sysid.filter_error.estimator import FilterErrorResult
from sysid.problem.estimation_problem import Problem, Progress, model_of

# None is tried unless the best promises so much; then those that promise half of that and this share of the best: at
# most so many.
MIN_PROMISE, PROMISE_SHARE, MAX_TRIED = 12.0, 0.1, 8
# Times as much as a candidate gains by the noise of the model without it that it may gain by its own.
_RISE = 3.0
# Steps of a fit without what was named before.
_STEPS_BACK = 12


@dataclass
class Search:
    """State of the search: the flights with their sensor errors, the model so far, its fit, and the effects named.

    given: values of the model's own parameters before they were fitted. dropped: in words, what was named for a while.
    began: half the deviance before anything was named. left: what none of the names explains. whole: what the
    likelihood gained by all names together (twice its logarithm). taken_back: some of them, that the first may explain.
    ruled_out: effects that are known not to be there. nearly: in words, what gained too little for a name at last.
    proposed: effects that were found elsewhere, with values to start from.
    """

    problem: Problem
    model: Model
    coefficients: list[str]
    effects: list[tuple[str, str]]
    result: FilterErrorResult
    began: float
    named: list[Named] = field(default_factory=list)
    given: Mapping[str, float] = field(default_factory=dict)
    dropped: list[str] = field(default_factory=list)
    left: Mapping[str, LeftOver] = field(default_factory=dict)
    whole: float = 0.0
    taken_back: list[str] = field(default_factory=list)
    ruled_out: frozenset[str] = frozenset()
    nearly: str = ""
    proposed: Sequence[Named] = ()

    @property
    def setting(self) -> FittedModel:
        """The model so far with its estimate."""
        # Beside an effect that is there the fitted parameters are the better ones.
        given = {} if self.named else self.given
        return FittedModel(self.model, list(self.coefficients), list(self.effects), self.result, given)

    @property
    def gains(self) -> dict[str, float]:
        """Effect -> what is lost without it."""
        return {one.effect: one.significance.gain for one in self.named}

    @property
    def unmodelled_memory_gain(self) -> float:
        """Gain (twice the log likelihood) that lags named so far may leave to others."""
        return unmodelled_memory_gain(self.named)

    def memory_gain_without(self, left_out: Named) -> float:
        """The same of all the others."""
        return unmodelled_memory_gain([one for one in self.named if one is not left_out])


def extend(search: Search, progress: Progress) -> bool:
    """Try to add one effect. Returns whether one was significant and has been added."""
    problem = search.problem
    choices = [one for one in candidates(problem, search.model) if one.effect.name not in search.ruled_out]
    search.nearly = ""
    progress(0.0, f"a first look at {len(choices)} effects")
    base = search.setting
    worth = [*_promising(problem, base, choices), *_proposed(search, choices)]
    fits: dict[int, tuple[Candidate, FilterErrorResult]] = {}
    for position, (candidate, start) in enumerate(worth):
        progress((position + 1.0) / (len(worth) + 2.0), f"trying {candidate.effect.name}")
        begun = fit_short(problem, base, candidate, start)
        if begun is not None and _is_possible(problem, candidate, begun):
            key = choices.index(candidate)
            fits[key] = min(fits.get(key, (candidate, begun)), (candidate, begun), key=lambda item: item[1].cost)
    tried = sorted(fits.values(), key=lambda item: item[1].cost)
    if not tried:
        return False
    if search.named:
        gain = 2.0 * (base.result.cost - tried[0][1].cost)
        if is_too_little_beside(search.named[0].came_with, _RISE * gain):
            search.dropped.append(beside_first(tried[0][0].effect.name, gain, search.named[0].effect))
            return False
    progress((len(worth) + 1.0) / (len(worth) + 2.0), "fitting the likeliest to the end")
    found = rank(problem, base, tried)
    found = [one for one in found if _is_possible(problem, one.candidate, one.result)]
    if not found:
        return False
    samples = float(sum(np.isfinite(one).sum() for one in base.result.residuals))
    found = [_without_absent(problem, base, one, samples) for one in found]
    sizes = [{name: value for name, (value, _) in values_of(one.candidate, one.result).items()} for one in found]
    significances = by_information_criterion(
        [one.shown for one in found],
        [len(one.candidate.free) for one in found],
        samples,
        [surprise(one.candidate, values) for one, values in zip(found, sizes, strict=True)],
    )
    top = max(range(len(found)), key=lambda i: significances[i].probability)
    best = significances[top]
    candidate, result = found[top].candidate, found[top].result
    if best.gain < search.unmodelled_memory_gain:
        return False
    if not is_significant(best, len(choices)):
        if is_unlikely(best, len(choices)):
            search.nearly = nearly(candidate.effect.name, best, len(choices))
        return False
    probabilities = [(one.candidate.effect.name, w.probability) for one, w in zip(found, significances, strict=True)]
    own = candidate.effect.name
    if search.named and is_too_little_beside(search.named[0].came_with, best.gain):
        search.dropped.append(beside_first(own, best.gain, search.named[0].effect))
        return False
    if words := within_stamps(candidate, values_of(candidate, result), problem.records[0].interval_s):
        search.dropped.append(words)
        return False
    alternatives = tuple(item for item in smallest_set(probabilities) if item[0] != own)
    search.named.append(
        Named(
            candidate,
            best,
            alternatives,
            values_of(candidate, result),
            len(choices),
            best.gain,
        )
    )
    _add(search, candidate, result)
    return True


def _without_absent(problem: Problem, base: FittedModel, whole: Finalist, samples: float) -> Finalist:
    """A finalist without parameters that are as good as absent, where it is likelier without them (see
    `by_information_criterion`).
    """
    fewer = without_absent(whole.candidate, values_of(whole.candidate, whole.result))
    begun = None if fewer is None else fit_short(problem, base, fewer, fewer.starts[0])
    if fewer is None or begun is None:
        return whole
    result = fit_full(problem, base, fewer, begun)
    lost = 2.0 * (result.cost - whole.result.cost)
    price = (len(whole.candidate.free) - len(fewer.free)) * np.log(samples)
    return Finalist(fewer, result, whole.gain - lost) if lost < price else whole


def _is_possible(problem: Problem, candidate: Candidate, result: FilterErrorResult) -> bool:
    """Whether an effect as fitted is one: its moment within a flight, and no less than a step of what goes in steps,
    which is known to half of one.
    """
    values = {name: result.value(candidate.parameter(name)) for name in candidate.free}
    steps = stepping_of(candidate.effect)
    return happens_in_flight(candidate, values, problem) and all(values[name] >= step for name, step in steps.items())


@dataclass(frozen=True)
class _Without:
    """The model and its estimate with one named effect left out, and twice the log likelihood that this costs."""

    coefficients: list[str]
    effects: list[tuple[str, str]]
    model: Model
    result: FilterErrorResult
    gain: float


def eliminate_redundant(search: Search) -> None:
    """Take out, one by one, the effect that costs least where it is not needed beside the others.

    One effect alone can stand for two others together until both are there: lag and misplacement of a vane look like a
    late vane. What stays is judged by what the likelihood gains with it beside all that stays.
    """
    while len(search.named) > 1:
        asked = [(one, _without(search, one)) for one in search.named]
        gains = {one.effect: without.gain for one, without in asked if without is not None}
        search.named = [
            replace(one, significance=_significance(one, gains[one.effect])) if one.effect in gains else one
            for one in search.named
        ]
        needless = [
            (without, one)
            for one, (_, without) in zip(search.named, asked, strict=True)
            if without is not None
            and not (is_significant(one.significance, one.tried) and without.gain > search.memory_gain_without(one))
        ]
        if not needless:
            return
        without, one = min(needless, key=lambda item: item[0].gain)
        _leave_out(search, one, without, "not needed beside the others")


def settle_names(search: Search) -> None:
    """See what is left beside all that was named, then take back what the first name may have left of itself."""
    search.left = lack_of_fit(search.problem, search.setting, search.unmodelled_memory_gain)
    search.whole = 2.0 * (search.began - search.result.cost)
    if len(search.named) == 1:
        # Timing and a bench's errors that were chosen anew with it are its own.
        (one,) = search.named
        search.named = [replace(one, significance=_significance(one, search.whole))]
    for effect in left_of_the_first(search.gains, search.whole):
        # What stays is estimated anew each time.
        one = next(one for one in search.named if one.effect == effect)
        without = _without(search, one)
        if without is not None:
            search.taken_back.append(effect)
            words = f"but it gains {one.significance.gain:.0f}, no more than the first may leave of itself"
            _leave_out(search, one, without, words)


def _significance(one: Named, gain: float) -> Significance:
    """The significance of an effect with another gain, its probability among its alternatives as it was."""
    return replace(
        by_information_criterion([gain], [len(one.candidate.free)], 1.0)[0], probability=one.significance.probability
    )


def _without(search: Search, one: Named) -> _Without | None:
    """What is left where an effect is left out; None where the filter then loses the flights."""
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
        return None
    return _Without(coefficients, effects, model, result, 2.0 * (result.cost - known.cost))


def _leave_out(search: Search, one: Named, without: _Without, why: str) -> None:
    """Take an effect out of the model, and out of what others might be instead."""
    search.named = [
        replace(other, alternatives=tuple(item for item in other.alternatives if item[0] != one.effect))
        for other in search.named
        if other is not one
    ]
    search.coefficients, search.effects, search.model = without.coefficients, without.effects, without.model
    search.dropped.append(f"{one.effect}: named for a while, {why}")
    update_estimate(search, without.result)


def _cost(result: FilterErrorResult) -> float:
    return result.cost


def refit_jointly(search: Search) -> None:
    """Estimate once more where turbulence is, noise and turbulence together with everything else.

    Gains that are held fixed make standard errors of sideslip's derivatives up to three times too small
    (sysid.filter_error.joint_score). What cannot be scored stays as it is.
    """
    flight = build_filter(search.problem, search.model, search.coefficients, search.effects)
    with suppress(EstimationError):
        update_estimate(search, flight.solve(search.result.values(), search.result.turbulence))


def eliminate_insignificant(search: Search) -> None:
    """Take out, one by one, the effect whose sizes are least beyond what chance gives, by the standard errors of
    `refit_jointly` (Wald's test).

    With the gusts held fixed the likelihood gains where it only trades one noise for another; coefficients and gusts
    then explain the flight. Where nothing was sharpened, or a parameter is no size, the likelihood must be enough.
    """
    while search.named and search.result.together:
        borne = [(one, wald_statistic(one.candidate, search.result)) for one in search.named]
        doubtful = [
            (statistic, one)
            for one, statistic in borne
            if statistic is not None and not is_significant(_significance(one, statistic), one.tried)
        ]
        if not doubtful:
            return
        _, one = min(doubtful, key=lambda item: item[0])
        without = _without(search, one)
        if without is None:
            return
        _leave_out(search, one, without, "but its size is within its standard error")
        refit_jointly(search)


def update_estimate(search: Search, result: FilterErrorResult) -> None:
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


def _proposed(search: Search, choices: Sequence[Candidate]) -> list[tuple[Candidate, dict[str, float]]]:
    """Candidates that were found elsewhere and are not named yet, each with its values there."""
    names = {one.effect for one in search.named}
    return [
        (choice, {name: value for name, (value, _) in one.values.items()})
        for one in search.proposed
        for choice in choices
        if one.effect not in names and choice.names == one.candidate.names and choice.free == one.candidate.free
        and choice.effect == one.candidate.effect
    ]  # fmt: skip


def _promising(
    problem: Problem, base: FittedModel, choices: Sequence[Candidate]
) -> list[tuple[Candidate, dict[str, float]]]:
    """Candidates worth a fit, with the start each promises most from."""
    gains = filter_gains(problem, base.model, base.coefficients, base.effects, base.result, choices)
    order = sorted(range(len(choices)), key=lambda i: -gains[i][0])
    best = gains[order[0]][0] if order else 0.0
    if best < MIN_PROMISE:
        return []
    limit = max(0.5 * MIN_PROMISE, PROMISE_SHARE * best)
    return [(choices[i], gains[i][1]) for i in order[:MAX_TRIED] if gains[i][0] >= limit]
