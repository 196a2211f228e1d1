"""What one case of the discrepancy campaign counts for: the job's answer against what the flight tells by the truth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from discrepancy_trial import gap_ratio
from discrepancy_truth import AIR, STANDS_OUT

SEPARABLE, IN_A_SET, HIDDEN_TO_ALL = "separable", "in a set", "not detectable"
CLASSES = (SEPARABLE, IN_A_SET, HIDDEN_TO_ALL)
CONFIDENT = 0.9


@dataclass(frozen=True)
class Score:
    """One case.

    kind: of CLASSES, by the truth. first: name that stands first, else the verdict, or "failed". named: every name
    given with its probability, sets included, and whether it is right. chosen, true_set: names of the first set, and of
    the set that the truth tells. wrong_confident: wrong names above CONFIDENT. gap: the job's on the held-out flight
    over the true model's, NaN where the right effect was not found. away, spread: of each estimated parameter of the
    right effect its error over its std, and its std over the bound.
    """

    hidden: str
    share: float
    gust: float
    kind: str
    detect: float
    first: str
    chosen: tuple[str, ...]
    true_set: tuple[str, ...]
    named: tuple[tuple[float, bool], ...]
    wrong_confident: tuple[str, ...]
    extra: tuple[str, ...]
    manoeuvre: bool
    gap: float
    seconds: float
    away: Mapping[str, float] = field(default_factory=dict)
    spread: Mapping[str, float] = field(default_factory=dict)

    @property
    def right(self) -> bool:
        """Whether the right name stands first."""
        return self.first == self.hidden

    @property
    def holds(self) -> bool:
        """Whether the first set holds the truth."""
        return self.hidden in self.chosen

    @property
    def silent(self) -> bool:
        """Whether no effect is named, or only the air where it moves."""
        return self.first in ("none", "parameter_error") or (self.hidden in AIR and self.right)


def class_of(told: Mapping[str, Any], hidden: str) -> tuple[str, tuple[str, ...]]:
    """The class of a hidden effect by what the flight tells, and the set of names that the flight cannot tell apart."""
    if told["detect"] < STANDS_OUT:
        return HIDDEN_TO_ALL, ()
    others = tuple(name for name, sigma in told["separate"].items() if sigma < STANDS_OUT)
    return (IN_A_SET if others else SEPARABLE), (hidden, *others)


def score(line: Mapping[str, Any], told: Mapping[str, Any]) -> Score:
    """The score of a case with one hidden effect. told: its detect, separate and bounds."""
    (hidden,) = line["hidden"]
    kind, true_set = class_of(told, hidden)
    named = line["named"]
    found = next((one for one in named if one["name"] == hidden), None)
    away, spread = _parameters(found, line["hidden"][hidden], told["bounds"]) if found else ({}, {})
    validation = line.get("gap", {}).get("validation", {})
    chosen = (named[0]["name"], *(one["name"] for one in named[0]["alternatives"])) if named else ()
    first = named[0]["name"] if named else line["verdict"] or "failed"
    return Score(
        hidden,
        line["shares"][hidden],
        line["gust"],
        kind,
        told["detect"],
        first,
        chosen,
        true_set,
        tuple(_stated(named, (hidden,))),
        tuple(one["name"] for one in named if one["name"] != hidden and one["probability"] > CONFIDENT),
        tuple(one["name"] for one in named if one["name"] != hidden),
        bool(named and named[0].get("separating_manoeuvre")),
        gap_ratio(validation.get("after", {}), line.get("true_gap", {})) if found else math.nan,
        line.get("seconds", math.nan),
        away,
        spread,
    )


def _stated(named: Sequence[Mapping[str, Any]], hidden: Sequence[str]) -> list[tuple[float, bool]]:
    """Every probability stated, and whether what it was stated of is there."""
    pairs = [(one["probability"], one["name"] in hidden) for one in named]
    return pairs + [(other["probability"], other["name"] in hidden) for one in named for other in one["alternatives"]]


def _parameters(
    found: Mapping[str, Any], true: Mapping[str, Any], bounds: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, float]]:
    away, spread = {}, {}
    for name, estimate in found["parameters"].items():
        value, std = estimate["value"], estimate.get("std")
        truth = true.get(name, 0.0)
        if std is None or not isinstance(truth, float):
            continue
        away[name] = (value - truth) / std
        if bounds.get(name):
            spread[name] = std / bounds[name]
    return away, spread


def calibration_error(
    stated: Sequence[tuple[float, bool]], bins: int = 10
) -> tuple[float, list[tuple[int, float, float]]]:
    """Expected calibration error, and of each bin of stated probability its count, mean and share right."""
    rows = []
    for index in range(bins):
        inside = [(p, right) for p, right in stated if min(int(p * bins), bins - 1) == index]
        if inside:
            count = len(inside)
            rows.append((count, sum(p for p, _ in inside) / count, sum(right for _, right in inside) / count))
    total = sum(count for count, _, _ in rows)
    error = sum(count * abs(mean - share) for count, mean, share in rows) / total if total else math.nan
    return error, rows
