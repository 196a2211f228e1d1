"""One linearised pass of the kinematic equations over the measurements: likelihood, innovations, smoothed states.

Integrated IMU noise and turbulence are process noise here, so the innovations are white and the inverse of the
information is the real covariance; a plain output-error fit of the same equations treats both as if they were zero.
Everything is linear about a nominal trajectory, which the caller renews. Sensor errors are constants of a pass, not
states: as states they would be fitted together with the gusts, and a scale factor that makes the gusts smaller
would win (measured: alpha_scale +0.4 in gusts of 0.3 m/s).

State, 9: u v w phi theta psi | gust north east down.
Sources: Klein & Morelli, "Aircraft System Identification", chapters 5 and 10; G. J. Bierman, "Factorization Methods
for Discrete Sequential Estimation", chapter X (modified Bryson-Frazier smoother).
"""

from __future__ import annotations

from math import asin, atan2, cos, log, sin, sqrt

import numpy as np

from sim_vehicle.jit import jit, jit_arrays
from sysid.arrays import Array

PARAMETERS = (
    *("accel_bias_x", "accel_bias_y", "accel_bias_z", "gyro_bias_p", "gyro_bias_q", "gyro_bias_r"),
    *("alpha_scale", "alpha_bias", "beta_scale", "beta_bias", "airspeed_scale", "airspeed_bias"),
    *("phi_bias", "theta_scale", "theta_bias", "wind_north", "wind_east", "wind_down"),
)
OUTPUTS = ("airspeed", "alpha", "beta", "phi", "theta", "psi", "vn", "ve", "vd")

_X, _G = 6, 9  # ends of the states and of the gusts
_M = 9  # outputs
_P = 18  # sensor errors
# Per output: index of its scale factor and of its bias among the sensor errors, -1 for none.
_SCALE = np.array([10, 6, 8, -1, 13, -1, -1, -1, -1])
_OFFSET = np.array([11, 7, 9, 12, 14, -1, 15, 16, 17])


@jit
def true_outputs(x: Array, gust: Array, rates: Array, layout: Array, out: Array) -> None:
    """What perfect sensors at their places read.

    x: (6,) state. gust: (3,) NED m/s, velocity of the air besides the mean wind. rates: (3,) rad/s.
    layout: (7,) airspeed factor, alpha vane x y, beta vane x z, 1.0 for a flank vane, gravity.
    out: (9,), written, order OUTPUTS; velocities relative to the mean air mass.
    """
    sf, cf, st, ct = sin(x[3]), cos(x[3]), sin(x[4]), cos(x[4])
    sp, cp = sin(x[5]), cos(x[5])
    r00, r01, r02 = ct * cp, sf * st * cp - cf * sp, cf * st * cp + sf * sp
    r10, r11, r12 = ct * sp, sf * st * sp + cf * cp, cf * st * sp - sf * cp
    r20, r21, r22 = -st, sf * ct, cf * ct
    u = x[0] - (r00 * gust[0] + r10 * gust[1] + r20 * gust[2])
    v = x[1] - (r01 * gust[0] + r11 * gust[1] + r21 * gust[2])
    w = x[2] - (r02 * gust[0] + r12 * gust[1] + r22 * gust[2])
    speed = max(sqrt(u * u + v * v + w * w), 0.1)
    out[0] = speed / layout[0]
    out[1] = atan2(w, u) - layout[1] * rates[1] / speed + layout[2] * rates[0] / speed
    side = atan2(v, u) if layout[5] > 0.5 else asin(max(-1.0, min(1.0, v / speed)))
    out[2] = side + layout[3] * rates[2] / speed - layout[4] * rates[0] / speed
    out[3], out[4], out[5] = x[3], x[4], x[5]
    out[6] = r00 * x[0] + r01 * x[1] + r02 * x[2]
    out[7] = r10 * x[0] + r11 * x[1] + r12 * x[2]
    out[8] = r20 * x[0] + r21 * x[1] + r22 * x[2]


@jit
def sensor_model(y: Array, theta: Array, out: Array) -> None:
    """Readings from true outputs: (1 + scale) y + bias, wind added to the velocities. y, out: (9,). theta: (18,)."""
    out[0] = (1.0 + theta[10]) * y[0] + theta[11]
    out[1] = (1.0 + theta[6]) * y[1] + theta[7]
    out[2] = (1.0 + theta[8]) * y[2] + theta[9]
    out[3] = y[3] + theta[12]
    out[4] = (1.0 + theta[13]) * y[4] + theta[14]
    out[5] = y[5]
    out[6] = y[6] + theta[15]
    out[7] = y[7] + theta[16]
    out[8] = y[8] + theta[17]


@jit_arrays
def predict_readings(states: Array, gusts: Array, imu: Array, theta: Array, layout: Array) -> Array:
    """(N, 9) readings along (N, 6) states in (N, 3) gusts; imu: (N, 6) measured. theta: (18,). layout: (7,)."""
    predicted = np.empty((states.shape[0], _M))
    y, rates = np.empty(_M), np.empty(3)
    for i in range(states.shape[0]):
        for a in range(3):
            rates[a] = imu[i, 3 + a] - theta[3 + a]
        true_outputs(states[i], gusts[i], rates, layout, y)
        sensor_model(y, theta, predicted[i])
    return predicted


@jit
def _propagate(s: Array, p: Array, f: Array, decay: float, q_imu: Array, q_gust: float, new: Array) -> None:
    """Time update of deviation s (9,) and covariance p (9, 9), in place; new: (6,), work."""
    for i in range(6):
        new[i] = 0.0
        for a in range(6):
            new[i] += f[i, a] * s[a]
    for i in range(6):
        s[i] = new[i]
    # F P, then (F P) F': rows first, columns after.
    for c in range(_G):
        for i in range(6):
            new[i] = 0.0
            for a in range(6):
                new[i] += f[i, a] * p[a, c]
        for i in range(6):
            p[i, c] = new[i]
    for r in range(_G):
        for i in range(6):
            new[i] = 0.0
            for a in range(6):
                new[i] += f[i, a] * p[r, a]
        for i in range(6):
            p[r, i] = new[i]
    for i in range(_X, _G):
        s[i] *= decay
        for c in range(_G):
            p[i, c] *= decay
        for r in range(_G):
            p[r, i] *= decay
    for i in range(6):
        for c in range(6):
            for a in range(6):
                p[i, c] += f[i, 6 + a] * q_imu[a] * f[c, 6 + a]
    for i in range(_X, _G):
        p[i, i] += q_gust


@jit
def _update(s: Array, p: Array, h: Array, nu: float, noise: float, k: Array, hp: Array) -> float:
    """Measurement update by one scalar with innovation nu, gain written to k (9,); the innovation's variance."""
    variance = noise
    for a in range(_G):
        hp[a] = 0.0
        for c in range(_G):
            hp[a] += p[a, c] * h[c]
    for a in range(_G):
        variance += h[a] * hp[a]
    for a in range(_G):
        k[a] = hp[a] / variance
        s[a] += k[a] * nu
    for a in range(_G):
        for c in range(_G):
            p[a, c] -= k[a] * hp[c]
    return variance


@jit
def _propagate_slopes(d: Array, f: Array, decay: float, new: Array) -> None:
    """Time update of the state's sensitivities d (9, 18) to the sensor errors, the first six being the IMU biases.

    new: (6, 18), work.
    """
    for i in range(6):
        for c in range(_P):
            new[i, c] = f[i, 6 + c] if c < 6 else 0.0
        for a in range(6):
            for c in range(_P):
                new[i, c] += f[i, a] * d[a, c]
    for i in range(6):
        for c in range(_P):
            d[i, c] = new[i, c]
    for i in range(_X, _G):
        for c in range(_P):
            d[i, c] *= decay


@jit
def _update_slopes(
    d: Array, j: int, reading: float, nu: float, big: float, h: Array, k: Array, theta: Array, m: Array, g: Array,
    slope: Array,
) -> None:  # fmt: skip
    """Sensitivity of one innovation, its share of information m (18, 18) and gradient g (18,), and d after it.

    The output's value is that of the prediction, which knows nothing of this sample's noise; taking the smoothed one
    would correlate regressor and noise. reading: predicted. The gain's own sensitivity is left out: it is uncorrelated
    with the innovation. slope: (18,), work.
    """
    for c in range(_P):
        slope[c] = 0.0
    for a in range(_G):
        for c in range(_P):
            slope[c] -= h[a] * d[a, c]
    scale, offset = _SCALE[j], _OFFSET[j]
    if scale >= 0:
        slope[scale] -= (reading - theta[offset]) / (1.0 + theta[scale])
    if offset >= 0:
        slope[offset] -= 1.0
    for c in range(_P):
        g[c] -= slope[c] * nu / big
        weight = slope[c] / big
        for a in range(_P):
            m[c, a] += weight * slope[a]
    for a in range(_G):
        for c in range(_P):
            d[a, c] += k[a] * slope[c]


@jit
def _keep(s: Array, p: Array, s_kept: Array, p_kept: Array) -> None:
    """Copy (9,) and (9, 9). Element by element: numba's whole-array copies take seconds more to compile."""
    for a in range(_G):
        s_kept[a] = s[a]
        for c in range(_G):
            p_kept[a, c] = p[a, c]


@jit_arrays
def filter_part(
    nominal: Array, gusts: Array, theta: Array, predicted: Array, slopes: Array, ahead: Array, steps: Array, z: Array,
    noise: Array, q_imu: Array, gust: Array, p_start: Array, store: bool, slopes_wanted: bool,
) -> tuple[float, Array, Array, Array, Array, Array, Array, Array]:  # fmt: skip
    """Forward pass over one part of a flight.

    nominal: (N, 6) and gusts: (N, 3) trajectory about which theta, (18,) sensor errors, have been linearised into the
    next four (see `sysid.compatibility.ekf_jacobians`). z: (N, 9), NaN missing. noise: (9,) variances of the outputs.
    q_imu: (6,) variances of the IMU samples. gust: (2,) standard deviation m/s and decay per step. p_start: (9, 9)
    covariance of the first state about the nominal one, of the first gust about zero.
    Returns log likelihood; information (18, 18) and gradient (18,) of the sensor errors if `slopes_wanted`, else
    zeros; innovations (N, 9), their variances (N, 9); and if `store` what `smooth_part` needs: s (N, 9),
    P (N, 9, 9), K (N, 9, 9).
    """
    n = nominal.shape[0]
    m = n if store else 1
    s_before, p_before, gains = np.zeros((m, _G)), np.zeros((m, _G, _G)), np.zeros((m, _M, _G))
    innovation, variance = np.full((n, _M), np.nan), np.full((n, _M), np.nan)
    s, p = np.zeros(_G), p_start.copy()
    k, hp, new, slope, turned = np.empty(_G), np.empty(_G), np.empty(6), np.empty(_P), np.empty((6, _P))
    d, information, gradient = np.zeros((_G, _P)), np.zeros((_P, _P)), np.zeros(_P)
    likelihood = 0.0
    for a in range(3):
        s[6 + a] = -gusts[0, a]
    for i in range(n):
        if store:
            _keep(s, p, s_before[i], p_before[i])
        for j in range(_M):
            if np.isnan(z[i, j]):
                continue
            h = slopes[i, j]
            nu = z[i, j] - predicted[i, j]
            for a in range(_G):
                nu -= h[a] * s[a]
            big = _update(s, p, h, nu, noise[j], k, hp)
            if slopes_wanted:
                _update_slopes(d, j, z[i, j] - nu, nu, big, h, k, theta, information, gradient, slope)
            innovation[i, j], variance[i, j] = nu, big
            likelihood -= 0.5 * (nu * nu / big + log(big))
            if store:
                for a in range(_G):
                    gains[i, j, a] = k[a]
        if i + 1 < n:
            if slopes_wanted:
                _propagate_slopes(d, steps[i], gust[1], turned)
            _propagate(s, p, steps[i], gust[1], q_imu, gust[0] ** 2 * (1.0 - gust[1] ** 2), new)
            for a in range(6):
                s[a] += ahead[i, a] - nominal[i + 1, a]
            for a in range(3):
                s[6 + a] += gust[1] * gusts[i, a] - gusts[i + 1, a]
    return likelihood, information, gradient, innovation, variance, s_before, p_before, gains


@jit_arrays
def smooth_part(
    innovation: Array,
    variance: Array,
    s_before: Array,
    p_before: Array,
    gains: Array,
    slopes: Array,
    steps: Array,
    decay: float,
) -> Array:
    """Backward pass: smoothed deviations (N, 9) of states and gusts.

    First five arguments: the last five that filter_part returns. slopes, steps: H and F of `linearise_part`. decay: of
    the gust per step.
    """
    n = innovation.shape[0]
    smoothed = np.empty((n, _G))
    adjoint, old = np.zeros(_G), np.empty(6)
    for i in range(n - 1, -1, -1):
        for j in range(_M - 1, -1, -1):
            if np.isnan(innovation[i, j]):
                continue
            total = innovation[i, j] / variance[i, j]
            for a in range(_G):
                total += gains[i, j, a] * adjoint[a]
            for a in range(_G):
                adjoint[a] -= slopes[i, j, a] * total
        for a in range(_G):
            total = s_before[i, a]
            for c in range(_G):
                total -= p_before[i, a, c] * adjoint[c]
            smoothed[i, a] = total
        if i > 0:
            for a in range(6):
                old[a] = adjoint[a]
            for a in range(6):
                adjoint[a] = 0.0
                for c in range(6):
                    adjoint[a] += steps[i - 1, c, a] * old[c]
            for a in range(_X, _G):
                adjoint[a] *= decay
    return smoothed
