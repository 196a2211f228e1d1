"""Weighted least squares over the lines of a spectrum, compiled: an axis has few unknowns and is solved often."""

from __future__ import annotations

import numpy as np

from sim_vehicle.jit import jit_arrays
from sysid.flight import Array

_ROUNDS = 3
_SINGULAR = 1e-9


@jit_arrays
def _normal(weight: Array, X: Array, error: Array, prior_std: Array) -> Array:
    """Sum of the lines' products by weight, less the known errors', with the prior's weight."""
    lines, n, _ = X.shape
    A = np.zeros((n, n))
    for m in range(lines):
        for i in range(n):
            A[i, i] -= weight[m] * error[i]
            for j in range(n):
                A[i, j] += weight[m] * X[m, i, j]
    for i in range(n):
        A[i, i] += prior_std[i] ** -2.0
    return A


@jit_arrays
def _singular(A: Array) -> bool:
    """Whether a matrix, scaled to a diagonal of 1, is not safely positive."""
    n = A.shape[0]
    scaled = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            scaled[i, j] = A[i, j] / np.sqrt(np.abs(A[i, i]) * np.abs(A[j, j]))
    return bool(np.linalg.eigvalsh(scaled)[0] <= _SINGULAR)


@jit_arrays
def smooth_spectrum(power: Array, frequencies: Array) -> Array:
    """a + b f^2 with a, b >= 0 nearest to the lines' powers (M,), whose errors are as large as they are.

    Where the free solution has a negative part, the best lies on the edge on which that part is 0: the sum of
    squares is convex, and with no negative numbers in it the other part cannot become negative in turn.
    """
    mean = np.mean(power)
    spectrum = np.full(power.size, mean)
    for _ in range(2):
        aa, ab, bb, ay, by = 0.0, 0.0, 0.0, 0.0, 0.0
        for m in range(power.size):
            one, square, y = 1.0 / spectrum[m], frequencies[m] ** 2 / spectrum[m], power[m] / spectrum[m]
            aa, ab, bb = aa + one * one, ab + one * square, bb + square * square
            ay, by = ay + one * y, by + square * y
        a, b = bb * ay - ab * by, aa * by - ab * ay  # times the determinant
        if a <= 0.0:
            level, rise = 0.0, by / bb
        elif b <= 0.0:
            level, rise = ay / aa, 0.0
        else:
            level, rise = a / (aa * bb - ab * ab), b / (aa * bb - ab * ab)
        for m in range(power.size):
            spectrum[m] = max(level + rise * frequencies[m] ** 2, 1e-3 * mean)
    return spectrum


@jit_arrays
def weighted(
    X: Array,
    y: Array,
    power: Array,
    error: Array,
    frequencies: Array,
    windows: float,
    prior_mean: Array,
    prior_std: Array,
) -> tuple[Array, Array]:
    """Least squares over lines weighted by the residuals' own spectrum, a + b f^2; values (n,) and covariance (n, n).

    X (M, n, n), y (M, n), power (M,): products of the regressors, with the left side, and of that with itself.
    error: (n,) known noise in each regressor's power. windows: how many windows the products are of.
    A differentiated rate's noise rises with the square of the frequency, a vane's is flat: both are in the residuals.
    The covariance is the larger, by each coefficient, of what that spectrum and what each line's own residual tell.
    """
    lines, n = y.shape
    free = max(1.0 - (n - 1) / (2.0 * lines * windows), 0.1)
    nothing = np.zeros(n)
    taken_off = error
    spectrum = np.ones(lines)
    rest = np.ones(lines)
    theta = np.zeros(n)
    A = np.eye(n)
    for _ in range(_ROUNDS):
        # Of a complex line's noise half is in its real part, half in its imaginary one.
        weight = 2.0 / spectrum
        A = _normal(weight, X, taken_off, prior_std)
        if _singular(A):
            taken_off = nothing
            A = _normal(weight, X, taken_off, prior_std)
        # Sensors that stand still, of which every residual is rounding: so exact is no arithmetic.
        while _singular(A):
            weight *= 0.1
            A = _normal(weight, X, taken_off, prior_std)
        right = np.zeros(n)
        for i in range(n):
            right[i] = prior_mean[i] / prior_std[i] ** 2
            for m in range(lines):
                right[i] += weight[m] * y[m, i]
        theta[:] = np.linalg.solve(A, right)
        # What a fit leaves, the vanes' noise in it, which is noise of the equation.
        for m in range(lines):
            left = power[m]
            for i in range(n):
                left -= 2.0 * y[m, i] * theta[i]
                for j in range(n):
                    left += theta[i] * X[m, i, j] * theta[j]
            rest[m] = max(left, 1e-30) / (windows * free)
        spectrum = smooth_spectrum(rest, frequencies)
    inverse = np.zeros((n, n))
    inverse[:] = np.linalg.inv(A)
    told = _normal(2.0 * rest / spectrum**2, X, nothing, prior_std)
    growth = np.ones(n)
    for i in range(n):
        robust = 0.0
        for j in range(n):
            for k in range(n):
                robust += inverse[i, j] * told[j, k] * inverse[k, i]
        growth[i] = np.sqrt(max(robust / inverse[i, i], 1.0))
    for i in range(n):
        for j in range(n):
            inverse[i, j] *= growth[i] * growth[j]
    return theta, inverse
