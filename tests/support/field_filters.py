"""Lags and play of sensors, on a log at JSBSim's step."""

from __future__ import annotations

import numba
import numpy as np
from field_plant import STEP
from jsbsim_twin import Array
from scipy import signal


def _filtered(values: Array, numerator: Array, denominator: Array) -> Array:
    """Values through a transfer function in s, exact for values that go in straight lines, settled at the start."""
    b, a, _ = signal.cont2discrete((numerator, denominator), STEP, method="foh")
    b = np.ravel(b)
    return np.asarray(signal.lfilter(b, a, values, zi=signal.lfilter_zi(b, a) * values[0])[0])


def first_order(values: Array, lag: float) -> Array:
    """A lag of the first order, s."""
    return _filtered(values, np.array([1.0]), np.array([lag, 1.0]))


def low_pass(values: Array, hz: float) -> Array:
    """Butterworth's filter of the second order."""
    w = 2.0 * np.pi * hz
    return _filtered(values, np.array([w * w]), np.array([1.0, np.sqrt(2.0) * w, w * w]))


def low_pass_gain(hz: float, corner: float) -> float:
    """What that filter leaves of a line."""
    return float(1.0 / np.sqrt(1.0 + (hz / corner) ** 4))


@numba.njit(cache=True)
def vane(angle: Array, omega: Array, damping: float) -> Array:
    """A vane of the second order with a natural frequency, rad/s, at every step: the trapezoidal rule."""
    out = np.empty_like(angle)
    x, v = angle[0], 0.0
    out[0] = x
    h = STEP / 2.0
    for i in range(1, angle.size):
        w = omega[i]
        # x1 = x + h (v + v1); v1 = v + h (a + a1), a = w^2 (angle - x) - 2 damping w v
        a = w * w * (angle[i - 1] - x) - 2.0 * damping * w * v
        v1 = (v + h * a + h * w * w * (angle[i] - x - h * v)) / (1.0 + h * h * w * w + 2.0 * h * damping * w)
        x, v = x + h * (v + v1), v1
        out[i] = x
    return out


@numba.njit(cache=True)
def play(angle: Array, half: float) -> Array:
    """What follows only when pushed."""
    out = np.empty_like(angle)
    at = angle[0]
    for i in range(angle.size):
        at = min(max(at, angle[i] - half), angle[i] + half)
        out[i] = at
    return out
