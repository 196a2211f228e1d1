"""The verdict of a comparison by filter error, and the tests that it rests on."""

from __future__ import annotations

import numpy as np
from scipy import special

from sysid.discrepancy.by_filter_error.baseline import (
    Baseline,
    Flights,
)
from sysid.discrepancy.by_filter_error.forward_selection import (
    Search,
)
from sysid.discrepancy.comparison_types import Compared
from sysid.discrepancy.gap import fixed_model, widening
from sysid.discrepancy.identified_effect import impossible, reason
from sysid.discrepancy.naming_rule import CHANCE, WIDER, Explained, Judgement
from sysid.discrepancy.wording import moved_words
from sysid.filter_error.estimator import FilterErrorResult
from sysid.numerics.normal_equations import inverse
from sysid.problem.free_run import Fixed

# Turbulence, m/s, from which on gains that are held fixed make standard errors of sideslip's derivatives too small
# (sysid.discrepancy.by_filter_error.forward_selection.refit_jointly), and what those are multiplied with before
# coefficients are called wrong.
_GUSTS, _FIXED_GAINS = 0.02, 2.0


def is_rough(result: FilterErrorResult) -> bool:
    """Whether the air was rough enough for gains that are held fixed to matter."""
    return max(result.turbulence.vertical, result.turbulence.horizontal) > _GUSTS


def verdict_of(used: Flights, base: Baseline, search: Search) -> Judgement:
    """Judgement and the tests it rests on, in words."""
    reasons = [*(reason(named) for named in search.named), *search.dropped, *([search.nearly] if search.nearly else [])]
    if is_rough(search.result):
        gusts = search.result.turbulence
        reasons.append(
            f"turbulence of {gusts.horizontal:.2f} m/s, {gusts.vertical:.2f} up and down, is counted as process noise"
        )
    explained = Explained(search.gains, search.whole, search.left, search.taken_back)
    reasons += explained.reasons()
    wrong = impossible(search.named)
    reasons += wrong
    if explained.is_right and not wrong:
        stages = {"before": refitted_model(used, base), "after": found_model(used, search)}
        air = search.result.turbulence
        wider = widening(Compared(tuple(used.prepared), base.problem.motion, stages, used.compatible, air))
        if wider < WIDER:
            return Judgement("missing_effect", reasons, explained)
        reasons.append(f"with what was named the gap on these flights is {wider:.2f} times as wide")
    if search.left or search.named:
        return Judgement("unexplained", reasons, explained)
    moved, chance = _moved(base)
    reasons.append(moved_words(moved, len(base.names) + len(base.effects), chance))
    return Judgement("parameter_error" if chance < CHANCE else "none", reasons, explained)


def refitted_model(used: Flights, base: Baseline) -> Fixed:
    """The model that was given, fitted again, for the gap."""
    return fixed_model(base.problem, base.refitted, base.before, used.compatible)


def found_model(used: Flights, search: Search) -> Fixed:
    """The model with what was named, for the gap."""
    return fixed_model(search.problem, search.model, search.result, used.compatible)


def _moved(base: Baseline) -> tuple[float, float]:
    """How far the model's own parameters are from those given (Wald's test), and the chance of that."""
    values = base.own_values
    every = [parameter.name for parameter in base.before.parameters]
    names = [*base.names, *(f"{effect}.{name}" for effect, name in base.effects)]
    places = [every.index(name) for name in names]
    away = base.before.theta[places] - np.array([values[name] for name in names])
    distance = float(away @ inverse(base.before.covariance[np.ix_(places, places)]) @ away)
    if is_rough(base.before):
        distance /= _FIXED_GAINS**2
    return distance, float(special.chdtrc(len(places), max(distance, 0.0)))
