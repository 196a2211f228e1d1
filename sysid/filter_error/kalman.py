"""How the likelihood of a Kalman pass depends on the variances behind it (compiled).

The filter is differentiated by every variance, which gives the exact gradient and the expected information: scoring
finds noise and turbulence together, where innovations alone could not distinguish one from the other. Source: Maine &
Iliff, NASA RP-1168, section 5.3; K. J. Astrom, "Maximum likelihood and prediction error methods", Automatica 16(5),
1980.

The gradient alone comes at a fraction of that from a smoother's way back, which carries the derivatives of what is
still to come by the state's mean and covariance: with x and P those before a reading, dL/dx = -l and
dL/dP = (l l' - L) / 2. Sources: G. J. Bierman, "Fixed interval smoothing with discrete measurements", Int. J. Control
18(1), 1973; S. J. Koopman & N. Shephard, "Exact score for time series models in state space form", Biometrika 79(4),
1992.
"""

from __future__ import annotations

from math import log

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit_arrays
from sysid.numerics.kalman import innovation

Array = NDArray[np.float64]


@jit_arrays
def variance_pass(
    transition: Array, drift: Array, left: Array, observe: Array, jump: Array, noise: Array, process: Array,
    p_start: Array, d_transition: Array, d_process: Array, d_start: Array,
) -> tuple[float, Array, Array]:  # fmt: skip
    """One forward pass and its derivatives by the logarithms of m noise variances and of T turbulence parameters.

    The first eight arguments: see sysid.filter_error.kalman.kalman_pass. d_transition, d_process: (T, N - 1, nx, nx)
    and d_start: (T, nx, nx) derivatives by the parameters of the turbulence.
    Returns log likelihood, its gradient (m + T,) and information (m + T, m + T).
    """
    n, m, nx = left.shape[0], left.shape[1], p_start.shape[0]
    count = m + d_process.shape[0]
    gradient, information = np.zeros(count), np.zeros((count, count))
    s, p = np.zeros(nx), p_start.copy()
    ds, dp = np.zeros((count, nx)), np.zeros((count, nx, nx))
    for t in range(m, count):
        dp[t] = d_start[t - m]
    gain, hp = np.empty(nx), np.empty(nx)
    d_hp, d_nu, d_big = np.empty((count, nx)), np.empty(count), np.empty(count)
    likelihood = 0.0
    for k in range(n):
        for j in range(m):
            if np.isnan(left[k, j]):
                continue
            h = observe[k, j]
            nu, big = innovation(s, p, h, left[k, j], noise[j], hp)
            for a in range(nx):
                gain[a] = hp[a] / big
            for t in range(count):
                change, shift = (noise[j] if t == j else 0.0), 0.0
                for a in range(nx):
                    total = 0.0
                    for b in range(nx):
                        total += dp[t, a, b] * h[b]
                    d_hp[t, a] = total
                for a in range(nx):
                    change += h[a] * d_hp[t, a]
                    shift -= h[a] * ds[t, a]
                d_big[t], d_nu[t] = change, shift
                for a in range(nx):
                    d_gain = (d_hp[t, a] - gain[a] * change) / big
                    ds[t, a] += d_gain * nu + gain[a] * shift
                    for b in range(nx):
                        dp[t, a, b] -= d_gain * hp[b] + gain[a] * d_hp[t, b]
            for a in range(nx):
                s[a] += gain[a] * nu
                for b in range(nx):
                    p[a, b] -= gain[a] * hp[b]
            likelihood -= 0.5 * (nu * nu / big + log(big))
            for t in range(count):
                gradient[t] -= (nu * d_nu[t] + 0.5 * d_big[t] * (1.0 - nu * nu / big)) / big
                for o in range(t + 1):
                    information[t, o] += (d_nu[t] * d_nu[o] + 0.5 * d_big[t] * d_big[o] / big) / big
        for a in range(nx):
            s[a] -= jump[k, a]
        if k + 1 == n:
            break
        step = transition[k]
        fp = step @ p
        for t in range(count):
            fdp = step @ dp[t]
            fresh = step @ ds[t]
            new = fdp @ step.T
            if t >= m:
                move = d_transition[t - m, k]
                cross = move @ p @ step.T
                new += cross + cross.T + d_process[t - m, k]
                fresh += move @ s
            dp[t] = new
            ds[t] = fresh
        s = step @ s + drift[k]
        p = fp @ step.T + process[k]
    for t in range(count):
        for o in range(t):
            information[o, t] = information[t, o]
    return likelihood, gradient, information


@jit_arrays
def variance_gradient(
    transition: Array, drift: Array, left: Array, observe: Array, jump: Array, noise: Array, process: Array,
    p_start: Array, d_transition: Array, d_process: Array, d_start: Array,
) -> tuple[float, Array]:  # fmt: skip
    """Log likelihood and gradient (m + T,) of `variance_pass`, for the same arguments."""
    n, m, nx, turbulence = left.shape[0], left.shape[1], p_start.shape[0], d_process.shape[0]
    gains, weights, shares = np.zeros((n, m, nx)), np.zeros((n, m)), np.zeros((n, m))
    states, spreads = np.empty((n, nx)), np.empty((n, nx, nx))
    s, p = np.zeros(nx), p_start.copy()
    hp = np.empty(nx)
    likelihood = 0.0
    for k in range(n):
        for j in range(m):
            if np.isnan(left[k, j]):
                continue
            h = observe[k, j]
            nu, big = innovation(s, p, h, left[k, j], noise[j], hp)
            for a in range(nx):
                gain = hp[a] / big
                gains[k, j, a] = gain
                s[a] += gain * nu
                for b in range(nx):
                    p[a, b] -= gain * hp[b]
            weights[k, j], shares[k, j] = 1.0 / big, nu / big
            likelihood -= 0.5 * (nu * nu / big + log(big))
        for a in range(nx):
            s[a] -= jump[k, a]
        states[k], spreads[k] = s, p
        if k + 1 < n:
            s = transition[k] @ s + drift[k]
            p = transition[k] @ p @ transition[k].T + process[k]
    gradient = np.zeros(m + turbulence)
    back, curved, row = np.zeros(nx), np.zeros((nx, nx)), np.empty(nx)
    for k in range(n - 1, -1, -1):
        if k + 1 < n:
            # By the covariance expected at the next sample, and by the step that leads there.
            for a in range(nx):
                for b in range(nx):
                    curved[a, b] = 0.5 * (back[a] * back[b] - curved[a, b])
            if turbulence:
                by_step = 2.0 * (curved @ (transition[k] @ spreads[k]))
                for t in range(turbulence):
                    for a in range(nx):
                        for b in range(nx):
                            gradient[m + t] += curved[a, b] * d_process[t, k, a, b]
                            gradient[m + t] += (by_step[a, b] - back[a] * states[k, b]) * d_transition[t, k, a, b]
            for a in range(nx):
                for b in range(nx):
                    curved[a, b] = back[a] * back[b] - 2.0 * curved[a, b]
            back = transition[k].T @ back
            curved = transition[k].T @ curved @ transition[k]
        for j in range(m - 1, -1, -1):
            if np.isnan(left[k, j]):
                continue
            h, gain_j = observe[k, j], gains[k, j]
            error, doubt = shares[k, j], weights[k, j]
            for a in range(nx):
                error += gain_j[a] * back[a]
                row[a] = 0.0
                for b in range(nx):
                    row[a] += curved[a, b] * gain_j[b]
            for a in range(nx):
                doubt += gain_j[a] * row[a]
            gradient[j] += 0.5 * noise[j] * (error * error - doubt)
            for a in range(nx):
                back[a] -= h[a] * error
                for b in range(nx):
                    curved[a, b] += doubt * h[a] * h[b] - h[a] * row[b] - row[a] * h[b]
    for t in range(turbulence):
        for a in range(nx):
            for b in range(nx):
                gradient[m + t] += 0.5 * (back[a] * back[b] - curved[a, b]) * d_start[t, a, b]
    return likelihood, gradient


@jit_arrays
def kalman_pass(
    transition: Array, drift: Array, step_slopes: Array, left: Array, observe: Array, read_slopes: Array, jump: Array,
    noise: Array, process: Array, p_start: Array, wanted: bool,
) -> tuple[float, Array, Array, Array, Array, Array, Array, Array, Array, Array]:  # fmt: skip
    """One forward pass over deviations from a path.

    transition: (N - 1, nx, nx); drift: (N - 1, nx) path's own step less the path. step_slopes: (N - 1, nx, P).
    left: (N, m) measured less the path's outputs, NaN missing. observe: (N, m, nx). read_slopes: (N, m, P).
    jump: (N, nx) path after a sample less that before it. noise: (m,) variances. process: (N - 1, nx, nx), p_start:
    (nx, nx) covariances.
    wanted: whether information and gradient of the P parameters are.
    Returns log likelihood; information (P, P) and downhill gradient (P,); innovations and their variances (N, m);
    deviations before and after each sample (N, nx); and if `wanted` the slopes of the innovations (N, m, P) and of both
    deviations (N, nx, P).
    """
    n, m, nx, count = left.shape[0], left.shape[1], p_start.shape[0], step_slopes.shape[2]
    nu_all, variance = np.full((n, m), np.nan), np.full((n, m), np.nan)
    before, after = np.empty((n, nx)), np.empty((n, nx))
    kept = n if wanted else 0
    slopes = np.zeros((kept, m, count))
    d_before, d_after = np.zeros((kept, nx, count)), np.zeros((kept, nx, count))
    information, gradient = np.zeros((count, count)), np.zeros(count)
    s, p, d = np.zeros(nx), p_start.copy(), np.zeros((nx, count))
    gain, hp, slope, fp, fresh = np.empty(nx), np.empty(nx), np.empty(count), np.empty((nx, nx)), np.empty((nx, count))
    likelihood = 0.0
    for k in range(n):
        before[k] = s
        if wanted:
            d_before[k] = d
        for j in range(m):
            if np.isnan(left[k, j]):
                continue
            h = observe[k, j]
            nu, big = innovation(s, p, h, left[k, j], noise[j], hp)
            for a in range(nx):
                gain[a] = hp[a] / big
                s[a] += gain[a] * nu
            for a in range(nx):
                for b in range(nx):
                    p[a, b] -= gain[a] * hp[b]
            nu_all[k, j], variance[k, j] = nu, big
            likelihood -= 0.5 * (nu * nu / big + log(big))
            if wanted:
                for c in range(count):
                    slope[c] = read_slopes[k, j, c]
                for a in range(nx):
                    if h[a] != 0.0:
                        for c in range(count):
                            slope[c] += h[a] * d[a, c]
                for a in range(nx):
                    for c in range(count):
                        d[a, c] -= gain[a] * slope[c]
                for c in range(count):
                    slopes[k, j, c] = slope[c]
        for a in range(nx):
            s[a] -= jump[k, a]
            after[k, a] = s[a]
        if wanted:
            d_after[k] = d
        if k + 1 == n:
            break
        step = transition[k]
        s = step @ s + drift[k]
        fp[:] = step @ p
        p = fp @ step.T + process[k]
        if wanted:
            fresh[:] = step @ d
            for a in range(nx):
                for c in range(count):
                    d[a, c] = fresh[a, c] + step_slopes[k, a, c]
    if wanted:
        rows = np.empty((m, count))
        for k in range(n):
            for j in range(m):
                good = not np.isnan(nu_all[k, j])
                weight = 1.0 / np.sqrt(variance[k, j]) if good else 0.0
                for c in range(count):
                    rows[j, c] = slopes[k, j, c] * weight
                    if good:
                        gradient[c] += rows[j, c] * weight * nu_all[k, j]
            information += rows.T @ rows
    return likelihood, information, gradient, nu_all, variance, before, after, slopes, d_before, d_after
