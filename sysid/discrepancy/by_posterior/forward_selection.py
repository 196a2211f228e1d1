"""The search for missing effects by the posterior: candidates looked at, the best fitted, the likeliest added."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from sim_vehicle.model.model_file import Model
from sysid.discrepancy.by_posterior.evidence import (
    Trial,
    borne_out,
    is_conclusive,
    significances,
    with_full_bars,
)
from sysid.discrepancy.by_posterior.group_fits import GroupFit
from sysid.discrepancy.by_posterior.naming_rules import RULES
from sysid.discrepancy.by_posterior.screening import PredictedGain, RestartGain, promises, second_looks
from sysid.discrepancy.candidates import Candidate, candidates, stepping_of, without_absent
from sysid.discrepancy.identified_effect import Named, beside_first, nearly, within_stamps
from sysid.discrepancy.naming_rule import KNOWN_TO, LeftOver, is_too_little_beside, left_of_the_first
from sysid.discrepancy.significance import NAMING_P_VALUE, Significance, is_unlikely, smallest_set
from sysid.discrepancy.smooth_terms import explained_by_axis, smooth_terms
from sysid.discrepancy.wording import chance_text
from sysid.problem.estimation_problem import Problem, Progress


@dataclass
class SelectionState:
    """State of the search.

    given: values of the model's coefficients and parameters of effects before anything was fitted. aliases: whether
    effects that coefficients all but imitate are looked at. left: axis -> what smooth terms of it would still gain.
    gains: effect that was named -> what is lost without it, twice a log likelihood. whole: what all names gain
    together. taken_back: some of them, that the first may explain. seen: by group its fit, and what it was promised by
    each candidate.
    """

    problem: Problem
    model: Model
    groups: dict[str, GroupFit]
    ruled_out: frozenset[str]
    given: Mapping[str, float]
    aliases: bool = False
    named: list[Named] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    left: dict[str, LeftOver] = field(default_factory=dict)
    gains: dict[str, float] = field(default_factory=dict)
    whole: float = 0.0
    taken_back: list[str] = field(default_factory=list)
    seen: dict[str, tuple[GroupFit, dict[str, tuple[PredictedGain, RestartGain | None]]]] = field(default_factory=dict)


def search(found: SelectionState, most: int, progress: Progress) -> None:
    """Name effects, one after the other, until none is significant; then what is left without a name."""
    began = _deviance(found.groups)
    while len(found.named) < most:
        if not _extend(found, partial(_part_of, progress, len(found.named), most + 1.0)):
            break
    _eliminate(found)
    progress(1.0 - 1.0 / (most + 1.0), "what is left without a name")
    _look_at_the_rest(found)
    found.whole = began - _deviance(found.groups)
    _settle(found)


def _deviance(groups: Mapping[str, GroupFit]) -> float:
    """Twice the negative log likelihood of all groups, noise estimated at each fit."""
    return 2.0 * sum(fit.posterior.profile_cost(fit.theta) for fit in groups.values())


def _part_of(progress: Progress, done: int, of: float, share: float, text: str) -> None:
    progress((done + share) / of, text)


def _choices(found: SelectionState) -> list[Candidate]:
    """Every effect that the flights could show, from its own starts. What coefficients all but imitate is one of them
    in flights of the textbooks alone: a structure that lacks a term would be reported as the term's imitation.
    """
    kept = []
    for one in candidates(found.problem, found.model):
        if one.effect.name in found.ruled_out or (one.effect.alias and not found.aliases):
            continue
        kept.append(replace(one, starts=one.effect.starts()) if stepping_of(one.effect) else one)
    return kept


def _extend(found: SelectionState, progress: Progress) -> bool:
    """Add the likeliest effect if it is significant; returns whether one did."""
    choices = _choices(found)
    progress(0.0, f"a first look at {len(choices)} effects")
    looked = {group: _looked(found, group, choices) for group in found.groups}
    promised = {group: [first for first, _ in of] for group, of in looked.items()}
    looks = {group: [second for _, second in of] for group, of in looked.items()}
    total = [sum(max(of[i].gain, 0.0) for of in promised.values()) for i in range(len(choices))]
    order = sorted(range(len(choices)), key=lambda i: -total[i])
    limit = max(RULES.least_promise, RULES.promise_share * total[order[0]]) if order else np.inf
    worth = [i for i in order[: RULES.most_tried] if total[i] >= limit]
    if worth:
        # What coefficients imitate shows in no slope, only in its curvature.
        worth += [i for i in order if choices[i].effect.by_curvature and i not in worth]
    again = _worth_a_second_look(looks)
    tried: list[Trial] = []
    for count, i in enumerate([*worth, *(i for i, _ in again)]):
        progress((count + 1.0) / (len(worth) + len(again) + 1.0), f"trying {choices[i].effect.name}")
        of_groups = {group: of[i] for group, of in promised.items()}
        group = again[count - len(worth)][1] if count >= len(worth) else None
        one = _tried(found, choices[i], of_groups, None if group is None else (group, looks[group][i]))
        if one is not None:
            tried.append(one)
    tried = _likeliest_of_each(tried)
    if not tried:
        return False
    each = significances(tried)
    top = max(range(len(tried)), key=lambda i: tried[i].evidence)
    best, significance = tried[top], each[top]
    if is_conclusive(best, significance, len(choices)):
        progress(1.0, f"standard errors of {best.candidate.effect.name}")
        significance = with_full_bars(best, significance)
    if not is_conclusive(best, significance, len(choices)):
        if is_unlikely(significance, len(choices)):
            found.notes.append(nearly(best.candidate.effect.name, significance, len(choices)))
        return False
    if found.named and is_too_little_beside(found.named[0].came_with, best.gain):
        found.notes.append(beside_first(best.candidate.effect.name, best.gain, found.named[0].effect))
        return False
    if words := within_stamps(best.candidate, best.values, found.problem.records[0].interval_s):
        found.notes.append(words)
        return False
    own = best.candidate.effect.name
    every = [(one.candidate.effect.name, w.probability) for one, w in zip(tried, each, strict=True)]
    alternatives = tuple(item for item in smallest_set(every) if item[0] != own)
    found.named.append(Named(best.candidate, significance, alternatives, best.values, len(choices), best.gain))
    found.groups = dict(best.groups)
    found.model = found.model.with_effect(best.candidate.effect, {name: v for name, (v, _) in best.values.items()})
    return True


def _looked(
    found: SelectionState, group: str, choices: Sequence[Candidate]
) -> list[tuple[PredictedGain, RestartGain | None]]:
    """What candidates promise a group of axes, as it was found before where nothing of the group has changed since."""
    fit = found.groups[group]
    if group not in found.seen or found.seen[group][0] is not fit:
        first = promises(fit, choices)
        both = zip(first, second_looks(fit, choices, first, found.given), strict=True)
        found.seen[group] = (fit, {_key(one): of for one, of in zip(choices, both, strict=True)})
    known = found.seen[group][1]
    return [known[_key(one)] for one in choices]


def _key(candidate: Candidate) -> str:
    return candidate.effect.title


def _worth_a_second_look(looks: Mapping[str, Sequence[RestartGain | None]]) -> list[tuple[int, str]]:
    """Candidates that come nearest to the flight from elsewhere, and the group of axes in which they do."""
    found: list[tuple[int, str]] = []
    for group, of in looks.items():
        better = [(one.cost, i) for i, one in enumerate(of) if one is not None and one.gain >= RULES.least_second_look]
        found += [(i, group) for _, i in sorted(better)[: RULES.most_second_looks]]
    return found


def _likeliest_of_each(tried: Sequence[Trial]) -> list[Trial]:
    """Trials without those that another start of the same candidate has left behind."""
    best: dict[str, Trial] = {}
    for one in tried:
        name = _key(one.candidate)
        if name not in best or one.evidence > best[name].evidence:
            best[name] = one
    return list(best.values())


def _tried(
    found: SelectionState,
    candidate: Candidate,
    promised: Mapping[str, PredictedGain],
    look: tuple[str, RestartGain | None] | None,
) -> Trial | None:
    """A candidate fitted, as `_fitted` does, without parameters that are as good as absent where that is likelier."""
    whole = _fitted(found, candidate, promised, look)
    fewer = None if whole is None else without_absent(candidate, whole.values)
    if whole is None or fewer is None:
        return whole
    (values,) = fewer.starts
    if look is not None and look[1] is not None:
        look = (look[0], replace(look[1], values=values))
    part = _fitted(found, fewer, {group: replace(one, values=values) for group, one in promised.items()}, look)
    return part if part is not None and part.evidence > whole.evidence else whole


def _fitted(
    found: SelectionState,
    candidate: Candidate,
    promised: Mapping[str, PredictedGain],
    look: tuple[str, RestartGain | None] | None,
) -> Trial | None:
    """A candidate fitted in the group that it promises most, and flown as it is found there in the others.

    look: the group in which it is begun from elsewhere, and where.
    """
    own = max(promised, key=lambda group: promised[group].gain)
    after: GroupFit | None
    if look is not None and look[1] is not None:
        own, begin = look[0], look[1]
        after = found.groups[own].with_effect(candidate, {**promised[own].values, **begin.values}, begin.start)
    else:
        after = found.groups[own].with_effect(candidate, promised[own].values)
    if after is None:
        return None
    values, stds = after.values(), after.stds()
    known = {name: (values[candidate.parameter(name)], stds[candidate.parameter(name)]) for name in candidate.free
             if candidate.parameter(name) in values}  # fmt: skip
    groups = {**found.groups, own: after}
    for group, promise in promised.items():
        if group != own and promise.acts and not candidate.coefficients:
            other = found.groups[group].flying(candidate, {name: value for name, (value, _) in known.items()})
            if other is None:
                return None
            groups[group] = other
    gain = _deviance(found.groups) - _deviance(groups)
    evidence = 2.0 * sum(fit.evidence - found.groups[group].evidence for group, fit in groups.items())
    return Trial(candidate, own, groups, known, min(gain, borne_out(candidate, known)), evidence)


def _eliminate(found: SelectionState) -> None:
    """Take out, one by one, what is not needed beside the others."""
    while len(found.named) > 1:
        costs = []
        for named in found.named:
            groups = _without(found, named)
            if groups is not None:
                cost = 2.0 * sum(found.groups[group].evidence - fit.evidence for group, fit in groups.items())
                costs.append((cost, named, groups))
        if not costs:
            return
        cost, named, groups = min(costs, key=lambda item: item[0])
        if cost > 2.0 * RULES.evidence:
            return
        _leave_out(found, named, groups, "not needed beside the others")


def _settle(found: SelectionState) -> None:
    """Take back what the first name may have left of itself; what each of the others costs is known then."""
    found.gains = {one.effect: found.whole for one in found.named}
    if len(found.named) == 1:
        return
    now = _deviance(found.groups)
    for one in found.named:
        if (groups := _without(found, one)) is not None:
            found.gains[one.effect] = _deviance(groups) - now
    for effect in left_of_the_first(found.gains, found.whole):
        # What stays is estimated anew each time.
        one = next(one for one in found.named if one.effect == effect)
        groups = _without(found, one)
        if groups is not None:
            gain = found.gains.pop(effect)
            found.taken_back.append(effect)
            _leave_out(found, one, groups, f"but it gains {gain:.0f}, no more than the first may leave of itself")


def _without(found: SelectionState, named: Named) -> dict[str, GroupFit] | None:
    """All groups without an effect that was named; None where one is lost."""
    rest = {group: fit.without(named.candidate) for group, fit in found.groups.items()}
    groups = {group: fit for group, fit in rest.items() if fit is not None}
    return groups if len(groups) == len(rest) else None


def _leave_out(found: SelectionState, named: Named, groups: dict[str, GroupFit], why: str) -> None:
    """Take a name back, and say why. groups: all of them `without` it."""
    found.named = [one for one in found.named if one is not named]
    found.groups = groups
    gone = set(named.candidate.coefficients)
    found.model = replace(
        found.model,
        coefficients={name: entry for name, entry in found.model.coefficients.items() if name not in gone},
        effects=tuple(e for e in found.model.effects if gone or e.name != named.effect),
    )
    found.notes.append(f"{named.effect}: named for a while, {why}")


def _look_at_the_rest(found: SelectionState) -> None:
    """Smooth terms of every axis, which no single effect is: what gains by them has no name."""
    terms = smooth_terms(found.problem, found.model)
    for group, fit in found.groups.items():
        own = [one for one in terms if fit.takes(one.free[0])]
        explained = explained_by_axis(fit.names, fit.theta[: len(fit.names)], fit.covariance())
        for one, promise in zip(own, promises(fit, own), strict=True):
            if promise.gain < RULES.least_promise:
                continue
            after = fit.with_effect(one, promise.values)
            if after is None:
                continue
            gain = 2.0 * (fit.posterior.profile_cost(fit.theta) - after.posterior.profile_cost(after.theta))
            known = KNOWN_TO * explained.get(one.effect.name, 0.0)
            if gain < known or after.evidence - fit.evidence < RULES.evidence:
                continue
            values, stds = after.values(), after.stds()
            trial = Trial(
                one, group, {group: after}, {name: (values[name], stds[name]) for name in one.free}, gain, 0.0
            )
            significance = with_full_bars(trial, Significance(1.0, gain, 0.0))
            if significance.p_value * len(terms) < NAMING_P_VALUE:
                words = f"smooth terms gain {significance.gain:.0f}, {chance_text(significance.p_value)}"
                found.left[one.effect.name] = LeftOver(words, gain)
