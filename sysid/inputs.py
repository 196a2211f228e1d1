"""Noise taken off measured inputs, which a simulation would otherwise feel as rough air."""

from __future__ import annotations

import numpy as np
from scipy import fft, optimize, signal

from sysid.flight import Array

# Motor lags tried when measured thrust is explained by the throttle, s.
_LAGS_S = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.5)


def smooth_series(values: Array, max_share: float = 0.5) -> Array:
    """The cosine series of `values` (N,) cut where further terms are noise (Bayesian information criterion).

    A constant in noise becomes its mean: what is kept at low frequency would make a simulated aircraft drift.
    """
    n = values.size
    if not np.any(values):
        return np.zeros(n)
    coefficients = fft.dct(values, norm="ortho")
    power = np.concatenate((np.cumsum(coefficients[::-1] ** 2)[::-1][1:], [0.0]))
    terms = np.arange(1, n + 1)
    limit = max(1, int(max_share * n))
    floor = 1e-24 * max(float(np.max(values**2)), 1e-300)
    criterion = n * np.log(np.maximum(power / n, floor)) + terms * np.log(n)
    kept = int(np.argmin(criterion[:limit])) + 1
    coefficients[kept:] = 0.0
    return np.ascontiguousarray(fft.idct(coefficients, norm="ortho"))


def denoise_thrust(thrust: Array, throttle: Array, interval_s: float) -> Array:
    """Measured thrust (N,) [N] with its noise taken off, steps of the throttle (N,) kept sharp.

    What a lagged throttle explains is taken as it is; the rest is smoothed.
    """
    thrust = np.asarray(thrust, dtype=np.float64)
    if thrust.size < 16 or not np.isfinite(thrust).all() or np.ptp(thrust) == 0.0:
        return np.ascontiguousarray(thrust)
    n = thrust.size
    best, explained = n * np.log(np.var(thrust)) + np.log(n), np.full(n, thrust.mean())
    if np.ptp(throttle) > 1e-6:
        fits = [_explained(thrust, throttle, interval_s, lag) for lag in (None, *_LAGS_S)]
        errors = [float(np.mean((thrust - fitted) ** 2)) for fitted in fits]
        first = int(np.argmin(errors))
        fitted = fits[first]
        if first > 1:
            # The lags tried are coarse; between its neighbours the best one has a single minimum.
            low, high = _LAGS_S[first - 2], _LAGS_S[min(first, len(_LAGS_S) - 1)]
            found = optimize.minimize_scalar(
                lambda lag: float(np.mean((thrust - _explained(thrust, throttle, interval_s, lag)) ** 2)),
                bounds=(low, high),
                method="bounded",
            )
            fitted = _explained(thrust, throttle, interval_s, float(found.x))
        if n * np.log(max(float(np.mean((thrust - fitted) ** 2)), 1e-300)) + 4.0 * np.log(n) < best:
            explained = fitted
    return np.ascontiguousarray(explained + smooth_series(thrust - explained))


def _explained(thrust: Array, throttle: Array, interval_s: float, lag_s: float | None) -> Array:
    """The part of thrust that is linear in the lagged throttle, and in what was still under way at the first sample."""
    columns = [np.ones(thrust.size), _lagged(throttle, interval_s, lag_s)]
    if lag_s is not None and lag_s >= 1e-6:
        columns.append(np.exp(-interval_s * np.arange(thrust.size) / lag_s))
    design = np.column_stack(columns)
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
