"""The steps of the live air filter, compiled: one pass over all rows that have come.

How gusty the air is, is not known, and a filter that believes it calmer than it is takes gusts for sensor errors. So
several filters run side by side, each with its own intensity of the gusts, and are mixed by how well each predicts
the measurements, with a small chance at every row that the intensity has changed (the interacting multiple model).
Every measurement has noise of its own, so those of one row are taken one by one, which is the joint correction: each
innovation counts what the earlier ones of the row have already moved.
Sources: H. A. P. Blom & Y. Bar-Shalom, IEEE Transactions on Automatic Control 33(8), 1988 (mixing); D. Simon, "Optimal
State Estimation", 2006, section 6.1 (uncorrelated measurements one by one).
"""

from __future__ import annotations

import numpy as np

from sim_vehicle.jit import jit_arrays
from sysid.arrays import Array

# Columns of a row. Those behind V and alpha are NaN where they are not known.
ROW = ("ax", "ay", "az", "p", "q", "r", "phi", "theta", "psi", "V", "alpha", "beta", "vn", "ve", "vd")
_V, _ALPHA, _BETA, _GROUND = 9, 10, 11, 12  # places of these outputs
_DRIVING = 8  # ax to theta
# States: u v w through the air but for gusts, biases of the accelerometer, wind, scale of airspeed, bias and scale of
# each vane, gusts along the body's axes.
_BIAS, _WIND, _SPEED_SCALE, _ALPHA_BIAS, _ALPHA_SCALE, _BETA_BIAS, _BETA_SCALE, GUST = 3, 6, 9, 10, 11, 12, 13, 14
SIZE = 17
_STEPS = tuple(0.02 * 1.35**k for k in range(16))
# Of each filter the standard deviation of the gusts, m/s, and the time in which those along the path fade, s.
_FADING = (1.2, 4.5)
INTENSITIES = np.array([0.0, *(intensity for _ in _FADING for intensity in _STEPS)])
FADES_S = np.array([1.0, *(fades for fades in _FADING for _ in _STEPS)])
# Across the path Dryden's spectrum is of second order; a first order with as much at either end of it.
_ACROSS_FADES, _ACROSS_VARIANCE = 1.0 / np.sqrt(3.0), np.sqrt(3.0) / 2.0
_CHANGES_S = 60.0  # mean time in which the intensity changes
_WIND_DRIFT = 0.05  # m/s in a second
LEAST_DRIFT = 0.005  # m/s in the root of a second, of what the accelerometer's white noise does not hold
ATTITUDE_NOISE = 0.001
_GPS_NOISE = 0.15
# The fourth difference, by which a sensor's noise is known, holds so much of what gusts add from row to row: of their
# random walk's variance 20, of white noise 70. What is left is noise of at least a quarter.
_GUSTS_IN_NOISE, _LEAST_NOISE = 20.0 / 70.0, 0.25
# Real gusts follow none of these forms exactly, and errors of the sensors move with the intensity that is believed: so
# many rows count as one for the filters' shares that their spread holds what the forms leave in doubt.
_TEMPER = 0.02
# A glitch says no more than this of the intensity: an innovation of 5 standard deviations.
_LARGEST_SQUARE = 25.0


@jit_arrays
def correct(h: Array, innovation: float, variance: float, x: Array, P: Array) -> float:
    """Take one measurement of slope h (n,) into x (n,) and P (n, n); its log-likelihood but for a constant."""
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
    return float(-0.5 * (min(innovation * innovation / spread, _LARGEST_SQUARE) + np.log(spread)))


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
def _fading(dt: float, intensity: float, fades_s: float) -> tuple[Array, Array]:
    """Of gusts along each axis of the body, (3,) what is kept of them over one interval, and the variance it adds."""
    along, across = np.exp(-dt / fades_s), np.exp(-dt / (fades_s * _ACROSS_FADES))
    kept = np.array([along, across, across])
    return kept, intensity**2 * np.array([1.0, _ACROSS_VARIANCE, _ACROSS_VARIANCE]) * (1.0 - kept**2)


@jit_arrays
def _advance(
    middle: Array, dt: float, gravity: float, gyro_bias: Array, drift: Array, kept: Array, added: Array, x: Array,
    P: Array,
) -> None:  # fmt: skip
    """Velocity over one interval by the midpoint rule, and the gusts'. drift: (3,) m^2/s^3 of the velocity."""
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
        for j in range(SIZE):
            half[i, j] -= dt * P[_BIAS + i, j]
            half[GUST + i, j] *= kept[i]
            for k in range(3):
                half[i, j] += dt * spin[i, k] * P[k, j]
    P[:, :] = half
    for i in range(3):
        for j in range(SIZE):
            P[j, i] -= dt * half[j, _BIAS + i]
            P[j, GUST + i] *= kept[i]
            for k in range(3):
                P[j, i] += dt * spin[i, k] * half[j, k]
    for i in range(3):
        x[GUST + i] *= kept[i]
        P[i, i] += drift[i] * dt
        P[_WIND + i, _WIND + i] += _WIND_DRIFT**2 * dt
        P[GUST + i, GUST + i] += added[i]


@jit_arrays
def _still_noise(noise: Array, dt: float, intensity: float, fades_s: float, speed: float) -> Array:
    """(3,) variances of airspeed, alpha and beta without what gusts of this intensity put into `noise`."""
    walk = _GUSTS_IN_NOISE * 2.0 * intensity**2 / fades_s * dt
    across = walk * _ACROSS_VARIANCE / _ACROSS_FADES / speed**2
    still: Array = np.maximum(noise - np.array([walk, across, across]), _LEAST_NOISE * noise)
    return still


@jit_arrays
def _take_air(row: Array, noise: Array, x: Array, P: Array) -> float:
    """Airspeed and vanes; their log-likelihood."""
    u, v, w = x[0] + x[GUST], x[1] + x[GUST + 1], x[2] + x[GUST + 2]
    flat = max(u * u + w * w, 1e-6)
    speed = max(np.sqrt(u * u + v * v + w * w), 1e-3)
    alpha, beta = np.arctan2(w, u), np.arcsin(min(max(v / speed, -1.0), 1.0))
    slope = (1.0 + x[_BETA_SCALE]) * np.sqrt(flat) / speed**2
    H = np.zeros((3, SIZE))
    by_speed, by_alpha = (1.0 + x[_SPEED_SCALE]) / speed, (1.0 + x[_ALPHA_SCALE]) / flat
    for at in (0, GUST):
        H[0, at], H[0, at + 1], H[0, at + 2] = by_speed * u, by_speed * v, by_speed * w
        H[1, at], H[1, at + 2] = -by_alpha * w, by_alpha * u
        H[2, at], H[2, at + 1], H[2, at + 2] = -slope * u * v / flat, slope, -slope * w * v / flat
    H[0, _SPEED_SCALE] = speed
    H[1, _ALPHA_BIAS], H[1, _ALPHA_SCALE] = 1.0, alpha
    H[2, _BETA_BIAS], H[2, _BETA_SCALE] = 1.0, beta
    innovation = np.array(
        [
            row[_V] - (1.0 + x[_SPEED_SCALE]) * speed,
            row[_ALPHA] - (1.0 + x[_ALPHA_SCALE]) * alpha - x[_ALPHA_BIAS],
            row[_BETA] - (1.0 + x[_BETA_SCALE]) * beta - x[_BETA_BIAS],
        ]
    )
    return _correct_all(H, innovation, noise, 2 if np.isnan(row[_BETA]) else 3, x, P)


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
    """Ground velocity: that through the steady air, turned to the earth's axes, and the wind."""
    sp, cp, st, ct = np.sin(row[6]), np.cos(row[6]), np.sin(row[7]), np.cos(row[7])
    ss, cs = np.sin(row[8]), np.cos(row[8])
    C = np.array(
        [
            [ct * cs, sp * st * cs - cp * ss, cp * st * cs + sp * ss],
            [ct * ss, sp * st * ss + cp * cs, cp * st * ss - sp * cs],
            [-st, sp * ct, cp * ct],
        ]
    )
    H = np.zeros((3, SIZE))
    innovation = np.zeros(3)
    for i in range(3):
        innovation[i] = row[_GROUND + i] - x[_WIND + i]
        H[i, _WIND + i] = 1.0
        for k in range(3):
            H[i, k] = C[i, k]
            innovation[i] -= C[i, k] * x[k]
    _correct_all(H, innovation, np.full(3, _GPS_NOISE**2), 3, x, P)


@jit_arrays
def mixed(share: Array, x: Array, P: Array, to_x: Array, to_P: Array) -> None:
    """Mean (n,) and covariance (n, n) of the filters x (M, n), P (M, n, n), each with its share, into to_x, to_P."""
    models, n = x.shape
    to_x[:] = 0.0
    to_P[:, :] = 0.0
    for m in range(models):
        for i in range(n):
            to_x[i] += share[m] * x[m, i]
    for m in range(models):
        for i in range(n):
            for j in range(n):
                to_P[i, j] += share[m] * (P[m, i, j] + (x[m, i] - to_x[i]) * (x[m, j] - to_x[j]))


@jit_arrays
def _interact(stay: float, shares: Array, x: Array, P: Array) -> None:
    """Begin each filter's row from what all know, for the chance that the gusts have become its own.

    As every other filter's gusts are as likely to be the new ones, each is mixed with the mixture of all.
    """
    models, n = x.shape
    move = (1.0 - stay) / (models - 1)
    two_x, two_P = np.zeros((2, n)), np.zeros((2, n, n))
    mixed(shares, x, P, two_x[1], two_P[1])
    for m in range(models):
        own = (stay - move) * shares[m]
        shares[m] = own + move
        two_x[0], two_P[0] = x[m], P[m]
        mixed(np.array([own, move]) / shares[m], two_x, two_P, x[m], P[m])


@jit_arrays
def take_rows(
    rows: Array,
    before: int,
    dt: float,
    gravity: float,
    noise: Array,
    drift: Array,
    turned: Array,
    turned_P: Array,
    x: Array,
    P: Array,
    shares: Array,
) -> None:
    """Take rows (N, 15), columns of `ROW`, of which the first `before` (1 or 2) were taken earlier.

    noise: (3,) variances of airspeed, (m/s)^2, alpha and beta, rad^2. drift: (3,) m^2/s^3 of the velocity, by the
    accelerometer's white noise. turned (6,), turned_P: attitude and gyro biases, and their covariance. x (M, 17),
    P (M, 17, 17): the states of each filter and their covariance, shares: (M,) the filters' probabilities. The arrays
    are changed.
    """
    middle = np.zeros(_DRIVING)
    log = np.zeros(shares.size)
    stay = np.exp(-dt / _CHANGES_S)
    for k in range(before, rows.shape[0]):
        # The mean over the interval by the parabola through three samples: a straight line loses (w T)^2 / 12 of an
        # oscillation, 0.4 % of a short period of 1.7 Hz, which looks like a scale of the vane.
        for i in range(_DRIVING):
            if k > 1:
                middle[i] = (5.0 * rows[k, i] + 8.0 * rows[k - 1, i] - rows[k - 2, i]) / 12.0
            else:
                middle[i] = 0.5 * (rows[k, i] + rows[k - 1, i])
        _turn(middle, rows[k], dt, turned, turned_P)
        _interact(stay, shares, x, P)
        for m in range(shares.size):
            kept, added = _fading(dt, INTENSITIES[m], FADES_S[m])
            _advance(middle, dt, gravity, turned[3:], drift, kept, added, x[m], P[m])
            still = _still_noise(noise, dt, INTENSITIES[m], FADES_S[m], max(rows[k, _V], 1.0))
            log[m] = np.log(max(shares[m], 1e-300)) + _TEMPER * _take_air(rows[k], still, x[m], P[m])
            _take_ground(rows[k], x[m], P[m])
        shares[:] = np.exp(log - np.max(log))
        shares /= np.sum(shares)
    # Rounding takes the symmetry away little by little.
    for m in range(shares.size):
        P[m] = 0.5 * (P[m] + P[m].T)
