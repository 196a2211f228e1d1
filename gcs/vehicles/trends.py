"""Coefficients of an aircraft over its flights, and whether one of them has changed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A change is said where chance alone would show one as large in less than one coefficient in a hundred.
SIGNIFICANT = 0.01
# Flights before and behind a change: of fewer one bad result would be a change.
_FEWEST = 2


@dataclass(frozen=True)
class Estimate:
    """One flight's estimate of a coefficient and its standard error. start_ns: when the flight began, UTC."""

    flight: str
    title: str
    start_ns: int
    value: float
    std: float


@dataclass(frozen=True)
class Change:
    """A step between two flights. flight: the first one behind it. p: how often chance alone shows one as large."""

    flight: str
    before: float
    before_std: float
    after: float
    after_std: float
    p: float


@dataclass(frozen=True)
class Trend:
    """A coefficient over flights, oldest first.

    mean, std: over all flights, weighted by their errors. scatter: by how much flights differ beyond their errors,
    1 sigma. constant_p: how often flights of one and the same value differ as much, None of a single flight. change:
    the most likely step where it is significant.
    """

    name: str
    estimates: tuple[Estimate, ...]
    mean: float
    std: float
    scatter: float
    constant_p: float | None
    change: Change | None


def trend(name: str, estimates: Sequence[Estimate]) -> Trend:
    """What flights say together of one coefficient.

    Weighted mean with the scatter between flights by DerSimonian and Laird ("Meta-analysis in clinical trials",
    Controlled Clinical Trials 7 (1986), eq. 8); Cochran's Q for constancy. A step is looked for at each place between
    two flights: the difference of the two weighted means over its standard error. What flights on one side differ by
    beyond their errors is added to each of them, and the errors are stretched where that does not suffice (R. T.
    Birge, Physical Review 40 (1932) 207); Student's t with n - 2 degrees of freedom, its p value times the number of
    places (Bonferroni).

    Parameters
    ----------
    name : str
        Of the coefficient.
    estimates : Sequence[Estimate]
        One for each flight, in any order, their standard errors positive; at least one.

    Returns
    -------
    Trend
        With the estimates oldest first.
    """
    ordered = tuple(sorted(estimates, key=lambda one: one.start_ns))
    values = np.array([one.value for one in ordered])
    variances = np.array([one.std for one in ordered]) ** 2
    scatter, q = _between(values, variances)
    mean, std = _pooled(values, variances + scatter**2)
    constant = None if values.size < 2 else _chi_square_tail(q, values.size - 1)
    return Trend(name, ordered, mean, std, scatter, constant, _change(ordered, values, variances))


def mean_of(estimates: Sequence[Estimate]) -> tuple[float, float, float]:
    """Mean, standard error and scatter as in `trend`, which also looks for a step, and takes the longer for it."""
    values = np.array([one.value for one in estimates])
    variances = np.array([one.std for one in estimates]) ** 2
    scatter, _ = _between(values, variances)
    return (*_pooled(values, variances + scatter**2), scatter)


def _change(ordered: Sequence[Estimate], values: Array, variances: Array) -> Change | None:
    from scipy.special import stdtr

    freedom = values.size - 2
    places = range(_FEWEST, values.size - _FEWEST + 1)
    found: list[Change] = []
    for place in places:
        halves = (slice(None, place), slice(place, None))
        # What flights on one side differ by beyond their errors counts for each of them alike.
        scatter = max(_between(values[half], variances[half])[0] for half in halves)
        spread = variances + scatter**2
        (before, before_std), (after, after_std) = (_pooled(values[half], spread[half]) for half in halves)
        within = sum(_between(values[half], spread[half])[1] for half in halves)
        stretch = math.sqrt(max(1.0, within / freedom))
        t = abs(after - before) / (stretch * math.hypot(before_std, after_std))
        p = min(1.0, len(places) * 2.0 * float(stdtr(freedom, -t)))
        found.append(Change(ordered[place].flight, before, stretch * before_std, after, stretch * after_std, p))
    best = min(found, key=lambda one: one.p, default=None)
    return best if best is not None and best.p < SIGNIFICANT else None


def _pooled(values: Array, variances: Array) -> tuple[float, float]:
    weights = 1.0 / variances
    return float(np.sum(weights * values) / np.sum(weights)), float(1.0 / np.sqrt(np.sum(weights)))


def _between(values: Array, variances: Array) -> tuple[float, float]:
    """Standard deviation between flights, and Cochran's Q."""
    weights = 1.0 / variances
    q = float(np.sum(weights * (values - np.sum(weights * values) / np.sum(weights)) ** 2))
    if values.size < 2:
        return 0.0, q
    scale = float(np.sum(weights) - np.sum(weights**2) / np.sum(weights))
    return math.sqrt(max(0.0, (q - (values.size - 1)) / scale)), q


def _chi_square_tail(q: float, degrees: int) -> float:
    from scipy.special import gammaincc

    return float(gammaincc(degrees / 2.0, q / 2.0))
