"""Figures of the identification campaign: bias, error against the bound, coverage and refusals of every parameter."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

# A parameter counts as identifiable where the bound is below this share of its true value, or of 1 where that is 0.
IDENTIFIABLE_SHARE, IDENTIFIABLE_OF_ZERO = 0.2, 0.02
CALM_MEDIAN, CALM_WORST, GUST_WORST = 1.10, 1.25, 1.5
POOLED_COVERAGE, SINGLE_COVERAGE = (0.93, 0.97), (0.90, 0.99)
# A coverage of fewer estimates says nothing of one parameter.
FEWEST = 5


@dataclass(frozen=True)
class Row:
    """One parameter over all flights of a scenario.

    told: flights that gave an estimate. bias, rms: of its errors. std: quadratic mean of the standard errors told.
    bound: quadratic mean over all flights, NaN where the bound does not hold for it (an error that the kinematics alone
    tell). inside: intervals that hold the truth.
    """

    name: str
    true: float
    flights: int
    told: int
    bias: float
    rms: float
    std: float
    bound: float
    inside: int

    @property
    def identifiable(self) -> bool:
        """Whether the flights tell it, by the truth."""
        limit = IDENTIFIABLE_SHARE * abs(self.true) if self.true != 0.0 else IDENTIFIABLE_OF_ZERO
        return self.bound < limit

    @property
    def ratio(self) -> float:
        """RMS error over the bound."""
        return self.rms / self.bound

    @property
    def coverage(self) -> float:
        """Share of the 95 % intervals that hold the truth."""
        return self.inside / self.told if self.told else math.nan

    @property
    def refused(self) -> float:
        """Share of the flights that gave no estimate."""
        return 1.0 - self.told / self.flights


def rows_of(lines: Sequence[Mapping[str, Any]]) -> list[Row]:
    """Rows of all parameters that any flight was asked for."""
    names = list(dict.fromkeys(name for line in lines for name in (*line["estimates"], *line["bounds"])))
    return [_row(name, lines) for name in names]


def _row(name: str, lines: Sequence[Mapping[str, Any]]) -> Row:
    true = float(next(line["true"][name] for line in lines))
    found = np.array([line["estimates"][name] for line in lines if name in line["estimates"]]).reshape(-1, 4)
    error = found[:, 0] - true
    limits = np.array([line["bounds"][name] for line in lines if name in line["bounds"]])
    return Row(
        name,
        true,
        len(lines),
        len(found),
        float(error.mean()) if found.size else math.nan,
        float(np.sqrt(np.mean(error**2))) if found.size else math.nan,
        float(np.sqrt(np.mean(found[:, 1] ** 2))) if found.size else math.nan,
        float(np.sqrt(np.mean(limits**2))) if limits.size else math.nan,
        int(np.count_nonzero((found[:, 2] <= true) & (true <= found[:, 3]))),
    )


def render(title: str, lines: Sequence[Mapping[str, Any]], gusty: bool) -> str:
    """The table of one scenario, and which goals it meets."""
    rows = rows_of(lines)
    chance = 1.0 / math.sqrt(2.0 * len(lines))
    text = [
        f"{title}: {len(lines)} flights (chance alone moves a ratio by {chance:.0%})",
        f"{'parameter':<16}{'true':>10}{'bias':>12}{'RMS err':>11}{'bound':>11}{'RMS/bd':>8}{'95 %':>6}{'refused':>9}",
    ]
    for row in rows:
        mark = "" if row.identifiable else "  not identifiable" if math.isfinite(row.bound) else "  kinematics alone"
        text.append(
            f"{row.name:<16}{row.true:>10.4g}{_number(row.bias, '+.2e'):>12}{_number(row.rms, '.2e'):>11}"
            f"{_number(row.bound, '.2e'):>11}{_number(row.ratio, '.2f'):>8}{_number(row.coverage, '.0%'):>6}"
            f"{row.refused:>9.0%}{mark}"
        )
    return "\n".join([*text, *_goals(rows, lines, gusty)])


def _number(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else "-"


@dataclass(frozen=True)
class Verdict:
    """A scenario in one line.

    median, largest, worst: RMS errors over the bound of the identifiable parameters, and which is worst. pooled, low,
    high: coverage of all intervals together, and of the parameters with the least and the most. missed: identifiable
    ones refused, of `asked`.
    """

    median: float
    largest: float
    worst: str
    pooled: float
    low: Row
    high: Row
    missed: dict[str, int]
    asked: int

    def efficient(self, gusty: bool) -> bool:
        """Whether the goal for the errors is met."""
        if gusty:
            return self.largest <= GUST_WORST
        return self.median <= CALM_MEDIAN and self.largest <= CALM_WORST

    @property
    def covered(self) -> tuple[bool, bool]:
        """Whether the goals for the coverage are met: of all, of each."""
        pooled = POOLED_COVERAGE[0] <= self.pooled <= POOLED_COVERAGE[1]
        return pooled, self.low.coverage >= SINGLE_COVERAGE[0] and self.high.coverage <= SINGLE_COVERAGE[1]


def verdict(rows: Sequence[Row]) -> Verdict | None:
    """The scenario's figures; None where too few flights told too little."""
    firm = [row for row in rows if row.identifiable and row.told >= FEWEST]
    told = [row for row in rows if row.told >= FEWEST]
    if not firm:
        return None
    ratios = np.array([row.ratio for row in firm])
    return Verdict(
        float(np.median(ratios)),
        float(ratios.max()),
        firm[int(np.argmax(ratios))].name,
        sum(row.inside for row in told) / sum(row.told for row in told),
        min(told, key=lambda row: row.coverage),
        max(told, key=lambda row: row.coverage),
        {row.name: row.flights - row.told for row in rows if row.identifiable and row.told < row.flights},
        sum(row.flights for row in rows if row.identifiable),
    )


def _goals(rows: Sequence[Row], lines: Sequence[Mapping[str, Any]], gusty: bool) -> list[str]:
    found = verdict(rows)
    text = []
    if found is not None:
        goal = f"none above {GUST_WORST}" if gusty else f"median {CALM_MEDIAN:.2f}, none above {CALM_WORST}"
        pooled, single = found.covered
        share = sum(found.missed.values()) / found.asked
        named = ", ".join(f"{name} {count}" for name, count in found.missed.items())
        text = [
            f"RMS/bound: median {found.median:.2f}, largest {found.largest:.2f} ({found.worst}); goal {goal}: "
            f"{_met(found.efficient(gusty))}",
            f"coverage: pooled {found.pooled:.1%}, goal 93 to 97 %: {_met(pooled)}; single {found.low.coverage:.0%} "
            f"({found.low.name}) to {found.high.coverage:.0%} ({found.high.name}), goal 90 to 99 %: {_met(single)}",
            f"identifiable ones refused: {sum(found.missed.values())} of {found.asked} ({share:.1%})"
            + (f" ({named})" if named else ""),
        ]
    methods = Counter(line["method"] for line in lines if line.get("method"))
    if methods:
        text.append("estimated by: " + ", ".join(f"{name} {count}" for name, count in sorted(methods.items())))
    failed = [line["failure"] for line in lines if line["failure"]]
    if failed:
        text.append(f"flights without any result: {len(failed)}; the first: {failed[0]}")
    return text


def overview(scenarios: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """All scenarios, a line each; scenarios: name -> lines of its flights.

    std/bd and RMS/bd are pooled over the identifiable parameters, so that they say something after a few flights.
    """
    text = [
        "standard errors and errors over the bound, coverage of the 95 % intervals, identifiable ones refused",
        f"{'scenario':<16}{'flights':>8}{'std/bd: median':>16}{'least':>7}{'most':>8}{'RMS/bd':>8}{'95 %':>8}"
        f"{'refused':>9}",
    ]
    for name, lines in scenarios.items():
        rows = rows_of(lines)
        firm = [row for row in rows if row.identifiable and row.told]
        told = np.array([row.std / row.bound for row in firm])
        rms = math.sqrt(sum(row.told * row.ratio**2 for row in firm) / sum(row.told for row in firm))
        coverage = sum(row.inside for row in rows) / sum(row.told for row in rows)
        asked = sum(row.flights for row in rows if row.identifiable)
        missed = sum(row.flights - row.told for row in rows if row.identifiable)
        text.append(
            f"{name:<16}{len(lines):>8}{np.median(told):>16.2f}{told.min():>7.2f}{told.max():>8.2f}{rms:>8.2f}"
            f"{coverage:>8.1%}{missed / asked:>9.1%}"
        )
    return "\n".join(text)


def _met(met: bool) -> str:
    return "met" if met else "MISSED"
