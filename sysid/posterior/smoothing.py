"""Signals on their own stamps, smoothed onto an even grid; airspeed with what the accelerometers say of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from sim_vehicle.jit import jit_arrays
from sysid.arrays import Array

# Lags of a pitot and its tubes that are tried, s, and steps at which a smooth curve through their likelihood is read.
_LAGS_S = (0.0, 0.02, 0.05, 0.10, 0.15, 0.20, 0.30)
_LAG_STEP_S = 0.002
# What is known of a lag at best, s: in calm air, and where gusts, which are no random walk, stand in the reading.
_LEAST_LAG_STD_S, _LEAST_IN_GUSTS_S, _GUSTY = 0.004, 0.015, 0.05
# Longitudinal gusts: power of the change of airspeed that no accelerometer feels, m^2/s^3.
_GUST_POWERS = (1e-4, 1e-2, 0.1, 0.4, 2.0)
# How the accelerometers' bias wanders, m/s^2 per root s, and the largest noise of the reading, m/s.
_BIAS_WALK, _LEAST_NOISE = 0.05, 0.01


@jit_arrays
def smoothed(time_s: Array, values: Array, grid: Array, half: float) -> Array:
    """(N,) values on a grid by local quadratics with tricube weights (Cleveland 1979) over +-half s.

    Where a window holds fewer than five samples, the straight line between the neighbours.
    """
    n, begin = time_s.size, 0
    out = np.empty(grid.size)
    for i in range(grid.size):
        at = grid[i]
        while begin < n and time_s[begin] < at - half:
            begin += 1
        s0 = s1 = s2 = s3 = s4 = b0 = b1 = b2 = 0.0
        j, count = begin, 0
        while j < n and time_s[j] <= at + half:
            x = (time_s[j] - at) / half
            w = 1.0 - abs(x) ** 3
            w = w * w * w
            s0, s1, s2, s3, s4 = s0 + w, s1 + w * x, s2 + w * x * x, s3 + w * x**3, s4 + w * x**4
            b0, b1, b2 = b0 + w * values[j], b1 + w * x * values[j], b2 + w * x * x * values[j]
            j, count = j + 1, count + 1
        determinant = s0 * (s2 * s4 - s3 * s3) - s1 * (s1 * s4 - s2 * s3) + s2 * (s1 * s3 - s2 * s2)
        if count >= 5 and determinant > 1e-9:
            top = b0 * (s2 * s4 - s3 * s3) - s1 * (b1 * s4 - s3 * b2) + s2 * (b1 * s3 - s2 * b2)
            out[i] = top / determinant
        else:
            last = min(max(j, 1), n - 1)
            while last > 1 and time_s[last - 1] > at:
                last -= 1
            t0, t1 = time_s[last - 1], time_s[last]
            share = min(max((at - t0) / (t1 - t0), 0.0), 1.0) if t1 > t0 else 0.0
            out[i] = values[last - 1] + share * (values[last] - values[last - 1])
    return out


@dataclass(frozen=True)
class Airspeed:
    """Airspeed through a part. values: (N,) m/s at the likeliest lag; by_lag: (N,) its change by the lag, m/s per s.

    lag, lag_std: of the pitot, s, by what the accelerometers say.
    """

    values: Array
    by_lag: Array
    lag: float
    lag_std: float


def airspeed_through(time_s: Array, read: Array, grid: Array, along: Array, lag_prior: tuple[float, float]) -> Airspeed:
    """Airspeed from a lagging, noisy reading and the acceleration along the flight path that the IMU feels.

    time_s, read: (M,) stamps and true airspeed as read. along: (N,) m/s^2 on the grid, gravity's part taken off.
    lag_prior: mean and standard deviation of the lag, s.
    """
    dt = float(grid[1] - grid[0])
    place = np.clip(np.round((time_s - grid[0]) / dt).astype(np.int64), 0, grid.size - 1)
    count, total = np.zeros(grid.size), np.zeros(grid.size)
    np.add.at(count, place, 1.0)
    np.add.at(total, place, read)
    mean = np.divide(total, count, out=np.zeros(grid.size), where=count > 0.0)
    rough = np.diff(read, 2) / np.sqrt(6.0)
    noise = max(float(np.std(rough)) if rough.size else 0.1, _LEAST_NOISE) ** 2
    start = float(np.median(read[:10]))

    @cache
    def run(lag: float, power: float, smooth: bool = False) -> tuple[Array, float]:
        return _air_smoother(dt, count, mean, along, max(lag, 1e-3), power, _BIAS_WALK**2, noise, start, smooth)

    # Together: at a wrong lag gusts seem strong, and where gusts are strong no lag can be told.
    lags = _LAGS_S if lag_prior[1] > 0.0 else (max(lag_prior[0], 0.0),)
    powers = [max(_GUST_POWERS, key=lambda power: run(lag, power)[1]) for lag in lags]
    if lag_prior[1] == 0.0:
        lag, std = lags[0], 0.0
    else:
        fine = np.arange(0.0, _LAGS_S[-1], _LAG_STEP_S)
        score = CubicSpline(lags, [run(*one)[1] for one in zip(lags, powers, strict=True)])(fine)
        score -= 0.5 * ((fine - lag_prior[0]) / lag_prior[1]) ** 2
        weight = np.exp(np.clip(score - score.max(), -50.0, 0.0))
        lag = float(weight @ fine / weight.sum())
        spread = float(np.sqrt(weight @ (fine - lag) ** 2 / weight.sum()))
    power = powers[int(np.argmin(np.abs(np.array(lags) - lag)))]
    if lag_prior[1] > 0.0:
        std = min(max(spread, _LEAST_IN_GUSTS_S if power > _GUSTY else _LEAST_LAG_STD_S), lag_prior[1])
    step = 0.01
    values, later = run(lag, power, True)[0], run(lag + step, power, True)[0]
    return Airspeed(values, (later - values) / step, lag, std)


@jit_arrays
def _air_smoother(
    dt: float, count: Array, mean: Array, along: Array, lag: float, power: float, wander: float, noise: float,
    start: float, smooth: bool,
) -> tuple[Array, float]:  # fmt: skip
    """Rauch, Tung and Striebel's smoother of airspeed, its lagging reading and a bias of `along`; log likelihood.

    smooth: whether to go back through time too; the likelihood does not need it.
    """
    n = along.size
    x, P = np.array([start, start, 0.0]), np.diag(np.array([1.0, 1.0, 0.09]))
    decay = np.exp(-dt / lag)
    F = np.eye(3)
    F[0, 2], F[1, 0], F[1, 1] = dt, 1.0 - decay, decay
    Q = np.diag(np.array([power * dt, 1e-9, wander * dt]))
    xs, Ps, xp, Pp = np.empty((n, 3)), np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3, 3))
    likelihood = 0.0
    for i in range(n):
        if i > 0:
            x = F @ x
            x[0] += 0.5 * dt * (along[i] + along[i - 1])
            P = F @ P @ F.T + Q
        xp[i], Pp[i] = x, P
        if count[i] > 0.0:
            variance = P[1, 1] + noise / count[i]
            gain, innovation = P[:, 1] / variance, mean[i] - x[1]
            x = x + gain * innovation
            P = P - np.outer(gain, P[1, :])
            likelihood -= 0.5 * (np.log(variance) + innovation * innovation / variance)
        xs[i], Ps[i] = x, P
    for i in range(n - 2 if smooth else -1, -1, -1):
        C = Ps[i] @ F.T @ np.linalg.inv(Pp[i + 1])
        xs[i] = xs[i] + C @ (xs[i + 1] - xp[i + 1])
    return xs[:, 0].copy(), likelihood
