"""Coefficients as tables over a variable: where a polynomial does not fit, and to see whether one is needed.

Each chosen coefficient is a broken line between knots, its second differences held small by a smoothness that the
data choose (maximum likelihood of the smoothness, the tables being a random walk of second order).
Sources: Klein & Morelli, chapter 5 (data partitioning); G. Wahba, "Spline Models for Observational Data", SIAM 1990.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Array
from sysid.errors import EstimationError

# A knot's neighbourhood must hold this share of the samples, else its value would rest on its neighbours alone.
_LEAST_SHARE = 0.02


@dataclass(frozen=True)
class Table:
    """One coefficient over a variable: knots (K,), values (K,), standard errors (K,) for coloured residuals."""

    name: str
    knots: Array
    values: Array
    std: Array


def tables(
    y: Array,
    X: Array,
    names: Sequence[str],
    variable: Array,
    tabled: Sequence[str],
    count: int = 7,
    inflation: float = 1.0,
) -> dict[str, Table]:
    """Coefficients as functions of a variable; those not `tabled` stay constant.

    y: (N,) regressand. X: (N, P) regressors. names: P names. variable: (N,), as the angle of attack. tabled: names
    that become tables. count: knots, between the 1st and 99th percentile. inflation: variance of the estimates over
    that for white residuals (of RegressionResult: (std / std_white)^2).
    Raises EstimationError for unknown names, a variable that hardly moves, or too few samples.
    """
    strange = [name for name in tabled if name not in names]
    if strange or not tabled:
        raise EstimationError(f"partition: {strange[0] if strange else 'nothing'} is none of {', '.join(names)}")
    knots = _knots(variable, count)
    hats = _hats(variable, knots)
    columns: list[Array] = []
    places: dict[str, slice] = {}
    for j, name in enumerate(names):
        start = sum(block.shape[1] for block in columns)
        columns.append(hats * X[:, j : j + 1] if name in tabled else X[:, j : j + 1])
        places[name] = slice(start, start + columns[-1].shape[1])
    design = np.column_stack(columns)
    if y.size <= 2 * design.shape[1]:
        raise EstimationError(f"partition: {y.size} samples are too few for {design.shape[1]} numbers")
    values, covariance = _smoothed(y, design, [places[name] for name in tabled], _bend(knots))
    std = np.sqrt(np.diag(covariance) * inflation)
    return {name: Table(name, knots, values[places[name]], std[places[name]]) for name in tabled}


def _hats(variable: Array, knots: Array) -> Array:
    """(N, K) weights of the knots' values at each sample; beyond the ends the outermost lines go on."""
    left = np.clip(np.searchsorted(knots, variable) - 1, 0, knots.size - 2)
    share = (variable - knots[left]) / (knots[left + 1] - knots[left])
    hats = np.zeros((variable.size, knots.size))
    rows = np.arange(variable.size)
    hats[rows, left], hats[rows, left + 1] = 1.0 - share, share
    return hats


def _bend(knots: Array) -> Array:
    """(K - 2, K) change of slope at each inner knot, in units of the mean spacing."""
    spacing = np.diff(knots) / np.mean(np.diff(knots))
    slopes = np.diff(np.eye(knots.size), axis=0) / spacing[:, None]
    return np.diff(slopes, axis=0)


def _knots(variable: Array, count: int) -> Array:
    low, high = np.percentile(variable, [1.0, 99.0])
    if not high > low:
        raise EstimationError("partition: the variable does not move; fly a wider range")
    knots = np.linspace(low, high, max(count, 3))
    counts = np.histogram(variable, np.concatenate(([-np.inf], 0.5 * (knots[1:] + knots[:-1]), [np.inf])))[0]
    knots = knots[counts >= _LEAST_SHARE * variable.size]
    if knots.size < 3:
        raise EstimationError("partition: samples lie in too few places of the variable for a table")
    return np.asarray(knots, dtype=np.float64)


def _smoothed(y: Array, design: Array, blocks: Sequence[slice], second: Array) -> tuple[Array, Array]:
    """Estimates and covariance, one smoothness per table."""
    gram, moment, power = design.T @ design, design.T @ y, float(y @ y)
    size = design.shape[1]
    penalties = []
    for block in blocks:
        penalty = np.zeros((size, size))
        penalty[block, block] = second.T @ second
        # In units of the data's own information, so that the same range of smoothness serves every coefficient.
        penalties.append(penalty * np.trace(gram[block, block]) / (block.stop - block.start))

    def posed(smoothness: Array) -> tuple[Array, Array, float]:
        total = gram + sum(np.exp(s) * p for s, p in zip(smoothness, penalties, strict=True))
        values = np.linalg.solve(total, moment)
        return total, values, max(power - float(moment @ values), 1e-300 + 1e-12 * power)

    def cost(smoothness: Array) -> float:
        total, _, left = posed(smoothness)
        ranks = sum((block.stop - block.start - 2) * s for block, s in zip(blocks, smoothness, strict=True))
        return float((y.size - 2 * len(blocks)) * np.log(left) + np.linalg.slogdet(total)[1] - ranks)

    from scipy import optimize  # slow to import, and wanted for this alone

    start = np.full(len(blocks), -4.0)
    found = optimize.minimize(cost, start, method="L-BFGS-B", bounds=[(-14.0, 12.0)] * len(blocks)).x
    total, values, left = posed(found)
    return values, left / (y.size - size) * np.linalg.inv(total)
