"""The equations of motion linearised along a path, in closed form (compiled), for the filter-error method.

Jacobians of the rates are taken in the middle of every step and carried over it by the series of the matrix
exponential; those of the readings at the samples.
"""

from __future__ import annotations

from math import cos, pi, sin, tan

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.effects import START_TIME, slot
from sim_vehicle.effects.wind_shear import shear_slopes
from sim_vehicle.jit import jit, jit_arrays
from sim_vehicle.model.aerodynamic_terms import REGRESSORS
from sim_vehicle.physics.actuation import count_named
from sim_vehicle.physics.dynamics import derivatives
from sim_vehicle.physics.layout import STATE_SIZE, WORK_SIZE, Aux, Par
from sim_vehicle.sensitivities.dynamics_jacobian import COLUMNS, STATE_COLUMNS, THRUST_COLUMN, force_jacobian
from sim_vehicle.sensitivities.sensor_jacobian import READINGS, reading_jacobian
from sysid.filter_error.prediction import to_simulation

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_GRAVITY, _TIME = int(Par.gravity), int(Aux.time)
_SHEAR, _SHEAR_G = slot("wind_shear"), slot("wind_shear", "gradient")
_REGRESSORS, _READINGS = len(REGRESSORS), len(READINGS)
_GROUND = READINGS.index("vn")  # from here on readings know nothing of gusts


@jit
def _quaternion_by_angles(s: Array, Q: Array) -> None:
    """Derivatives Q (4, 3) of the quaternion by phi, theta, psi."""
    cr, sr, cp, sp = cos(s[6] / 2), sin(s[6] / 2), cos(s[7] / 2), sin(s[7] / 2)
    cy, sy = cos(s[8] / 2), sin(s[8] / 2)
    Q[0, 0], Q[0, 1], Q[0, 2] = -sr * cp * cy + cr * sp * sy, -cr * sp * cy + sr * cp * sy, -cr * cp * sy + sr * sp * cy
    Q[1, 0], Q[1, 1], Q[1, 2] = cr * cp * cy + sr * sp * sy, -sr * sp * cy - cr * cp * sy, -sr * cp * sy - cr * sp * cy
    Q[2, 0], Q[2, 1], Q[2, 2] = -sr * sp * cy + cr * cp * sy, cr * cp * cy - sr * sp * sy, -cr * sp * sy + sr * cp * cy
    Q[3, 0], Q[3, 1], Q[3, 2] = -sr * cp * sy - cr * sp * cy, -cr * sp * sy - sr * cp * cy, cr * cp * cy + sr * sp * sy
    Q *= 0.5


@jit
def _rates_by_states(s: Array, gravity: float, R: Array, Q: Array, A: Array) -> None:
    """Jacobian A (9, 9) of the rates of u v w p q r phi theta psi; R: of forces and moments, Q: see above."""
    u, v, w, p, q, r = s[0], s[1], s[2], s[3], s[4], s[5]
    cf, sf, ct, st = cos(s[6]), sin(s[6]), cos(s[7]), sin(s[7])
    A[:] = 0.0
    for row in range(6):
        for z in range(6):
            A[row, z] = R[row, z]
        for z in range(3):
            for c in range(4):
                A[row, 6 + z] += R[row, 6 + c] * Q[c, z]
    A[0, 1] += r
    A[0, 2] -= q
    A[0, 4] -= w
    A[0, 5] += v
    A[0, 7] -= gravity * ct
    A[1, 0] -= r
    A[1, 2] += p
    A[1, 3] += w
    A[1, 5] -= u
    A[1, 6] += gravity * ct * cf
    A[1, 7] -= gravity * st * sf
    A[2, 0] += q
    A[2, 1] -= p
    A[2, 3] -= v
    A[2, 4] += u
    A[2, 6] -= gravity * ct * sf
    A[2, 7] -= gravity * st * cf
    turn, rise, slope = q * sf + r * cf, q * cf - r * sf, tan(s[7])
    A[6, 3], A[6, 4], A[6, 5], A[6, 6], A[6, 7] = 1.0, slope * sf, slope * cf, slope * rise, turn / (ct * ct)
    A[7, 4], A[7, 5], A[7, 6] = cf, -sf, -turn
    A[8, 4], A[8, 5], A[8, 6], A[8, 7] = sf / ct, cf / ct, rise / ct, turn * slope / ct


@jit_arrays
def _add_shear(x: Array, gradient: float, Q: Array, A: Array) -> None:
    """What the wind's shear adds to A (see above) at the simulation's state `x`."""
    slopes = np.empty((3, 7))
    shear_slopes(x, gradient, slopes)
    for row in range(3):
        for z in range(3):
            A[row, z] += slopes[row, z]
            for c in range(4):
                A[row, 6 + z] += slopes[row, 3 + c] * Q[c, z]


@jit_arrays
def path_slopes(
    before: Array, gust_before: Array, after: Array, gust_over: Array, ahead: Array, free: IntArray, axes: IntArray,
    over: Array, seen: Array, thrust: Array, rho: Array, heights: Array, dt: float, P: Array, E: Array, C: Array,
    F: IntArray, K: IntArray, T: IntArray, terms: IntArray, columns: IntArray, weights: Array, places: IntArray,
    targets: IntArray, width: int,
) -> tuple[Array, Array, Array, Array]:  # fmt: skip
    """Derivatives of what `sysid.filter_error.prediction.predict_path` gives for the same arguments.

    ahead: (N - 1, 9) its result. axes: gust components that act, na of them. terms, columns, weights: (V,) of every
    unknown the model's term it is the coefficient of (below 0: none), the column of `force_jacobian` it acts through,
    and a factor at every sample, (V, N). places: among READINGS. targets: (V,) where each unknown stands among `width`.
    Returns the step's derivatives by free states and gusts (N - 1, nf, nf + na) and by the unknowns
    (N - 1, nf, width), 0 where nothing stands, and those of the readings (N, m, nf + na), (N, m, width).
    """
    n, nf, na, m, count = before.shape[0], free.size, axes.size, places.size, terms.size
    step_x, step_v = np.empty((n - 1, nf, nf + na)), np.zeros((n - 1, nf, width))
    read_x, read_v = np.empty((n, m, nf + na)), np.zeros((n, m, width))
    named = count_named(F)
    x, W, rate, still = np.zeros(STATE_SIZE), np.zeros(WORK_SIZE + named), np.zeros(STATE_SIZE), np.zeros(3)
    flow, D, J, R = np.zeros((3, 3)), np.zeros((6, _REGRESSORS + named)), np.zeros((6, COLUMNS)), np.zeros((6, COLUMNS))
    part, angles, products, H = (
        np.zeros((4, COLUMNS)),
        np.zeros((3, 4)),
        np.zeros(C.size),
        np.zeros((_READINGS, COLUMNS)),
    )
    Q, A, middle, surfaces = np.zeros((4, 3)), np.zeros((9, 9)), np.empty(9), np.empty(4 + named)
    inner, direct, unit = np.zeros((nf, nf)), np.zeros((nf, na + count)), np.eye(nf)
    for k in range(n):
        x[2] = -heights[k]
        W[_TIME] = E[START_TIME] + k * dt
        to_simulation(before[k], x)
        derivatives(x, seen[k], thrust[k], still, gust_before[k], rho[k], P, E, C, F, K, T, W, rate)
        force_jacobian(
            x, seen[k], np.isnan(thrust[k]), gust_before[k], P, E, C, F, K, T, W, flow, D, J, part, products, R
        )
        reading_jacobian(x, W, x[5] - gust_before[k, 2], P, E, flow, R, angles, H)
        _quaternion_by_angles(before[k], Q)
        for j in range(m):
            row = places[j]
            for a in range(nf):
                read_x[k, j, a] = H[row, free[a]] if free[a] < 6 else 0.0
                if free[a] >= 6:
                    for c in range(4):
                        read_x[k, j, a] += H[row, 6 + c] * Q[c, free[a] - 6]
            for a in range(na):
                read_x[k, j, nf + a] = -H[row, axes[a]] if row < _GROUND else 0.0
            for t in range(count):
                product = products[terms[t]] if terms[t] >= 0 else 1.0
                read_v[k, j, targets[t]] = weights[t, k] * H[row, columns[t]] * product
        if k + 1 == n:
            break
        for i in range(9):
            apart = ahead[k, i] - after[k, i]
            middle[i] = after[k, i] + 0.5 * ((apart + pi) % (2.0 * pi) - pi if i == 6 or i == 8 else apart)
        for i in range(surfaces.size):
            surfaces[i] = 0.0
            for sub in range(over.shape[1]):
                surfaces[i] += (over[k, sub, 0, i] + 4.0 * over[k, sub, 1, i] + over[k, sub, 2, i]) / 6.0
            surfaces[i] /= over.shape[1]
        pull = 0.5 * (thrust[k] + thrust[k + 1])
        W[_TIME] = E[START_TIME] + (k + 0.5) * dt
        to_simulation(middle, x)
        derivatives(x, surfaces, pull, still, gust_over[k], rho[k], P, E, C, F, K, T, W, rate)
        force_jacobian(x, surfaces, np.isnan(pull), gust_over[k], P, E, C, F, K, T, W, flow, D, J, part, products, R)
        _quaternion_by_angles(middle, Q)
        _rates_by_states(middle, P[_GRAVITY], R, Q, A)
        if E[_SHEAR] != 0.0:
            _add_shear(x, E[_SHEAR_G], Q, A)
        for i in range(nf):
            row = free[i]
            for a in range(nf):
                inner[i, a] = dt * A[row, free[a]]
            for a in range(na):
                direct[i, a] = -dt * R[row, axes[a]] if row < 6 else 0.0
            for t in range(count):
                direct[i, na + t] = 0.0
                if row < 6:
                    product = products[terms[t]] if terms[t] >= 0 else 1.0
                    weight = 0.5 * (weights[t, k] + weights[t, k + 1])
                    direct[i, na + t] = dt * weight * R[row, columns[t]] * product
        second = inner @ inner
        third = second @ inner
        fourth = second @ second
        step_x[k, :, :nf] = unit + inner + second / 2.0 + third / 6.0 + fourth / 24.0
        moved = (unit + inner / 2.0 + second / 6.0 + third / 24.0) @ direct
        step_x[k, :, nf:] = moved[:, :na]
        for i in range(nf):
            for t in range(count):
                step_v[k, i, targets[t]] = moved[i, na + t]
    return step_x, step_v, read_x, read_v


__all__ = ["COLUMNS", "STATE_COLUMNS", "THRUST_COLUMN", "path_slopes"]
