"""How strongly the data speak for one model against another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from scipy import special

# Chance, over all candidates together, of naming an effect that is not there.
FALSE_ALARM = 1e-3
# An effect is named from five standard errors on (the chance of that, one parameter): the size from which a flight is
# said to identify it at all.
NAMING_P_VALUE = float(special.chdtrc(1, 5.0**2))


@dataclass(frozen=True)
class Significance:
    """A candidate's posterior probability and how much it gained.

    gain: twice the log likelihood ratio against the model without the effect, in independent samples.
    p_value: of that gain by chance, before the number of candidates is allowed for.
    """

    probability: float
    gain: float
    p_value: float


def by_information_criterion(
    gains: Sequence[float], sizes: Sequence[int], samples: float, surprises: Sequence[float] = ()
) -> list[Significance]:
    """Significance of candidates by the Bayesian information criterion, "no effect" being one of them.

    gains: twice the log likelihood that each gains. sizes: parameters that each adds. samples: independent ones.
    surprises: twice the log likelihood that each has lost before the flight, none by default.
    """
    lost = surprises or [0.0] * len(gains)
    scores = [0.0]
    scores += [0.5 * (g - s - k * math.log(samples)) for g, s, k in zip(gains, lost, sizes, strict=True)]
    top = max(scores)
    shares = [math.exp(score - top) for score in scores]
    total = sum(shares)
    return [
        Significance(share / total, gain, float(special.chdtrc(k, max(gain, 0.0))))
        for share, gain, k in zip(shares[1:], gains, sizes, strict=True)
    ]


def is_unlikely(significance: Significance, candidates: int) -> bool:
    """Whether a gain is beyond what the best of so many candidates gains by chance (Bonferroni)."""
    return significance.p_value * max(candidates, 1) < FALSE_ALARM


def is_significant(significance: Significance, candidates: int) -> bool:
    """Whether a gain is enough for a name: unlikely by chance, and as far out as five standard errors."""
    return significance.p_value < NAMING_P_VALUE and is_unlikely(significance, candidates)


def smallest_set(probabilities: Sequence[tuple[str, float]], share: float = 0.95) -> list[tuple[str, float]]:
    """The fewest names, likeliest first, whose probabilities add up to `share`."""
    ordered = sorted(probabilities, key=lambda item: -item[1])
    chosen: list[tuple[str, float]] = []
    total = 0.0
    for name, probability in ordered:
        if chosen and total >= share:
            break
        chosen.append((name, probability))
        total += probability
    return chosen
