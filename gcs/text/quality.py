"""Flights in words: who flew, and what it is worth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

VERDICTS = {"good": "good", "care": "usable with care", "poor": "too poor"}


def verdict_words(quality: Mapping[str, Any]) -> str:
    """The verdict in words, ready for the reasons that follow."""
    words = VERDICTS.get(str(quality.get("verdict")), str(quality.get("verdict")))
    if quality.get("verdict") == "good":
        return f"{words} for identification"
    return f"{words}, because"


def quality_lines(quality: Mapping[str, Any] | None) -> list[str]:
    """The verdict and its reasons, one line each; nothing where there is none."""
    if not quality:
        return []
    return [f"quality: {verdict_words(quality)}", *(f"  {reason}" for reason in quality.get("reasons", [])), ""]


def flights_words(result: Mapping[str, Any]) -> str:
    """Names of a result's flights, each with the type of vehicle and its autopilot where the result says."""
    senders = result.get("senders") or {}
    return ", ".join(
        f"{name} ({senders[name]['type']}, {senders[name]['autopilot']})" if name in senders else str(name)
        for name in result.get("flights", [])
    )


def repeatability_words(result: Mapping[str, Any]) -> str:
    """How flights, each by itself, agree on the coefficients beside their bars; "" where there are too few."""
    found = result.get("repeatability") or {}
    if not found:
        return ""
    ratios = sorted((one["ratio"], name) for name, one in found.items())
    middle = ratios[len(ratios) // 2][0]
    flights = max(len(one["flights"]) for one in found.values())
    (least, steadiest), (most, loosest) = ratios[0], ratios[-1]
    return (
        f"{flights} flights, each by itself, scatter {middle:.2f} times as far as their bars say in the median of"
        f" {len(ratios)} coefficients ({least:.2f} for {steadiest}, {most:.2f} for {loosest}; 1 is right)"
    )
