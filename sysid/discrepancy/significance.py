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


def chance_of(gain: float, parameters: int) -> float:
    """Chance of a gain by so many parameters where nothing is missing (chi-squared)."""
    return float(special.chdtrc(parameters, max(gain, 0.0)))


def by_evidence(tried: Sequence[tuple[float, float, int]]) -> list[Significance]:
    """Significance of candidates by their evidence, "no effect" being one of them.

    tried: of each the logarithm of the evidence that it gains, twice the log likelihood that it gains, and how many
    parameters it adds.
    """
    top = max([0.0, *(evidence for evidence, _, _ in tried)])
    shares = [math.exp(evidence - top) for evidence, _, _ in tried]
    total = math.exp(-top) + sum(shares)
    return [
        Significance(share / total, gain, chance_of(gain, parameters))
        for share, (_, gain, parameters) in zip(shares, tried, strict=True)
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
