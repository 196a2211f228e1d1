"""The steps of the live air filter, compiled: one pass over all rows that have come.

Every measurement has noise of its own, so those of one row are taken one by one, which is the joint correction: each
innovation counts what the earlier ones of the row have already moved (Kalman filters of uncorrelated measurements;
D. Simon, "Optimal State Estimation", 2006, section 6.1).
"""

from __future__ import annotations

import numpy as np

from sim_vehicle.jit import jit_arrays
from sysid.flight import Array

# Columns of a row. Those behind V and alpha are NaN where they are not known.
ROW = ("ax", "ay", "az", "p", "q", "r", "phi", "theta", "psi", "V", "alpha", "beta", "vn", "ve", "vd")
_V, _ALPHA, _BETA, _GROUND = 9, 10, 11, 12
_DRIVING = 8  # ax to theta
# States: u v w, biases of the accelerometer, wind, scale of airspeed, bias and scale of each vane.
_BIAS, _WIND, _SPEED_SCALE, _ALPHA_BIAS, _ALPHA_SCALE, _BETA_BIAS, _BETA_SCALE, _STATES = 3, 6, 9, 10, 11, 12, 13, 14
_WIND_DRIFT = 0.05  # m/s in a second
_AIR_DRIFT = 0.02  # m/s in a second, of the air that the aircraft flies through, and the accelerometer's noise
ATTITUDE_NOISE = 0.001
_GPS_NOISE = 0.15
_SPEED_NOISE = 0.05
_NIS_MEMORY = 250.0  # rows


@jit_arrays
def correct(h: Array, innovation: float, variance: float, x: Array, P: Array) -> float:
    """Take one measurement of slope h (n,) into x (n,) and P (n, n); the innovation's square over its variance."""
    n = x.size
    Ph = np.zeros(n)
    for i in range(n):
        for j in range(n):
            Ph[i] += P[i, j] * h[j]
    spread = variance
    for i in range(n):
        spread += h[i] * Ph[i]
    for i in range(n):
        x[i] += Ph[i] * innovation / spread
        for j in range(n):
            P[i, j] -= Ph[i] * Ph[j] / spread
    return innovation * innovation / spread


@jit_arrays
def _turn(middle: Array, row: Array, dt: float, turned: Array, P: Array) -> None:
    """Attitude and gyro biases, turned (6,), by the gyros, then corrected by the measured attitude."""
    phi, theta = middle[6], middle[7]
    sin, cos, tan, sec = np.sin(phi), np.cos(phi), np.tan(theta), 1.0 / max(np.cos(theta), 0.1)
    turning = np.array([[1.0, sin * tan, cos * tan], [0.0, cos, -sin], [0.0, sin * sec, cos * sec]])
    half = P.copy()
    for i in range(3):
        for k in range(3):
            turned[i] += dt * turning[i, k] * (middle[3 + k] - turned[3 + k])
            for j in range(6):
                half[i, j] -= dt * turning[i, k] * P[3 + k, j]
    P[:, :] = half
    for i in range(3):
        for k in range(3):
            for j in range(6):
                P[j, i] -= dt * turning[i, k] * half[j, 3 + k]
        P[i, i] += (0.001 * dt) ** 2
    moved = np.zeros(6)
    h = np.zeros(6)
    for i in range(3):
        error = (row[6 + i] - turned[i] + np.pi) % (2.0 * np.pi) - np.pi
        h[:] = 0.0
        h[i] = 1.0
        correct(h, error - moved[i], ATTITUDE_NOISE**2, moved, P)
    for i in range(6):
        turned[i] += moved[i]


@jit_arrays
def _advance(middle: Array, dt: float, gravity: float, gyro_bias: Array, nis: float, x: Array, P: Array) -> None:
    """Velocity through the air over one interval, by the midpoint rule."""
    p, q, r = middle[3] - gyro_bias[0], middle[4] - gyro_bias[1], middle[5] - gyro_bias[2]
    phi, theta = middle[6], middle[7]
    ax = middle[0] - x[_BIAS] - gravity * np.sin(theta)
    ay = middle[1] - x[_BIAS + 1] + gravity * np.cos(theta) * np.sin(phi)
    az = middle[2] - x[_BIAS + 2] + gravity * np.cos(theta) * np.cos(phi)
    u, v, w = x[0], x[1], x[2]
    hu = u + 0.5 * dt * (r * v - q * w + ax)
    hv = v + 0.5 * dt * (p * w - r * u + ay)
    hw = w + 0.5 * dt * (q * u - p * v + az)
    x[0] += dt * (r * hv - q * hw + ax)
    x[1] += dt * (p * hw - r * hu + ay)
    x[2] += dt * (q * hu - p * hv + az)
    spin = np.array([[0.0, r, -q], [-r, 0.0, p], [q, -p, 0.0]])
    half = P.copy()
    for i in range(3):
        for j in range(_STATES):
            half[i, j] -= dt * P[_BIAS + i, j]
            for k in range(3):
                half[i, j] += dt * spin[i, k] * P[k, j]
    P[:, :] = half
    for i in range(3):
        for j in range(_STATES):
            P[j, i] -= dt * half[j, _BIAS + i]
            for k in range(3):
                P[j, i] += dt * spin[i, k] * half[j, k]
    # Gusts move the air itself: the innovations tell how much more than a calm day.
    drift = _AIR_DRIFT**2 * dt * max(nis / 3.0, 1.0)
    for i in range(3):
        P[i, i] += drift
        P[_WIND + i, _WIND + i] += _WIND_DRIFT**2 * dt


@jit_arrays
def _take_air(row: Array, vane_noise: Array, x: Array, P: Array) -> float:
    """Airspeed and vanes; the mean square of their innovations, three times that of one."""
    u, v, w = x[0], x[1], x[2]
    flat = max(u * u + w * w, 1e-6)
    speed = max(np.sqrt(u * u + v * v + w * w), 1e-3)
    alpha, beta = np.arctan2(w, u), np.arcsin(min(max(v / speed, -1.0), 1.0))
    slope = (1.0 + x[_BETA_SCALE]) * np.sqrt(flat) / speed**2
    H = np.zeros((3, _STATES))
    by_speed, by_alpha = (1.0 + x[_SPEED_SCALE]) / speed, (1.0 + x[_ALPHA_SCALE]) / flat
    H[0, 0], H[0, 1], H[0, 2], H[0, _SPEED_SCALE] = by_speed * u, by_speed * v, by_speed * w, speed
    H[1, 0], H[1, 2], H[1, _ALPHA_BIAS], H[1, _ALPHA_SCALE] = -by_alpha * w, by_alpha * u, 1.0, alpha
    H[2, 0], H[2, 1], H[2, 2] = -slope * u * v / flat, slope, -slope * w * v / flat
    H[2, _BETA_BIAS], H[2, _BETA_SCALE] = 1.0, beta
    innovation = np.array(
        [
            row[_V] - (1.0 + x[_SPEED_SCALE]) * speed,
            row[_ALPHA] - (1.0 + x[_ALPHA_SCALE]) * alpha - x[_ALPHA_BIAS],
            row[_BETA] - (1.0 + x[_BETA_SCALE]) * beta - x[_BETA_BIAS],
        ]
    )
    noise = np.array([_SPEED_NOISE**2, vane_noise[0], vane_noise[1]])
    size = 2 if np.isnan(row[_BETA]) else 3
    return min(_correct_all(H, innovation, noise, size, x, P), 100.0) * 3.0 / size


@jit_arrays
def _correct_all(H: Array, innovation: Array, noise: Array, size: int, x: Array, P: Array) -> float:
    """The first `size` measurements, of which those that are NaN are left out; the sum of what `correct` gives."""
    moved = np.zeros(x.size)
    total = 0.0
    for i in range(size):
        if not np.isnan(innovation[i]):
            rest = innovation[i]
            for j in range(x.size):
                rest -= H[i, j] * moved[j]
            total += correct(H[i], rest, noise[i], moved, P)
    for j in range(x.size):
        x[j] += moved[j]
    return total


@jit_arrays
def _take_ground(row: Array, x: Array, P: Array) -> None:
    """Ground velocity: that through the air, turned to the earth's axes, and the wind."""
    sp, cp, st, ct = np.sin(row[6]), np.cos(row[6]), np.sin(row[7]), np.cos(row[7])
    ss, cs = np.sin(row[8]), np.cos(row[8])
    C = np.array(
        [
            [ct * cs, sp * st * cs - cp * ss, cp * st * cs + sp * ss],
            [ct * ss, sp * st * ss + cp * cs, cp * st * ss - sp * cs],
            [-st, sp * ct, cp * ct],
        ]
    )
    H = np.zeros((3, _STATES))
    innovation = np.zeros(3)
    for i in range(3):
        innovation[i] = row[_GROUND + i] - x[_WIND + i]
        H[i, _WIND + i] = 1.0
        for k in range(3):
            H[i, k] = C[i, k]
            innovation[i] -= C[i, k] * x[k]
    _correct_all(H, innovation, np.full(3, _GPS_NOISE**2), 3, x, P)


@jit_arrays
def take_rows(
    rows: Array,
    before: int,
    dt: float,
    gravity: float,
    vane_noise: Array,
    turned: Array,
    turned_P: Array,
    x: Array,
    P: Array,
    nis: float,
) -> float:
    """Take rows (N, 15), columns of `ROW`, of which the first `before` (1 or 2) were taken earlier.

    vane_noise: (2,) variances of alpha and beta, rad^2. turned (6,), turned_P: attitude and gyro biases, and their
    covariance. x (14,), P: the states and theirs. nis: running mean of the innovations' squares, whose new value is
    given back. The arrays are changed.
    """
    middle = np.zeros(_DRIVING)
    for k in range(before, rows.shape[0]):
        # The mean over the interval by the parabola through three samples: a straight line loses (w T)^2 / 12 of an
        # oscillation, 0.4 % of a short period of 1.7 Hz, which looks like a scale of the vane.
        for i in range(_DRIVING):
            if k > 1:
                middle[i] = (5.0 * rows[k, i] + 8.0 * rows[k - 1, i] - rows[k - 2, i]) / 12.0
            else:
                middle[i] = 0.5 * (rows[k, i] + rows[k - 1, i])
        _turn(middle, rows[k], dt, turned, turned_P)
        _advance(middle, dt, gravity, turned[3:], nis, x, P)
        found = _take_air(rows[k], vane_noise, x, P)
        nis += (found - nis) / _NIS_MEMORY
        _take_ground(rows[k], x, P)
    # Rounding takes the symmetry away little by little.
    P[:, :] = 0.5 * (P + P.T)
    return nis
