"""What the flights of a fleet say together: means over flights and aircraft, changes of an aircraft, odd flights."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from gcs.fleet.rows import coefficients_of
from gcs.vehicles.trends import SIGNIFICANT, Change, Estimate, Trend, mean_of, trend

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Outlier:
    """A flight whose estimate is none of its aircraft. off: in standard errors; p: over all estimates of the fleet."""

    aircraft: str
    name: str
    flight: str
    off: float
    p: float


@dataclass(frozen=True)
class Fleet:
    """trends: aircraft -> coefficient -> what its flights say. means: coefficient -> over aircraft as they are today, a
    Trend whose estimates are those of the aircraft. changes: aircraft, coefficient and step, the likeliest first, p
    over all coefficients of all aircraft. failed: flights without a result, and why.
    """

    trends: Mapping[str, Mapping[str, Trend]]
    means: Mapping[str, Trend]
    changes: tuple[tuple[str, str, Change], ...]
    outliers: tuple[Outlier, ...]
    failed: tuple[tuple[str, str], ...]


def together(rows: Sequence[Row]) -> Fleet:
    """Everything that a table of flights says (`gcs.fleet.rows`).

    Means with the scatter between flights, then between aircraft, by DerSimonian and Laird, and steps by Student's t:
    `gcs.vehicles.trends`. A step is one where chance alone would show it in less than one fleet of a hundred: its p
    value times the number of coefficients of all aircraft (Bonferroni). An odd flight is as far from the mean of the
    others of its aircraft, by its own error, theirs and the scatter between them.
    """
    trends: dict[str, dict[str, Trend]] = {}
    for aircraft in dict.fromkeys(str(row["aircraft"]) for row in rows):
        own = [row for row in rows if row["aircraft"] == aircraft and row["verdict"] != "poor"]
        found = {name: _estimates(own, name) for name in coefficients_of(own)}
        trends[aircraft] = {name: trend(name, each) for name, each in found.items() if each}
    tests = sum(len(each) for each in trends.values())
    steps = [
        (aircraft, name, replace(one.change, p=min(1.0, tests * one.change.p)))
        for aircraft, each in trends.items() for name, one in each.items() if one.change is not None
    ]  # fmt: skip
    changes = sorted((one for one in steps if one[2].p < SIGNIFICANT), key=lambda one: one[2].p)
    changed = {(aircraft, name) for aircraft, name, _ in changes}
    means = {}
    for name in dict.fromkeys(name for each in trends.values() for name in each):
        apart = [
            Estimate(aircraft, aircraft, place, *as_it_is(each[name], (aircraft, name) in changed))
            for place, (aircraft, each) in enumerate(trends.items()) if name in each
        ]  # fmt: skip
        means[name] = replace(trend(name, apart), change=None)
    outliers = _outliers(trends, changed)
    failed = tuple((str(row["flight"]), str(row["error"])) for row in rows if row["error"])
    return Fleet(trends, means, tuple(changes), outliers, failed)


def as_it_is(one: Trend, changed: bool) -> tuple[float, float]:
    """Value and standard error of a coefficient today: behind its change, where there was one."""
    if changed and one.change is not None:
        return one.change.after, one.change.after_std
    return one.mean, one.std


def _estimates(rows: Sequence[Row], name: str) -> list[Estimate]:
    return [
        Estimate(str(row["source"]), str(row["flight"]), int(row["start_ns"]), row[name], row[f"{name}_std"])
        for row in rows if row.get(name) is not None and (row.get(f"{name}_std") or 0.0) > 0.0
    ]  # fmt: skip


def _outliers(trends: Mapping[str, Mapping[str, Trend]], changed: set[tuple[str, str]]) -> tuple[Outlier, ...]:
    """Of coefficients that have not changed: a step makes the flights on its shorter side seem odd."""
    count = sum(len(one.estimates) for each in trends.values() for one in each.values())
    found = []
    for aircraft, each in trends.items():
        for name, one in each.items():
            if (aircraft, name) in changed or len(one.estimates) < _FEWEST:
                continue
            for estimate in one.estimates:
                mean, std, scatter = mean_of([other for other in one.estimates if other is not estimate])
                off = (estimate.value - mean) / math.hypot(estimate.std, std, scatter)
                # Few flights know their scatter poorly: Student's t, one flight and one mean less.
                p = min(1.0, count * _two_sided(off, len(one.estimates) - 2))
                if p < SIGNIFICANT:
                    found.append(Outlier(aircraft, name, estimate.title, off, p))
    return tuple(sorted(found, key=lambda entry: entry.p))


# Flights of an aircraft, of fewer of which none is odd.
_FEWEST = 4


def _two_sided(t: float, freedom: int) -> float:
    from scipy.special import stdtr

    return 2.0 * float(stdtr(freedom, -abs(t)))
