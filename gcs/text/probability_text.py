"""Probabilities in words that no arithmetic makes certain."""

from __future__ import annotations

from sysid.discrepancy.wording import LEAST_EXPONENT, too_small

_CERTAIN = 0.999


def p_text(p_value: float | None, digits: int = 2) -> str:
    """A p value for a terminal, "-" for none."""
    if p_value is None:
        return "-"
    return f"< 1e{LEAST_EXPONENT}" if too_small(p_value) else f"{p_value:.{digits}g}"


def probability_text(probability: float | None) -> str:
    """A posterior probability for a terminal, "-" for none: certain to no more digits than it is."""
    if probability is None:
        return "-"
    return "> 0.999" if probability > _CERTAIN else f"{probability:.3g}"


def percent_text(probability: float) -> str:
    """A posterior probability for a picture: "> 99.9 %" rather than a certainty."""
    return "> 99.9 %" if probability > _CERTAIN else f"{100.0 * probability:.3g} %"
