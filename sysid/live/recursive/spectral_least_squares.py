"""Weighted least squares over the lines of a spectrum, compiled: an axis has few unknowns and is solved often."""

from __future__ import annotations

import numpy as np

from sim_vehicle.jit import jit_arrays
from sysid.arrays import Array

# Rounds of reweighting by the spectrum of what is left; smallest eigenvalue of normal equations, of the largest.
_ROUNDS = 3
_SINGULAR = 1e-9
# Of Student's quantile at 97.5 %, over that of the normal distribution: powers of 1 / degrees of freedom.
# Source: Abramowitz & Stegun, 26.7.5.
_STUDENT = (1.21, 1.44)
_LEAST_FREEDOM = 0.5
_LEAST_SHARE = 0.1
# Noise is taken off where something would be left if it were by so many of its standard deviations more.
_SURE = 2.0


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
def _freedom(weight: Array, X: Array, prior_std: Array, windows: float) -> Array:
    """(M,) share of each line's power that the fit leaves where there is noise alone: 1 less its leverage.

    Without it, lines that a fit of few data meets exactly would count as exact, and be met the more exactly for it.
    Source: J. G. MacKinnon & H. White, Journal of Econometrics 29, 1985 (HC2).
    """
    lines, n, _ = X.shape
    inverse = np.linalg.inv(_normal(weight, X, np.zeros(n), prior_std))
    share = np.empty(lines)
    for m in range(lines):
        leverage = 0.0
        for i in range(n):
            for j in range(n):
                leverage += weight[m] * inverse[i, j] * X[m, j, i]
        share[m] = max(1.0 - leverage / (2.0 * windows), _LEAST_SHARE)
    return share


@jit_arrays
def _spread(A: Array, X: Array, rest: Array, spectrum: Array, prior_std: Array) -> Array:
    """Covariance (n, n) by the smooth spectrum of the residuals, or where it is larger by each line's own residual."""
    n = A.shape[0]
    inverse = np.zeros((n, n))
    inverse[:] = np.linalg.inv(A)
    observed = _normal(2.0 * rest / spectrum**2, X, np.zeros(n), prior_std)
    growth = np.ones(n)
    for i in range(n):
        robust = 0.0
        for j in range(n):
            for k in range(n):
                robust += inverse[i, j] * observed[j, k] * inverse[k, i]
        growth[i] = np.sqrt(max(robust / inverse[i, i], 1.0))
    for i in range(n):
        for j in range(n):
            inverse[i, j] *= growth[i] * growth[j]
    return inverse


@jit_arrays
def _noise_spread(A: Array, weight: Array, taken_off: Array, doubt: Array, squares: Array, windows: float) -> Array:
    """Covariance (n, n) by what is not known of the noise in the regressors' own power.

    taken_off: its mean was taken off, and in each line of a window it scatters by as much as it is. doubt: all of
    it is still in there. squares: (n,) what each coefficient's square may be: a regressor that is noise alone makes
    its coefficient small. Such an error e of a diagonal element of A moves the coefficients by e times its
    column of the inverse, times the coefficient.
    """
    n = A.shape[0]
    inverse = np.linalg.inv(A)
    total, scatter = np.sum(weight), np.sum(weight**2) / windows
    found = np.zeros((n, n))
    for i in range(n):
        power = (doubt[i] * total) ** 2 + taken_off[i] ** 2 * scatter
        for j in range(n):
            for k in range(n):
                found[j, k] += power * squares[i] * inverse[j, i] * inverse[i, k]
    return found


@jit_arrays
def weighted(
    X: Array,
    y: Array,
    power: Array,
    error: Array,
    left_in: Array,
    sizes: Array,
    frequencies: Array,
    windows: float,
    prior_mean: Array,
    prior_std: Array,
) -> tuple[Array, Array]:
    """Least squares over lines weighted by the residuals' own spectrum, a + b f^2; values (n,) and covariance (n, n).

    X (M, n, n), y (M, n), power (M,): products of the regressors, with the left side, and of that with itself.
    error, left_in: (n,) noise in each regressor's power that is taken off, and that is not. sizes: (n,) usual ones.
    windows: how many windows the products are of.
    A differentiated rate's noise rises with the square of the frequency, a vane's is flat: both are in the residuals.
    The covariance is the larger, by each coefficient, of what that spectrum and what each line's own residual give,
    with what the regressors' noise leaves in doubt, and as much larger as few data make it.
    """
    lines, n = y.shape
    nothing = np.zeros(n)
    taken_off, doubt = error, left_in
    spectrum = np.ones(lines)
    rest = np.ones(lines)
    theta = np.zeros(n)
    A = np.eye(n)
    for _ in range(_ROUNDS):
        # Of a complex line's noise half is in its real part, half in its imaginary one.
        weight = 2.0 / spectrum
        scatter = np.sqrt(np.sum(weight**2) / windows) / np.sum(weight)
        if _singular(_normal(weight, X, taken_off * (1.0 + _SURE * scatter), prior_std)):
            taken_off, doubt = nothing, left_in + error
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
        free = _freedom(weight, X, prior_std, windows)
        # What a fit leaves, the vanes' noise in it, which is noise of the equation.
        for m in range(lines):
            left = power[m]
            for i in range(n):
                left -= 2.0 * y[m, i] * theta[i]
                for j in range(n):
                    left += theta[i] * X[m, i, j] * theta[j]
            rest[m] = max(left, 1e-30) / (windows * free[m])
        spectrum = smooth_spectrum(rest, frequencies)
    spread = _spread(A, X, rest, spectrum, prior_std)
    spread += _noise_spread(A, 2.0 / spectrum, taken_off, doubt, theta**2 + sizes**2, windows)
    freedom = max(2.0 * lines * windows - n, _LEAST_FREEDOM)
    return theta, spread * (1.0 + _STUDENT[0] / freedom + _STUDENT[1] / freedom**2) ** 2
