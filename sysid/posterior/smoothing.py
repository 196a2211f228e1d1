"""Signals on their own stamps, smoothed onto an even grid; airspeed with what the accelerometers say of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.optimize import minimize_scalar

from sim_vehicle.jit import jit, jit_arrays
from sysid.arrays import Array

# Lags of a pitot and its tubes between which the likeliest is sought, s; to what it is sought, first with the gusts
# that go with one of these, then with those that go with what was found; by what change the likelihood's bend is read.
_LAGS_S = (0.0, 0.05, 0.12, 0.25, 0.40)
_ROUGH_S, _FINE_S, _BEND_S = 0.01, 0.002, 0.01
# What is known of a lag at best, s: in calm air, and where gusts, which are no random walk, stand in the reading.
_LEAST_LAG_STD_S, _LEAST_IN_GUSTS_S, _GUSTY = 0.004, 0.015, 0.05
# Longitudinal gusts: power of the change of airspeed that no accelerometer feels, m^2/s^3.
_GUST_POWERS = (1e-4, 1e-2, 0.1, 0.4, 2.0)
# Width of the bands in which noise is distinguished from a signal, Hz and share of their frequency, by how many
# standard errors of the noise's power a signal must stand out; samples below which it is not.
_BAND_HZ, _BAND_SHARE, _CHANCE, _FEWEST = 0.2, 0.3, 5.0, 20
# Rate, Hz, below which the fast part of a band holds manoeuvres, and their noise is not found beside them; and samples
# closer than this share of the usual interval are one: a curve through both would swing for their noise.
_SLOWEST_HZ, _AT_ONCE = 6.0, 0.3
# Half width of the narrowest window that smooths, in samples.
HALF_SAMPLES = 2.6
# Natural logarithms of what wanders over the noise, in power at the end of the band, between which the likeliest is
# sought; how often white noise is summed to what wanders: in gusts once, behind a vane that swings up to three times.
_LOG_RATIOS, _SUMMED = (math.log(1e-6), math.log(1e6)), (1, 2, 3)
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


def expected(time_s: Array, values: Array, grid: Array) -> Array:
    """(N,) what noisy samples stand for, on a grid: a cubic spline through them, then Wiener's filter for their noise.

    A regressor with noise in it makes every derivative by it too small; by its expected value they are not (Berkson,
    J. Am. Stat. Assoc. 45, 1950). Smoothed by more than that it lacks what moved the aircraft, and clocks and lags of
    its sensor are found that make up for it. The noise is taken as white, as large as `noise_beside_walk` says.
    """
    if not np.ptp(values):
        return np.full(grid.size, values[0])
    time_s, values = _one_at_a_time(time_s, values)
    if values.size < _FEWEST or float(np.median(np.diff(time_s))) > 1.0 / _SLOWEST_HZ:
        return smoothed(time_s, values, grid, HALF_SAMPLES * float(np.median(np.diff(time_s))))
    sigma = noise_beside_walk(values)
    joined = _through(time_s, values, grid)
    passed = _through(time_s, np.random.default_rng(0).standard_normal(values.size), grid)
    middle, step = float(joined.mean()), float(grid[1] - grid[0])
    Z, of_noise = (_there_and_back(one) for one in (joined - middle, sigma * passed))
    # Of all of the series at once: windows would weigh what is at its ends less.
    power, noise = (np.abs(one) ** 2 for one in (Z, of_noise))
    low, high = _bands(power.size, 2.0 * step * grid.size)
    power, noise = (np.diff(np.cumsum(np.append(0.0, one))[np.stack((low, high))], axis=0)[0] for one in (power, noise))
    power = np.maximum(power, 1e-12 * power.max())
    # Of noise alone half of the bands hold more than is expected: what does not stand out of that is taken as none.
    seen = power > noise * (1.0 + _CHANCE * np.sqrt(2.0 / (high - low)))
    gain = np.where(seen, np.clip(1.0 - noise / power, 0.0, 1.0), 0.0)
    return np.asarray(middle + np.fft.irfft(Z * gain, 2 * grid.size)[: grid.size])


def _one_at_a_time(time_s: Array, values: Array) -> tuple[Array, Array]:
    """Stamps and values, (M,) each, those that come together as their mean: a bus hands samples on in bursts."""
    # In bursts most intervals are short: the longer ones say how often there is anything new.
    usual = float(np.percentile(np.diff(time_s), 90.0))
    if not np.any(np.diff(time_s) < _AT_ONCE * usual):
        return time_s, values
    starts = [0]
    while (after := int(np.searchsorted(time_s, time_s[starts[-1]] + _AT_ONCE * usual, side="right"))) < time_s.size:
        starts.append(after)
    counts = np.diff(np.append(starts, time_s.size))
    return np.add.reduceat(time_s, starts) / counts, np.add.reduceat(values, starts) / counts


def _bands(size: int, bins_per_hz: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and one past the last bin, (M,) each, of a band about every frequency of a spectrum, wider where it is
    higher.
    """
    at = np.arange(size)
    half = 0.5 * (_BAND_HZ * bins_per_hz + _BAND_SHARE * at)
    low, high = np.maximum(at - half, 0.0), np.minimum(at + half, size - 1.0) + 1.0
    return low.astype(np.int64), high.astype(np.int64)


def _through(time_s: Array, values: Array, grid: Array) -> Array:
    """(N,) a cubic spline through samples; where some were lost, about the straight line between those beside it."""
    step = float(np.median(np.diff(time_s)))
    lost = [
        np.arange(time_s[i] + step, time_s[i + 1] - 0.5 * step, step)
        for i in np.flatnonzero(np.diff(time_s) > 2.5 * step)
    ]
    stamps = np.sort(np.concatenate((time_s, *lost)))
    spline = make_interp_spline(stamps, np.interp(stamps, time_s, values), k=3)
    return np.asarray(spline(np.clip(grid, stamps[0], stamps[-1])))


def noise_beside_walk(values: Array) -> float:
    """Standard deviation of the white noise in samples of what wanders, as an angle of flow does in gusts.

    The likeliest of a constant spectrum and a random walk's, summed once or several times, together (Whittle, Ark. Mat.
    2, 1953), above the quarter of the band in which manoeuvres are. Differences would count the walk's own steps as
    noise.
    """
    power = np.abs(_there_and_back(values - values.mean())[1:]) ** 2 / (2.0 * values.size)
    angle = 0.5 * np.pi * np.arange(1, power.size + 1) / power.size
    fast = angle > 0.125 * np.pi
    power, step = power[fast], np.sin(angle[fast]) ** -2.0
    if not power.any():
        return 0.0

    def cost(log_ratio: float, shape: Array) -> float:
        whole = math.exp(log_ratio) * shape + 1.0
        return float(math.log(np.mean(power / whole)) + np.mean(np.log(whole)))

    found = [
        (minimize_scalar(cost, bounds=_LOG_RATIOS, method="bounded", args=(step**times,)), step**times)
        for times in _SUMMED
    ]
    best, shape = min(found, key=lambda one: float(one[0].fun))
    return math.sqrt(float(np.mean(power / (math.exp(float(best.x)) * shape + 1.0))))


def _there_and_back(values: Array) -> NDArray[np.complex128]:
    """Fourier transform of a series (N,) followed by itself backwards: no jump where the end meets the start."""
    return np.asarray(np.fft.rfft(np.concatenate((values, values[::-1]))))


@dataclass(frozen=True)
class Airspeed:
    """Airspeed through a part. values: (N,) m/s at the likeliest lag; by_lag: (N,) its change by the lag, m/s per s.

    lag, lag_std: of the pitot, s, by what the accelerometers say.
    """

    values: Array
    by_lag: Array
    lag: float
    lag_std: float


def _lowest(cost: Callable[[float], float], low: float, high: float, within: float) -> float:
    """Where between two lags a cost is lowest, to `within`, s."""
    found = minimize_scalar(
        lambda lag: cost(float(lag)), bounds=(low, high), method="bounded", options={"xatol": within}
    )
    return float(found.x)


def airspeed_alone(time_s: Array, read: Array, grid: Array, half: float, lag_prior: tuple[float, float]) -> Airspeed:
    """Airspeed from its reading alone, where an accelerometer that feels the flight path's acceleration is missing.

    As `airspeed_through`; half: half width of the window that smooths, s. The lag stays as known before.
    """
    values = smoothed(time_s, read, grid, half)
    rate, (lag, std) = np.gradient(values, grid), lag_prior
    return Airspeed(values + lag * rate, rate, lag, std)


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

    def likeliest_power(lag: float) -> float:
        return max(_GUST_POWERS, key=lambda power: run(lag, power)[1])

    mean_s, prior_std = lag_prior

    def cost(lag: float, power: float) -> float:
        return 0.5 * ((lag - mean_s) / prior_std) ** 2 - run(lag, power)[1]

    lag, std = max(mean_s, 0.0), 0.0
    if prior_std > 0.0:
        # Together: at a wrong lag gusts seem strong, and where gusts are strong no lag is identifiable.
        lag = min(_LAGS_S, key=lambda one: cost(one, likeliest_power(one)))
        place = _LAGS_S.index(lag)
        low, high = _LAGS_S[max(place - 1, 0)], _LAGS_S[min(place + 1, len(_LAGS_S) - 1)]
        for within in (_ROUGH_S, _FINE_S):
            lag = _lowest(partial(cost, power=likeliest_power(lag)), low, high, within)
            low, high = max(low, lag - 3.0 * _ROUGH_S), min(high, lag + 3.0 * _ROUGH_S)
    power = likeliest_power(lag)
    if prior_std > 0.0:
        middle = max(lag, _BEND_S)
        bend = sum(cost(middle + side * _BEND_S, power) for side in (-1.0, 1.0)) - 2.0 * cost(middle, power)
        spread = _BEND_S / np.sqrt(max(bend, 1e-6))
        std = min(max(spread, _LEAST_IN_GUSTS_S if power > _GUSTY else _LEAST_LAG_STD_S), prior_std)
    step = 0.01
    values, later = run(lag, power, True)[0], run(lag + step, power, True)[0]
    return Airspeed(values, (later - values) / step, lag, std)


@jit
def _fill(P: Array, p00: float, p01: float, p02: float, p11: float, p12: float, p22: float) -> None:
    P[0, 0], P[0, 1], P[0, 2] = p00, p01, p02
    P[1, 0], P[1, 1], P[1, 2] = p01, p11, p12
    P[2, 0], P[2, 1], P[2, 2] = p02, p12, p22


@jit_arrays
def _air_smoother(
    dt: float, count: Array, mean: Array, along: Array, lag: float, power: float, wander: float, noise: float,
    start: float, smooth: bool,
) -> tuple[Array, float]:  # fmt: skip
    """Rauch, Tung and Striebel's smoother of airspeed, its lagging reading and a bias of `along`; log likelihood.

    smooth: whether to go back through time too; the likelihood does not need it.
    """
    n = along.size
    # The reading behind its lag is exact for an airspeed that goes in straight lines: its end counts by `late`.
    decay = np.exp(-dt / lag)
    late = 1.0 - (1.0 - decay) * lag / dt
    a, c = 1.0 - decay, late * dt
    F = np.array([[1.0, 0.0, dt], [a, decay, c], [0.0, 0.0, 1.0]])
    kept = n if smooth else 0
    xs, Ps, xp, Pp = np.empty((kept, 3)), np.empty((kept, 3, 3)), np.empty((kept, 3)), np.empty((kept, 3, 3))
    x0, x1, x2, likelihood = start, start, 0.0, 0.0
    # Upper triangle of the covariance.
    p00, p01, p02, p11, p12, p22 = 1.0, 0.0, 0.0, 1.0, 0.0, 0.09
    for i in range(n):
        if i > 0:
            gain_m_s = 0.5 * dt * (along[i] + along[i - 1])
            x0, x1 = x0 + dt * x2 + gain_m_s, a * x0 + decay * x1 + c * x2 + late * gain_m_s
            r00, r01, r02 = p00 + dt * p02, p01 + dt * p12, p02 + dt * p22
            r10, r11 = a * p00 + decay * p01 + c * p02, a * p01 + decay * p11 + c * p12
            r12 = a * p02 + decay * p12 + c * p22
            p00 = r00 + dt * r02 + power * dt
            p01 = a * r00 + decay * r01 + c * r02 + late * power * dt
            p11 = a * r10 + decay * r11 + c * r12 + late * late * power * dt + 1e-9
            p02, p12, p22 = r02, r12, p22 + wander * dt
        if smooth:
            xp[i, 0], xp[i, 1], xp[i, 2] = x0, x1, x2
            _fill(Pp[i], p00, p01, p02, p11, p12, p22)
        if count[i] > 0.0:
            variance, innovation = p11 + noise / count[i], mean[i] - x1
            k0, k1, k2 = p01 / variance, p11 / variance, p12 / variance
            x0, x1, x2 = x0 + k0 * innovation, x1 + k1 * innovation, x2 + k2 * innovation
            p00, p02, p22 = p00 - k0 * p01, p02 - k0 * p12, p22 - k2 * p12
            p01, p12, p11 = p01 - k0 * p11, p12 - k1 * p12, p11 - k1 * p11
            likelihood -= 0.5 * (np.log(variance) + innovation * innovation / variance)
        if smooth:
            xs[i, 0], xs[i, 1], xs[i, 2] = x0, x1, x2
            _fill(Ps[i], p00, p01, p02, p11, p12, p22)
    for i in range(n - 2 if smooth else -1, -1, -1):
        C = Ps[i] @ F.T @ np.linalg.inv(Pp[i + 1])
        xs[i] = xs[i] + C @ (xs[i + 1] - xp[i + 1])
    return xs[:, 0].copy(), likelihood
