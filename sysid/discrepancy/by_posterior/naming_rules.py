"""What decides of names and verdicts on flights as the field gives them: every threshold, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Rules:
    """Thresholds. Gains are twice a log likelihood.

    least_promise: below which no candidate is fitted (3.5 standard errors of one size). promise_share: of the best
    promise, below which a candidate is out of the race. most_tried: candidates fitted at each step.
    least_second_look, most_second_looks: the same from elsewhere, where nothing is at its best, in each group of
    axes. evidence: log evidence that a name needs (150 to 1: "very strong", Kass & Raftery, J. Am. Stat. Assoc. 90,
    1995). borne_out: times Wald's statistic that a gain may be."""

    least_promise: float = 12.0
    promise_share: float = 0.1
    most_tried: int = 6
    least_second_look: float = 40.0
    most_second_looks: int = 2
    evidence: float = 5.0
    borne_out: float = 4.0


RULES = Rules()
