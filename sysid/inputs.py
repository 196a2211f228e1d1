"""Noise taken off measured inputs, which a simulation would otherwise feel as rough air."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft, linalg, optimize, signal

from sysid.flight import Array

# Motor lags tried when measured thrust is explained by the throttle, s.
_LAGS_S = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.5)
# Slow swings whose own noise is carried on: an aircraft's speed averages the quicker ones out.
_DOUBTED_TERMS = 8


@dataclass(frozen=True)
class Denoised:
    """A measured input without its noise.

    values: (N,). doubt: (K, N) independent errors that are left in it, each of one standard deviation; K may be 0.
    """

    values: Array
    doubt: Array


def smooth_series(values: Array, max_share: float = 0.5) -> Array:
    """The cosine series of `values` (N,) cut where further terms are noise (Bayesian information criterion).

    A constant in noise becomes its mean: what is kept at low frequency would make a simulated aircraft drift.
    """
    if not np.any(values):
        return np.zeros(values.size)
    coefficients = fft.dct(values, norm="ortho")
    coefficients[_terms(values, coefficients, max_share) :] = 0.0
    return np.ascontiguousarray(fft.idct(coefficients, norm="ortho"))


def _terms(values: Array, coefficients: Array, max_share: float) -> int:
    """How many terms of the cosine series of `values` stand out of the noise."""
    n = values.size
    power = np.concatenate((np.cumsum(coefficients[::-1] ** 2)[::-1][1:], [0.0]))
    limit = max(1, int(max_share * n))
    floor = 1e-24 * max(float(np.max(values**2)), 1e-300)
    criterion = n * np.log(np.maximum(power / n, floor)) + np.arange(1, n + 1) * np.log(n)
    return int(np.argmin(criterion[:limit])) + 1


def denoise_thrust(thrust: Array, throttle: Array, interval_s: float) -> Array:
    """Measured thrust (N,) [N] with its noise taken off, steps of the throttle (N,) kept sharp.

    What a lagged throttle explains is taken as it is; the rest is smoothed.
    """
    return denoised_thrust(thrust, throttle, interval_s).values


def denoised_thrust(thrust: Array, throttle: Array, interval_s: float) -> Denoised:
    """The same with what its own noise leaves uncertain: level, gain and lag of the throttle's share, slow swings."""
    thrust = np.asarray(thrust, dtype=np.float64)
    if thrust.size < 16 or not np.isfinite(thrust).all() or np.ptp(thrust) == 0.0:
        return Denoised(np.ascontiguousarray(thrust), np.zeros((0, thrust.size)))
    n = thrust.size
    explained, design = np.full(n, thrust.mean()), np.ones((n, 1))
    if np.ptp(throttle) > 1e-6:
        lag_s = _likeliest_lag(thrust, throttle, interval_s)
        fitted = _explained(thrust, throttle, interval_s, lag_s)
        gain = n * np.log(np.var(thrust) / max(float(np.mean((thrust - fitted) ** 2)), 1e-300))
        if gain > 3.0 * np.log(n):
            explained, design = fitted, _doubted(throttle, interval_s, lag_s)
    rest = thrust - explained
    values = explained + smooth_series(rest)
    kept = _terms(rest, fft.dct(rest, norm="ortho"), 0.5) if np.any(rest) else 1
    swings = fft.idct(np.eye(min(kept, _DOUBTED_TERMS), n)[1:], norm="ortho").T
    design = np.hstack([design, swings])
    basis, sizes, _ = linalg.qr(design, mode="economic", pivoting=True)
    basis = basis[:, np.abs(np.diag(sizes)) > 1e-9 * np.abs(sizes[0, 0])]
    sigma = float(np.sqrt(np.sum((thrust - values) ** 2) / max(n - basis.shape[1], 1)))
    return Denoised(np.ascontiguousarray(values), np.ascontiguousarray(sigma * basis.T))


def _likeliest_lag(thrust: Array, throttle: Array, interval_s: float) -> float | None:
    """Lag of the motor, s, behind the throttle; None where thrust shows the throttle of its own sample."""

    def error(lag_s: float | None) -> float:
        return float(np.mean((thrust - _explained(thrust, throttle, interval_s, lag_s)) ** 2))

    tried = (None, *_LAGS_S)
    first = int(np.argmin([error(lag_s) for lag_s in tried]))
    if first <= 1:
        return tried[first]
    # The lags tried are coarse; between its neighbours the best one has a single minimum.
    low, high = _LAGS_S[first - 2], _LAGS_S[min(first, len(_LAGS_S) - 1)]
    return float(optimize.minimize_scalar(error, bounds=(low, high), method="bounded").x)


def _regressors(throttle: Array, interval_s: float, lag_s: float | None) -> Array:
    """Level, lagged throttle, and what was still under way at the first sample, (N, 2 or 3)."""
    columns = [np.ones(throttle.size), _lagged(throttle, interval_s, lag_s)]
    if lag_s is not None and lag_s >= 1e-6:
        columns.append(np.exp(-interval_s * np.arange(throttle.size) / lag_s))
    return np.column_stack(columns)


def _doubted(throttle: Array, interval_s: float, lag_s: float | None) -> Array:
    """What is uncertain of the explained part: its regressors, and its change with the lag."""
    design = _regressors(throttle, interval_s, lag_s)
    if lag_s is None or lag_s < 1e-6:
        return design
    longer = _lagged(throttle, interval_s, 1.05 * lag_s) - _lagged(throttle, interval_s, 0.95 * lag_s)
    return np.column_stack([design, longer])


def _explained(thrust: Array, throttle: Array, interval_s: float, lag_s: float | None) -> Array:
    """The part of thrust that is linear in the lagged throttle, and in what was still under way at the first sample."""
    design = _regressors(throttle, interval_s, lag_s)
    return np.asarray(design @ np.linalg.lstsq(design, thrust, rcond=None)[0], dtype=np.float64)


def _lagged(command: Array, interval_s: float, lag_s: float | None) -> Array:
    """A command held from each sample on, after a first-order lag, as seen at the samples; None: seen at once."""
    if lag_s is None:
        return command
    before = np.concatenate((command[:1], command[:-1]))
    if lag_s < 1e-6:
        return before
    decay = float(np.exp(-interval_s / lag_s))
    lagged, _ = signal.lfilter([1.0 - decay], [1.0, -decay], before, zi=[decay * command[0]])
    return np.asarray(lagged, dtype=np.float64)
