"""Figures of the identification campaign: bias, error against the bound, coverage and refusals of every parameter."""

from __future__ import annotations

import math
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

    told: flights that gave an estimate. bias, rms: of its errors. bound: quadratic mean over all flights, NaN where the
    bound does not hold for it (an error that the kinematics alone tell). inside: intervals that hold the truth.
    """

    name: str
    true: float
    flights: int
    told: int
    bias: float
    rms: float
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


def _goals(rows: Sequence[Row], lines: Sequence[Mapping[str, Any]], gusty: bool) -> list[str]:
    firm = [row for row in rows if row.identifiable and row.told >= FEWEST]
    told = [row for row in rows if row.told >= FEWEST]
    text = []
    if firm:
        ratios = np.array([row.ratio for row in firm])
        worst = firm[int(np.argmax(ratios))]
        median, largest = float(np.median(ratios)), float(ratios.max())
        met = largest <= GUST_WORST if gusty else median <= CALM_MEDIAN and largest <= CALM_WORST
        goal = f"none above {GUST_WORST}" if gusty else f"median {CALM_MEDIAN:.2f}, none above {CALM_WORST}"
        text.append(f"RMS/bound: median {median:.2f}, largest {largest:.2f} ({worst.name}); goal {goal}: {_met(met)}")
    if told:
        pooled = sum(row.inside for row in told) / sum(row.told for row in told)
        low, high = min(told, key=lambda row: row.coverage), max(told, key=lambda row: row.coverage)
        fits = POOLED_COVERAGE[0] <= pooled <= POOLED_COVERAGE[1]
        single = low.coverage >= SINGLE_COVERAGE[0] and high.coverage <= SINGLE_COVERAGE[1]
        text.append(
            f"coverage: pooled {pooled:.1%}, goal 93 to 97 %: {_met(fits)}; single {low.coverage:.0%} ({low.name}) to "
            f"{high.coverage:.0%} ({high.name}), goal 90 to 99 %: {_met(single)}"
        )
    missed = {row.name: row.flights - row.told for row in rows if row.identifiable and row.told < row.flights}
    asked = sum(row.flights for row in rows if row.identifiable)
    share = sum(missed.values()) / asked if asked else 0.0
    named = f" ({', '.join(f'{name} {count}' for name, count in missed.items())})" if missed else ""
    text.append(f"identifiable ones refused: {sum(missed.values())} of {asked} ({share:.1%}){named}")
    failed = [line["failure"] for line in lines if line["failure"]]
    if failed:
        text.append(f"flights without any result: {len(failed)}; the first: {failed[0]}")
    return text


def _met(met: bool) -> str:
    return "met" if met else "MISSED"
