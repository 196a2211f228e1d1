"""Linear regression with error bars that hold for coloured residuals.

Sources: Klein & Morelli, "Aircraft System Identification", chapter 5 (least squares, partial F, collinearity);
E. A. Morelli, V. Klein, "Determining the accuracy of maximum likelihood parameter estimates with colored residuals",
AIAA 95-3499 / NASA CR 194893 (covariance); Belsley, Kuh, Welsch, "Regression Diagnostics" (condition index).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import fft, linalg

from sysid.arrays import Array
from sysid.errors import EstimationError
from sysid.numerics.gaussian import Gaussian
from sysid.numerics.normal_equations import inverse

# Rows factorised at once: the block stays in the cache, the accuracy is that of QR on the whole matrix.
_BLOCK = 4096
# Rows of one product: read from memory once for both products.
_GRAM_BLOCK = 8192
# Share of the record over which residual autocorrelation counts; beyond it a lag has too few products to be believed.
_LAG_SHARE = 0.2
# The square of the largest number a column may hold must leave room for a sum over any record.
_LARGEST = 1e100


@dataclass(frozen=True)
class RegressionResult:
    """Least squares of one regressand on named regressors.

    names: P names. values, std: (P,) estimates and standard errors for coloured residuals (Morelli & Klein);
    std_white: (P,) the same if residuals were white. covariance: (P, P), coloured. r2: coefficient of determination.
    residual: (N,). partial_f: (P,) (value over its white standard error, squared). vif: (P,) variance inflation
    factors, 1 for a regressor that no other resembles. condition: largest condition index of the scaled regressors.
    correlation: (P, P) of the estimates.
    """

    names: tuple[str, ...]
    values: Array
    std: Array
    std_white: Array
    covariance: Array
    r2: float
    residual: Array
    partial_f: Array
    vif: Array
    condition: float
    correlation: Array


def regress(
    y: Array,
    X: Array,
    names: Sequence[str],
    lengths: Sequence[int] | None = None,
    bandwidth: float = 1.0,
    prior: Gaussian | None = None,
) -> RegressionResult:
    """Ordinary least squares, or mixed estimation with a prior (Theil & Goldberger, 1961).

    Parameters
    ----------
    y : Array, shape (N,)
        Regressand.
    X : Array, shape (N, P)
        Regressors, a constant included as a column of ones where wanted.
    names : Sequence[str], length P
        Names of the regressors.
    lengths : Sequence[int] | None
        Samples of each uninterrupted part, adding up to N; None is one part.
    bandwidth : float
        Share of the Nyquist frequency that a filter left in y and X; it lowers the degrees of freedom.
    prior : Gaussian | None
        Of some or all of `names`; it weighs against residuals as large and as coloured as they are found.

    Returns
    -------
    RegressionResult
        Estimates with standard errors for coloured residuals.

    Raises
    ------
    EstimationError
        For wrong shapes, values that are not finite, or regressors that are linearly dependent.

    References
    ----------
    Klein & Morelli, chapter 5; Morelli & Klein, AIAA 95-3499.
    """
    y, X = np.asarray(y, dtype=np.float64), np.asarray(X, dtype=np.float64)
    parts = tuple(lengths) if lengths is not None else (y.size,)
    if X.ndim != 2 or y.shape != (X.shape[0],) or len(names) != X.shape[1] or sum(parts) != y.size:
        raise EstimationError(f"regression: shapes {y.shape}, {X.shape}, {len(names)} names, parts {parts} do not fit")
    _in_range(y, X, names)
    n, count = X.shape
    free = n * bandwidth - count
    if free < 1.0:
        raise EstimationError(f"regression: {n} samples are too few for {count} parameters ({', '.join(names)})")
    R, b, rss = _triangular(X, y)
    scale = np.sqrt(np.sum(R**2, axis=0))
    if not (np.all(np.isfinite(R)) and np.all(np.isfinite(b))):
        raise EstimationError("regression: regressand or regressors hold values that are not finite")
    noise, own = 0.0, np.zeros((count, count))
    if prior is not None:
        noise = _noise_density(y, X, R / np.where(scale > 0.0, scale, 1.0), b, rss, parts, free)
        own, known = _prior_rows(prior, names)
        R, b, _ = _triangular(np.vstack([R, own * np.sqrt(noise)]), np.concatenate([b, known * np.sqrt(noise)]))
        scale = np.sqrt(np.sum(R**2, axis=0))
    if np.any(scale == 0.0):
        raise EstimationError(f"regression: {names[int(np.argmin(scale))]} is zero throughout; leave it out")
    U, singular, Vt = np.linalg.svd(R / scale)
    if singular[-1] < 1e-10 * singular[0]:
        first, second = np.argsort(-np.abs(Vt[-1]))[:2]
        raise EstimationError(f"regression: {names[first]} and {names[second]} are linearly dependent; leave one out")
    values = (Vt.T @ ((U.T @ b) / singular)) / scale
    inverse = (Vt.T / singular**2) @ Vt / np.outer(scale, scale)
    residual = y - X @ values
    white = max(rss / free, noise) * inverse
    covariance = _coloured(X, residual, inverse, parts) * (n * bandwidth / free)
    covariance += noise**2 * inverse @ (own.T @ own) @ inverse
    # A residual bluer than white must not make the error bars narrower than white ones.
    std_white = np.sqrt(np.diag(white))
    std = np.maximum(np.sqrt(np.maximum(np.diag(covariance), 0.0)), std_white * np.sqrt(free / n))
    covariance *= np.outer(*(std / np.maximum(np.sqrt(np.maximum(np.diag(covariance), 0.0)), 1e-300),) * 2)
    total = float(np.sum((y - y.mean()) ** 2))
    return RegressionResult(
        tuple(names),
        values,
        std,
        std_white,
        covariance,
        1.0 - rss / total if total > 0.0 else 0.0,
        residual,
        values**2 / np.maximum(np.diag(white), 1e-300),
        _variance_inflation(X),
        float(singular[0] / singular[-1]),
        covariance / np.outer(*(np.maximum(std, 1e-150),) * 2),
    )


def mixed_values(y: Array, X: Array, names: Sequence[str], bandwidth: float, prior: Gaussian | None) -> Array:
    """(P,) estimates of `regress` without their errors; residuals count as white when weighed against the prior.

    Raises EstimationError for linearly dependent regressors without a prior that distinguishes them.
    """
    R, b, rss = _triangular(X, y)
    if prior is not None:
        own, known = _prior_rows(prior, names)
        root = np.sqrt(rss / max(y.size * bandwidth - len(names), 1.0))
        R, b, _ = _triangular(np.vstack([R, own * root]), np.concatenate([b, known * root]))
    scale = np.sqrt(np.sum(R**2, axis=0))
    if not np.all(np.isfinite(R)) or np.any(scale == 0.0) or np.linalg.cond(R / scale) > 1e10:
        raise EstimationError(f"regression: {', '.join(names)} cannot be distinguished; leave some out")
    return np.asarray(linalg.solve_triangular(R / scale, b) / scale, dtype=np.float64)


def gram_regress(y: Array, X: Array) -> tuple[Array, Array, float]:
    """Least squares by one Gram matrix, for long records: values (P,), white covariance (P, P), residual variance.

    y: (N,). X: (N, P). One pass over the data instead of a factorisation; where the scaled regressors have a condition
    number above 1e5, at which squaring it would cost more than five digits, blocked QR is used instead.
    Raises EstimationError for fewer samples than parameters or linearly dependent regressors.
    """
    n, count = X.shape
    if n <= count:
        raise EstimationError(f"regression: {n} samples are too few for {count} parameters")
    # Out of range is found by the sums, not by a look at every sample beforehand: that would double the time.
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        gram, moment, power = _gram(X, y)
    _check_sizes(np.sqrt(np.append(power, np.diag(gram)) / n))
    scale = np.sqrt(np.diag(gram))
    if not np.all(scale > 0.0):
        raise EstimationError("regression: a regressor is zero throughout or not finite; leave it out")
    scaled = gram / np.outer(scale, scale)
    if np.linalg.cond(scaled) < 1e10:
        inverse = np.linalg.inv(scaled) / np.outer(scale, scale)
        values = inverse @ moment
        rss = power - float(values @ moment)
        if rss > 1e-9 * power:
            variance = rss / (n - count)
            return values, variance * inverse, variance
    R, b, rss = _triangular(X, y)
    if np.abs(np.diag(R / scale)).min() < 1e-10:
        raise EstimationError("regression: regressors are linearly dependent; leave one out")
    inverse = np.linalg.inv(R)
    variance = rss / (n - count)
    return inverse @ b, variance * (inverse @ inverse.T), variance


def _gram(X: Array, y: Array) -> tuple[Array, Array, float]:
    """X'X, X'y and y'y in one pass over the data."""
    count = X.shape[1]
    gram, moment = np.zeros((count, count)), np.zeros(count)
    for first in range(0, X.shape[0], _GRAM_BLOCK):
        rows = X[first : first + _GRAM_BLOCK]
        gram += rows.T @ rows
        moment += y[first : first + _GRAM_BLOCK] @ rows
    return gram, moment, float(y @ y)


def _check_sizes(sizes: Array) -> None:
    """Raise EstimationError for root mean squares (regressand, regressors) whose squares no number holds."""
    for i, size in enumerate(sizes):
        if np.isinf(size) or size > _LARGEST or 0.0 < size < 1.0 / _LARGEST:
            name = f"regressor {i}" if i else "the regressand"
            raise EstimationError(f"regression: {name} reaches {size:.3g}; check its unit, or leave it out")


def _noise_density(y: Array, X: Array, R: Array, b: Array, rss: float, parts: tuple[int, ...], free: float) -> float:
    """Variance that white residuals would need to move the regressors as far as the coloured ones do.

    R: (P, P) triangular factor of scaled regressors, possibly singular.
    """
    scale = np.sqrt(np.sum(X**2, axis=0))
    scaled = X / np.where(scale > 0.0, scale, 1.0)
    residual = y - scaled @ np.linalg.lstsq(R, b, rcond=1e-10)[0]
    spread = np.diag(_coloured(scaled, residual, np.eye(scale.size), parts))
    moving = scale > 0.0
    return max(rss / free, float(np.mean(spread[moving])) if moving.any() else 0.0)


def _prior_rows(prior: Gaussian, names: Sequence[str]) -> tuple[Array, Array]:
    """A prior as observations of unit variance: rows (K, P) and values (K,)."""
    place = [list(names).index(name) for name in prior.names]
    std = np.sqrt(np.diag(prior.covariance))
    root = np.linalg.cholesky(prior.covariance / np.outer(std, std))
    rows = np.zeros((std.size, len(names)))
    rows[:, place] = np.linalg.solve(root, np.diag(1.0 / std))
    return rows, np.asarray(np.linalg.solve(root, prior.mean / std), dtype=np.float64)


def _in_range(y: Array, X: Array, names: Sequence[str]) -> None:
    """Raise EstimationError for a column whose square no floating-point number holds: its unit is no one's."""
    for name, column in (("the regressand", y), *zip(names, X.T, strict=True)):
        largest = float(np.max(np.abs(column)))
        if largest > 0.0 and not 1.0 / _LARGEST < largest < _LARGEST:
            raise EstimationError(f"regression: {name} reaches {largest:.3g}; check its unit, or leave it out")


def _triangular(X: Array, y: Array) -> tuple[Array, Array, float]:
    """R (P, P), Q'y (P,) and residual sum of squares of X = QR, block by block."""
    count = X.shape[1]
    stack = np.empty((0, count + 1))
    for first in range(0, X.shape[0], _BLOCK):
        rows = np.column_stack([X[first : first + _BLOCK], y[first : first + _BLOCK]])
        stack = linalg.qr(np.vstack([stack, rows]), mode="r", check_finite=False)[0][: count + 1]
    padded = np.zeros((count + 1, count + 1))
    padded[: stack.shape[0]] = stack
    return padded[:count, :count], padded[:count, count], float(padded[count, count] ** 2)


def _coloured(X: Array, residual: Array, inverse: Array, parts: tuple[int, ...]) -> Array:
    """(X'X)^-1 [sum_i sum_j Rvv(i-j) x_i x_j'] (X'X)^-1, Rvv pooled over the parts (Morelli & Klein, eq. 24)."""
    lags = max(int(_LAG_SHARE * min(max(parts), 5000)), 1)
    autocovariance = np.zeros(lags + 1)
    edges = np.concatenate([[0], np.cumsum(parts)])
    for start, stop in pairwise(edges):
        autocovariance += _correlate(residual[start:stop], lags)
    autocovariance /= residual.size
    # The triangle keeps the sum positive definite (Bartlett).
    autocovariance *= 1.0 - np.arange(lags + 1) / (lags + 1.0)
    middle = np.zeros_like(inverse)
    for start, stop in pairwise(edges):
        block = X[start:stop]
        n = block.shape[0]
        size = fft.next_fast_len(n + lags, real=True)
        kernel = np.zeros(size)
        kernel[: lags + 1] = autocovariance
        kernel[size - lags :] = autocovariance[1:][::-1]
        spectrum = fft.rfft(kernel).real[:, None] * fft.rfft(block, size, axis=0)
        middle += block.T @ fft.irfft(spectrum, size, axis=0)[:n]
    return np.asarray(inverse @ (0.5 * (middle + middle.T)) @ inverse, dtype=np.float64)


def _correlate(values: Array, lags: int) -> Array:
    """Sum of v[i] v[i + lag] for lag 0..lags."""
    size = fft.next_fast_len(values.size + lags, real=True)
    spectrum = np.abs(fft.rfft(values, size)) ** 2
    return np.asarray(fft.irfft(spectrum, size)[: lags + 1], dtype=np.float64)


def _variance_inflation(X: Array) -> Array:
    """1 / (1 - R_j^2) about the means; constants count as 1."""
    spread = X.std(axis=0)
    moving = spread > 1e-12 * np.maximum(np.abs(X).max(axis=0), 1e-300)
    vif = np.ones(X.shape[1])
    if np.count_nonzero(moving) > 1:
        vif[moving] = np.diag(inverse(np.asarray(np.corrcoef(X[:, moving], rowvar=False))))
    return vif
