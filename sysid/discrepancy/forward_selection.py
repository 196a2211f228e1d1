"""The search for missing effects: the likeliest is added until none is, then what is not needed is taken back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Generic

from sysid.discrepancy.candidate_fit import Fit, Trial
from sysid.discrepancy.candidates import is_possible
from sysid.discrepancy.comparison import MAX_EFFECTS
from sysid.discrepancy.identified_effect import (
    Named,
    beside_first,
    nearly,
    unmodelled_memory_gain,
    within_stamps,
)
from sysid.discrepancy.naming_rule import EVIDENCE, LeftOver, is_too_little_beside, left_of_the_first
from sysid.discrepancy.significance import (
    Significance,
    by_evidence,
    chance_of,
    is_significant,
    is_unlikely,
    smallest_set,
)
from sysid.problem.estimation_problem import Progress


@dataclass
class SelectionState(Generic[Fit]):
    """State of the search: the model fitted again, `base`, and `fit`, the same with the effects that were named.

    notes: in words, what was named for a while, or nearly. left: what none of the names explains. gains: effect -> what
    is lost without it, twice a log likelihood. whole: what all names gain together. taken_back: some of them, that the
    first may explain. without: a fit, and fits without each effect that is named in it.
    """

    base: Fit
    fit: Fit
    ruled_out: frozenset[str] = frozenset()
    named: list[Named] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    left: Mapping[str, LeftOver] = field(default_factory=dict)
    gains: dict[str, float] = field(default_factory=dict)
    whole: float = 0.0
    taken_back: list[str] = field(default_factory=list)
    without: tuple[Fit, dict[str, Fit | None]] | None = None

    def fits_without(self) -> dict[str, Fit | None]:
        """Effect -> the fit without it, None where that is lost."""
        if self.without is None or self.without[0] is not self.fit:
            self.without = self.fit, {one.effect: self.fit.without(one.candidate) for one in self.named}
        return self.without[1]

    def leave_out(self, one: Named, rest: Fit, why: str) -> None:
        """Take an effect back, and out of what others might be instead. rest: the fit without it."""
        self.named = [
            replace(other, alternatives=tuple(item for item in other.alternatives if item[0] != one.effect))
            for other in self.named
            if other is not one
        ]
        self.fit = rest
        self.notes.append(f"{one.effect}: named for a while, {why}")


def select(base: Fit, ruled_out: frozenset[str], progress: Progress) -> SelectionState[Fit]:
    """Effects named beside a fitted model, and what is left. ruled_out: effects that are known not to be there."""
    found = SelectionState(base, base, ruled_out)
    parts = MAX_EFFECTS + 1.0
    while len(found.named) < MAX_EFFECTS:
        if not _extend(found, partial(_part_of, progress, len(found.named), parts)):
            break
    _drop_redundant(found)
    progress(1.0 - 1.0 / parts, "what is left without a name")
    _drop_doubtful(found)
    _settle(found)
    return found


def _part_of(progress: Progress, done: int, parts: float, share: float, text: str) -> None:
    progress((done + share) / parts, text)


def _extend(found: SelectionState[Fit], progress: Progress) -> bool:
    """Add the likeliest effect if it is significant; returns whether one was added."""
    choices = [one for one in found.fit.choices() if one.effect.name not in found.ruled_out]
    count, records = len(choices), found.fit.problem.records
    progress(0.0, f"a first look at {count} effects")
    tried = [one for one in found.fit.trials(choices, progress) if is_possible(one.candidate, one.values, records)]
    if not tried:
        return False
    each = by_evidence([(one.evidence, one.gain, len(one.values)) for one in tried])
    top = max(range(len(tried)), key=lambda i: each[i].probability)
    best, significance, own = tried[top], each[top], tried[top].candidate.effect.name
    if _is_conclusive(best, significance, count):
        if found.named and is_too_little_beside(found.named[0].came_with, best.gain):
            found.notes.append(beside_first(own, best.gain, found.named[0].effect))
            return False
        if best.gain < unmodelled_memory_gain(found.named):
            return False
        if words := within_stamps(best.candidate, best.values, records[0].interval_s):
            found.notes.append(words)
            return False
        progress(1.0, f"standard errors of {own}")
        significance = found.fit.confirmed(best, significance)
    if not _is_conclusive(best, significance, count):
        if is_unlikely(significance, count):
            found.notes.append(nearly(own, significance, count))
        return False
    every = [(one.candidate.effect.name, w.probability) for one, w in zip(tried, each, strict=True)]
    alternatives = tuple(item for item in smallest_set(every) if item[0] != own)
    found.named.append(Named(best.candidate, significance, alternatives, best.values, count, best.gain))
    found.fit = found.fit.with_named(best)
    return True


def _is_conclusive(trial: Trial[Fit], significance: Significance, choices: int) -> bool:
    return trial.evidence > EVIDENCE and is_significant(significance, choices)


def _drop_redundant(found: SelectionState[Fit]) -> None:
    """Take out, one by one, the effect that costs least where it is not needed beside the others.

    One effect alone can stand for two others together until both are there: lag and misplacement of a vane look like a
    late vane. What stays is judged by what is gained with it beside all that stays.
    """
    while len(found.named) > 1:
        needless = []
        for one in found.named:
            rest = found.fits_without()[one.effect]
            if rest is not None and not _is_needed(found, one, rest):
                needless.append((rest.cost, one, rest))
        if not needless:
            return
        _, one, rest = min(needless, key=lambda item: item[0])
        found.leave_out(one, rest, "not needed beside the others")


def _is_needed(found: SelectionState[Fit], one: Named, rest: Fit) -> bool:
    gain = 2.0 * (rest.cost - found.fit.cost)
    others = [other for other in found.named if other is not one]
    return (
        found.fit.evidence - rest.evidence > EVIDENCE
        and is_significant(Significance(1.0, gain, chance_of(gain, len(one.candidate.free))), one.tried)
        and gain > unmodelled_memory_gain(others)
    )


def _drop_doubtful(found: SelectionState[Fit]) -> None:
    """Take out, one by one, the effect whose size is most within a standard error that counts the noise as unknown.

    With the noise held fixed the likelihood gains where it only trades one noise for another.
    """
    while found.named:
        found.fit = found.fit.sharpened()
        one = found.fit.doubtful(found.named)
        rest = None if one is None else found.fit.without(one.candidate)
        if one is None or rest is None:
            return
        found.leave_out(one, rest, "but its size is within its standard error")
    found.fit = found.base


def _settle(found: SelectionState[Fit]) -> None:
    """See what is left beside all that was named, then take back what the first name may have left of itself."""
    found.left = found.fit.left(unmodelled_memory_gain(found.named))
    found.whole = 2.0 * (found.base.cost - found.fit.cost)
    found.gains = {one.effect: found.whole for one in found.named}
    if len(found.named) > 1:
        now = found.fit.cost
        rests = {effect: rest for effect, rest in found.fits_without().items() if rest is not None}
        found.gains |= {effect: 2.0 * (rest.cost - now) for effect, rest in rests.items()}
    for effect in left_of_the_first(found.gains, found.whole):
        # What stays is estimated anew each time.
        one = next(one for one in found.named if one.effect == effect)
        rest = found.fit.without(one.candidate)
        if rest is not None:
            gain = found.gains.pop(effect)
            found.taken_back.append(effect)
            found.leave_out(one, rest, f"but it gains {gain:.0f}, no more than the first may leave of itself")
    if not found.named:
        found.fit = found.base
    found.named = [replace(one, values=found.fit.values_of(one.candidate)) for one in found.named]
