"""Two ways of others to learn what a model lacks, both from residual coefficients: PySINDy and a Gaussian process.

Both see what the discrepancy job locates: coefficients measured along a flight less those of the re-fitted baseline,
with surfaces behind their servos, in the band of the motion.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pysindy as ps
from corrected_flight import AXES, REGRESSORS, Array
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

IntArray = NDArray[np.int64]

_FOLDS = 5
_THRESHOLDS = np.geomspace(0.01, 0.5, 12)  # of the residual's spread
_RIDGE = 1e-3  # STLSQ fits the terms that it keeps once more without
# A Gaussian process takes so many points for its predictions, and fewer while its scales are searched.
_POINTS, _SEARCH_POINTS = 600, 200


@dataclass(frozen=True)
class Scaled:
    """Regressors brought to mean 0 and spread 1. mean, spread: (10,)."""

    mean: Array
    spread: Array

    @classmethod
    def of(cls, x: Array) -> Scaled:
        """Scales of a flight's regressors (N, 10); what does not move is left out by a spread of infinity."""
        spread = np.std(x, axis=0)
        return cls(np.mean(x, axis=0), np.where(spread > 1e-9, spread, np.inf))

    def __call__(self, x: Array) -> Array:
        """(n, 10)."""
        return np.asarray((x - self.mean) / self.spread)


class Sindy:
    """PySINDy's polynomial library of second order and STLSQ, one axis at a time.

    The threshold is chosen by cross-validation over stretches of the flight: the one that predicts best, or, sparse, of
    all within one standard error of it the one that keeps fewest terms (Hastie, Tibshirani & Friedman, section 7.10).
    """

    def __init__(self, x: Array, residuals: Array, *, sparse: bool) -> None:
        self._scaled = Scaled.of(x)
        library = ps.PolynomialLibrary(degree=2).fit(self._scaled(x))
        self._powers = np.asarray(library.powers_, dtype=np.int64)
        columns = np.asarray(library.transform(self._scaled(x)), dtype=np.float64)
        self._size = np.sqrt(np.mean(columns**2, axis=0))
        self._size[self._size == 0.0] = np.inf
        columns = columns / self._size
        spread = np.std(residuals, axis=0)
        self._coefficients = np.stack(
            [_sparse(columns, residuals[:, j] / spread[j], sparse) * spread[j] for j in range(len(AXES))], axis=1
        )
        self._left = np.std(residuals - columns @ self._coefficients, axis=0)

    def __call__(self, x: Array) -> Array:
        """Correction (n, 6) at regressors (n, 10)."""
        columns = np.prod(self._scaled(x)[:, None, :] ** self._powers, axis=2)
        return np.asarray((columns / self._size) @ self._coefficients)

    def told(self) -> list[tuple[str, tuple[str, ...], float]]:
        """Terms kept, strongest first: axis, factors, and root mean square over what is left of the axis."""
        found = []
        for i, power in enumerate(self._powers):
            factors = tuple(name for name, p in zip(REGRESSORS, power, strict=True) for _ in range(p))
            for j, axis in enumerate(AXES):
                if factors and self._coefficients[i, j] != 0.0:
                    found.append((axis, factors, abs(float(self._coefficients[i, j])) / float(self._left[j])))
        return sorted(found, key=lambda term: -term[2])


def _stlsq(columns: Array, target: Array, threshold: float) -> Array:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that a threshold keeps nothing
        found = ps.STLSQ(threshold=threshold, alpha=_RIDGE).fit(columns, target[:, None])
    return np.asarray(found.coef_, dtype=np.float64).ravel()


def _sparse(columns: Array, target: Array, sparse: bool) -> Array:
    """Coefficients (terms,) at the threshold that predicts stretches left out best, or nearly so with fewest terms."""
    folds = np.array_split(np.arange(target.size), _FOLDS)
    errors = np.empty((_THRESHOLDS.size, _FOLDS))
    for i, threshold in enumerate(_THRESHOLDS):
        for j, fold in enumerate(folds):
            kept = np.delete(np.arange(target.size), fold)
            found = _stlsq(columns[kept], target[kept], threshold)
            errors[i, j] = np.mean((target[fold] - columns[fold] @ found) ** 2)
    mean = errors.mean(axis=1)
    best = int(np.argmin(mean))
    limit = mean[best] + (errors[best].std(ddof=1) / np.sqrt(_FOLDS) if sparse else 0.0)
    candidates = [_stlsq(columns, target, _THRESHOLDS[i]) for i in np.nonzero(mean <= limit)[0]]
    return min(candidates, key=np.count_nonzero)


class GaussianProcess:
    """scikit-learn's process with a length scale for each regressor (RBF) and white noise, one axis at a time."""

    def __init__(self, x: Array, residuals: Array) -> None:
        self._scaled = Scaled.of(x)
        every = self._scaled(x)
        self._points = every[_spread_out(x.shape[0], _POINTS)]
        few = _spread_out(x.shape[0], _SEARCH_POINTS)
        self._mean = residuals.mean(axis=0)
        fits = [_process(every, residuals[:, j] - self._mean[j], few) for j in range(len(AXES))]
        self._inverse = np.stack([1.0 / lengths for lengths, _ in fits])
        self._weights = np.stack([weights for _, weights in fits])

    @cached_property
    def _scaled_points(self) -> Array:
        """(6, 10, points) in units of each axis' length scales."""
        return np.ascontiguousarray((self._points[None] * self._inverse[:, None]).transpose(0, 2, 1))

    @cached_property
    def _lengths(self) -> Array:
        """(6, points) squared distances from the origin."""
        return np.asarray(np.sum(self._scaled_points**2, axis=1))

    def __call__(self, x: Array) -> Array:
        """Mean of the process (n, 6) at regressors (n, 10)."""
        here = self._scaled(x)[None] * self._inverse[:, None]
        square = np.sum(here**2, axis=2)[..., None] + self._lengths[:, None] - 2.0 * here @ self._scaled_points
        return np.asarray(self._mean + np.einsum("anp,ap->na", np.exp(-0.5 * square), self._weights))


def _spread_out(size: int, count: int) -> IntArray:
    return np.unique(np.linspace(0, size - 1, min(count, size)).astype(np.int64))


def _process(x: Array, target: Array, few: IntArray) -> tuple[Array, Array]:
    """Length scales (10,) from few points, then each point's weight in the mean, (points,)."""
    size = float(np.std(target))
    kernel = ConstantKernel(0.3, (1e-4, 1e2)) * RBF(np.full(x.shape[1], 3.0), (0.1, 1e3)) + WhiteKernel(0.7, (1e-6, 2))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a length scale at its bound: a regressor without effect
        found = GaussianProcessRegressor(kernel).fit(x[few], target[few] / size)
        points = _spread_out(x.shape[0], _POINTS)
        fixed = GaussianProcessRegressor(found.kernel_, optimizer=None).fit(x[points], target[points] / size)
    amplitude, lengths = fixed.kernel_.k1.k1.constant_value, fixed.kernel_.k1.k2.length_scale
    return np.asarray(lengths), size * amplitude * np.asarray(fixed.alpha_).ravel()
