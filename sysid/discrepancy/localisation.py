"""Where simulation and measurement disagree: axis of force or moment, variable, and stretch of time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import special

from sysid.arrays import Array
from sysid.equation_error.coefficients import AXES
from sysid.numerics.autocorrelation import pooled_autocorrelation
from sysid.numerics.filters import correlation
from sysid.numerics.smoothing import fourier_smooth
from sysid.problem.coefficient_residuals import CoefficientPath

# Residuals are compared in the band of the motion, s.
_SMOOTH_HZ = 3.0
_BINS = 8
_SIGNIFICANT = 1e-3
_MIN_INTERVAL_S = 0.2
# Lags of a correlation, as a share of the series.
_LAGS = 0.2
# Of the axis that the best model explains most better, so much better must another be.
_MINOR = 0.05


def _explained(residual: Array, variable: Array) -> tuple[float, float]:
    """Share of the residual's variance explained by a cubic in the variable, and the p-value of that (F test).

    Samples count as many as are independent: two series that swing alike, as a Dutch roll and what is left of it,
    agree by chance over as many as the product of their autocorrelations adds up to (Bartlett, J. R. Stat. Soc. 98,
    1935).
    """
    spread = float(np.std(variable))
    if spread <= 1e-9:
        return 0.0, 1.0
    x = (variable - variable.mean()) / spread
    design = np.column_stack([np.ones_like(x), x, x**2, x**3])
    fitted = design @ np.linalg.lstsq(design, residual, rcond=None)[0]
    total = float(np.sum((residual - residual.mean()) ** 2))
    if total <= 0.0:
        return 0.0, 1.0
    share = 1.0 - float(np.sum((residual - fitted) ** 2)) / total
    count = residual.size / _alike(residual - fitted, fitted - fitted.mean())
    if count <= 6.0:
        return share, 1.0
    F = share / 3.0 / max((1.0 - share) / (count - 4.0), 1e-12)
    return share, float(special.fdtrc(3.0, count - 4.0, F))


def _alike(left: Array, right: Array) -> float:
    """Samples of two series (N,) of zero mean that count as one where they are compared, at least 1."""
    length = max(2, int(_LAGS * left.size))
    power = float(left @ left) * float(right @ right)
    if power <= 0.0:
        return 1.0
    product = correlation(left, length) * correlation(right, length) / power
    return max(float(product[0] + 2.0 * np.sum(product[1:])), float(np.sum(pooled_autocorrelation([left]))), 1.0)


def _intervals(path: CoefficientPath, residual: Array, flight: str, limit: float) -> list[dict[str, Any]]:
    """Stretches of time in which the smoothed residual exceeds `limit`."""
    interval = float(path.time_s[1] - path.time_s[0])
    edges = np.diff(np.concatenate(([0], (np.abs(residual) > limit).astype(int), [0])))
    found = []
    for begin, end in zip(np.nonzero(edges > 0)[0], np.nonzero(edges < 0)[0], strict=True):
        if (end - begin) * interval >= _MIN_INTERVAL_S:
            found.append(
                {
                    "flight": flight,
                    "start": round(float(path.time_s[begin]), 2),
                    "end": round(float(path.time_s[end - 1]), 2),
                }
            )
    return found


def _curve(variable: Array, residual: Array) -> list[dict[str, float]]:
    """What is left of an axis over a variable: mean and its standard error in _BINS parts of equally many samples.

    The standard error counts neighbouring samples as many as they are independent.
    """
    order = np.argsort(variable, kind="stable")
    parts = np.array_split(order, _BINS)
    means = np.concatenate([np.full(part.size, residual[part].mean()) for part in parts])
    around = np.empty_like(residual)
    around[order] = residual[order] - means
    alike = max(float(np.sum(pooled_autocorrelation([around]))), 1.0)
    return [
        {
            "value": float(variable[part].mean()),
            "residual": float(residual[part].mean()),
            "std": float(residual[part].std() * np.sqrt(min(alike, part.size) / part.size)),
        }
        for part in parts
    ]


def locate(
    paths: Sequence[tuple[str, CoefficientPath]],
    floors: Sequence[CoefficientPath] = (),
    axes: Sequence[str] = AXES,
) -> list[dict[str, Any]]:
    """Axes whose residual coefficients depend on something, strongest first.

    paths: (flight, measured against a model). floors: the same against the best model found, for scale; without one
    the scale is what the variable leaves.
    Returns entries axis, variable, intervals, curve (over the variable: value, residual, std), share (of the variance
    above the floor that the variable explains), p_value.
    """
    found: list[tuple[float, dict[str, Any]]] = []
    for axis in axes:
        residuals = [_band(path.measured[axis] - path.predicted[axis], path) for _, path in paths]
        residual = np.concatenate(residuals)
        if not np.isfinite(residual).all():
            continue
        best = ("", 0.0, 1.0)
        for variable in paths[0][1].variables:
            values = np.concatenate([path.variables[variable] for _, path in paths])
            share, p_value = _explained(residual, values)
            if share > best[1]:
                best = (variable, share, p_value)
        noise = float(np.std(residual)) * math.sqrt(max(1.0 - best[1], 0.0))
        if floors:
            floor = [_band(path.measured[axis] - path.predicted[axis], path) for path in floors]
            noise = float(np.std(np.concatenate(floor)))
        excess = float(np.var(residual)) - noise**2
        if excess <= 0.0:
            continue
        if best[2] * len(AXES) * len(paths[0][1].variables) < _SIGNIFICANT:
            intervals: list[dict[str, Any]] = []
            for (flight, path), one in zip(paths, residuals, strict=True):
                intervals += _intervals(path, one, flight, 2.0 * max(noise, 1e-9))
            entry = {
                "axis": axis,
                "variable": best[0],
                "intervals": intervals,
                "curve": _curve(np.concatenate([p.variables[best[0]] for _, p in paths]), residual),
                "share": round(min(best[1] * float(np.var(residual)) / excess, 1.0), 4),
                "p_value": best[2],
            }
            found.append((excess / max(noise**2, 1e-18), entry))
    ordered = sorted(found, key=lambda item: -item[0])
    # An axis that the best model explains hardly better is not where anything was missing.
    least = _MINOR * ordered[0][0] if ordered and floors else 0.0
    return [entry for better, entry in ordered if better >= least]


def _band(residual: Array, path: CoefficientPath) -> Array:
    return fourier_smooth(residual, float(path.time_s[1] - path.time_s[0]), _SMOOTH_HZ).values
