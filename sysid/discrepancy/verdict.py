"""The verdict of a comparison and what it rests on, and with it what the comparison comes to."""

from __future__ import annotations

import numpy as np
from scipy import special

from sysid.discrepancy.candidate_fit import Fit
from sysid.discrepancy.comparison import Compared, Comparison, Outcome
from sysid.discrepancy.forward_selection import SelectionState
from sysid.discrepancy.gap import widening
from sysid.discrepancy.identified_effect import impossible, reason
from sysid.discrepancy.naming_rule import CHANCE, WIDER, Explained, Judgement
from sysid.discrepancy.wording import moved_words
from sysid.numerics.normal_equations import inverse


def outcome(of: Comparison[Fit], found: SelectionState[Fit]) -> Outcome:
    """What a search comes to. Raises SysidError subclasses in one line."""
    used = of.used(found.fit)
    verdict = verdict_of(of, found, used)
    if verdict.name == "unexplained" and found.named:
        # A wrong name is worse than none: what was likeliest stands in the reasons.
        found.named, found.fit = [], found.base
        used = of.used(found.fit)
    model, lacking = of.whole_model(found.fit)
    return Outcome(
        of.method, verdict, tuple(found.named), model, found.ruled_out, used, of.judged(found.fit),
        of.turbulence(found.fit), of.quality, (*of.warnings, *lacking),
    )  # fmt: skip


def verdict_of(of: Comparison[Fit], found: SelectionState[Fit], used: Compared) -> Judgement:
    """Judgement, and what it rests on in words."""
    explained = Explained(found.gains, found.whole, found.left, found.taken_back)
    wrong = impossible(found.named)
    reasons = [*(reason(named) for named in found.named), *found.notes, *of.remarks(found.fit), *explained.reasons()]
    reasons += wrong
    if found.named and (lost := of.lost(found.fit)):
        reasons.append(lost)
        return Judgement("unexplained", reasons, explained)
    if explained.is_right and not wrong:
        wider = widening(used, of.outputs)
        if wider < WIDER:
            return Judgement("missing_effect", reasons, explained)
        reasons.append(f"with what was named the gap on these flights is {wider:.2f} times as wide")
    if found.left or found.named:
        return Judgement("unexplained", reasons, explained)
    # Wald's test of the model's own parameters.
    away, covariance = of.moved()
    distance = float(away @ inverse(covariance) @ away) if away.size else 0.0
    chance = float(special.chdtrc(away.size, max(distance, 0.0))) if away.size else 1.0
    reasons.append(moved_words(distance, int(np.size(away)), chance))
    return Judgement("parameter_error" if chance < CHANCE else "none", reasons, explained)
