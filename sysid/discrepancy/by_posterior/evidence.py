"""The evidence of candidate effects: what each gains when fitted, and whether that is enough for a name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from sysid.discrepancy.by_posterior.group_fits import GroupFit, is_size
from sysid.discrepancy.by_posterior.naming_rules import RULES
from sysid.discrepancy.candidates import Candidate
from sysid.discrepancy.significance import Significance, is_significant
from sysid.numerics.normal_equations import inverse

Groups = Mapping[str, GroupFit]


@dataclass(frozen=True)
class Trial:
    """A candidate fitted in one group, `own`. groups: all of them with it. values: value and standard deviation of its
    parameters.

    gain: twice the log likelihood, as far as its sizes bear it out; evidence: twice the log evidence that it gains.
    """

    candidate: Candidate
    own: str
    groups: Groups
    values: Mapping[str, tuple[float, float]]
    gain: float
    evidence: float


def borne_out(candidate: Candidate, values: Mapping[str, tuple[float, float]]) -> float:
    """What the sizes of an effect bear out of a gain: one far beyond their standard errors is of a search that went on
    elsewhere. Infinite for limits, which have no size that vanishes.
    """
    sizes = [candidate.coefficients or is_size(candidate.effect.parameter(name)) for name in values]
    if not all(sizes):
        return float(np.inf)
    return RULES.borne_out * float(sum((value / max(std, 1e-300)) ** 2 for value, std in values.values()))


def significances(tried: Sequence[Trial]) -> list[Significance]:
    """Posterior probabilities by the evidence, "no effect" being one of them."""
    scores = np.array([0.0, *(0.5 * min(one.evidence, one.gain) for one in tried)])
    shares = np.exp(scores - scores.max())
    return [
        Significance(float(share), one.gain, float(special.chdtrc(len(one.values), max(one.gain, 0.0))))
        for share, one in zip(shares[1:] / shares.sum(), tried, strict=True)
    ]


def with_full_bars(trial: Trial, significance: Significance) -> Significance:
    """The significance with what the gain comes to where bars count all: the colour that the noise keeps, what no
    structure holds, what was taken as known. A likelihood that knows of none of these grows with every second flown.
    """
    result = trial.groups[trial.own].ended().result
    places = [result.names.index(trial.candidate.parameter(name)) for name in trial.values]
    here = np.ix_(places, places)
    full, white = result.covariance[here], result.fisher[here]
    gain = trial.gain * min(1.0, *(np.diag(white) / np.diag(full)).tolist())
    if np.isfinite(borne_out(trial.candidate, trial.values)):
        values = result.theta[places]
        gain = min(gain, float(values @ inverse(full) @ values))
    return Significance(significance.probability, gain, float(special.chdtrc(len(places), max(gain, 0.0))))


def is_conclusive(trial: Trial, significance: Significance, choices: int) -> bool:
    return trial.evidence > 2.0 * RULES.evidence and is_significant(significance, choices)
