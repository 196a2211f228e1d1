"""How the likelihood of a Kalman pass depends on the variances behind it (compiled).

The filter is differentiated by every variance, which gives the exact gradient and the expected information: scoring
finds noise and turbulence together, where innovations alone could not tell one from the other. Source: Maine & Iliff,
NASA RP-1168, section 5.3; K. J. Astrom, "Maximum likelihood and prediction error methods", Automatica 16(5), 1980.
"""

from __future__ import annotations

from math import log

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit

Array = NDArray[np.float64]


@jit
def variance_pass(
    transition: Array, drift: Array, left: Array, observe: Array, jump: Array, noise: Array, process: Array,
    p_start: Array, d_transition: Array, d_process: Array, d_start: Array,
) -> tuple[float, Array, Array]:  # fmt: skip
    """One forward pass and its derivatives by the logarithms of m noise variances and of T turbulence parameters.

    The first eight arguments: see sysid.filter_pass.kalman_pass. d_transition, d_process: (T, N - 1, nx, nx) and
    d_start: (T, nx, nx) derivatives by the parameters of the turbulence.
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
            nu, big = left[k, j], noise[j]
            for a in range(nx):
                total = 0.0
                for b in range(nx):
                    total += p[a, b] * h[b]
                hp[a] = total
            for a in range(nx):
                nu -= h[a] * s[a]
                big += h[a] * hp[a]
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
