"""The verdict of a comparison by the posterior, and the reasons for it."""

from __future__ import annotations

import numpy as np
from scipy import special

from sim_vehicle.model.model_file import Model
from sysid.discrepancy.by_posterior.forward_selection import SelectionState
from sysid.discrepancy.comparison_types import Asked, Compared
from sysid.discrepancy.gap import widening
from sysid.discrepancy.identified_effect import impossible, reason
from sysid.discrepancy.naming_rule import CHANCE, WIDER, Explained, Judgement
from sysid.discrepancy.wording import moved_words
from sysid.numerics.normal_equations import inverse
from sysid.posterior.estimates import PosteriorEstimate

# What is estimated beside the coefficients: reported where it is so many standard errors off, and
# where the flight determines it so much better than was known before.
_SEEN, _INFORMED = 3.0, 0.5
# Name -> what is reported where it is above its null and below it, "" for nothing, the null, the factor to
# its unit.
_BESIDE = {
    "servo_delay": ("the servos are delayed by {:.0f} ms", "", 0.0, 1e3),
    "servo_lag": ("the servos lag by {:.0f} ms", "", 0.0, 1e3),
    "servo_backlash": ("the linkages have {:.2f} deg of play to either side", "", 0.0, 180.0 / np.pi),
    "airspeed_error": ("the airspeed reads {:.1f} % too much", "the airspeed reads {:.1f} % too little", 0.0, 100.0),
    "alpha_scale": ("the alpha vane turns {:.0f} % too far", "the alpha vane turns {:.0f} % too little", 1.0, 100.0),
    "beta_scale": ("the beta vane turns {:.0f} % too far", "the beta vane turns {:.0f} % too little", 1.0, 100.0),
    "vane_clock": ("the vanes are stamped {:.0f} ms late", "the vanes are stamped {:.0f} ms early", 0.0, 1e3),
    "thrust_error": ("the thrust reads {:.0f} % too much", "the thrust reads {:.0f} % too little", 0.0, 100.0),
}


def verdict_of(asked: Asked, base: PosteriorEstimate, found: SelectionState, used: Compared) -> Judgement:
    """Judgement, and what it rests on in words."""
    reasons = [*(reason(named) for named in found.named), *found.notes, *_nuisances(base)]
    explained = Explained(found.gains, found.whole, found.left, found.taken_back)
    reasons += explained.reasons()
    wrong = impossible(found.named)
    reasons += wrong
    if explained.is_right and not wrong:
        # Airspeed and attitude were imposed, and what they are off by was not asked for.
        asked_of = {name for fit in found.groups.values() for name in fit.posterior.model.outputs}
        wider = widening(used, asked_of)
        if wider < WIDER:
            return Judgement("missing_effect", reasons, explained)
        reasons.append(f"with what was named the gap on these flights is {wider:.2f} times as wide")
    if found.left or found.named:
        return Judgement("unexplained", reasons, explained)
    distance, count = _moved(asked.model, base)
    chance = float(special.chdtrc(count, distance)) if count else 1.0
    reasons.append(moved_words(distance, count, chance))
    return Judgement("parameter_error" if chance < CHANCE else "none", reasons, explained)


def _moved(model: Model, base: PosteriorEstimate) -> tuple[float, int]:
    """How far the estimates are from what was given (Wald's test), and of how many coefficients."""
    given = model.values()
    names = [name for name in base.joint.names if name in given and name not in base.not_believed]
    places = [base.joint.names.index(name) for name in names]
    away = base.joint.mean[places] - np.array([given[name] for name in names])
    return float(away @ inverse(base.joint.covariance[np.ix_(places, places)]) @ away), len(names)


def _nuisances(base: PosteriorEstimate) -> list[str]:
    """What servos and sensors do that the model does not hold, in words, the surer group of each."""
    surest = {one.name: one for one in sorted(base.nuisances, key=lambda one: -one.std)}
    sentences = []
    for name, (more, less, null, factor) in _BESIDE.items():
        one = surest.get(name)
        if one is None or abs(one.value - null) < _SEEN * one.std or one.std > _INFORMED * one.prior_std:
            continue
        if words := more if one.value > null else less:
            sentences.append(
                f"{words.format(factor * abs(one.value - null))} (± {factor * one.std:.2g}), beside the model"
            )
    return sentences
