"""Cramer-Rao bound in turbulence: gusts of Dryden form as process noise of the motion linearised about the truth.

The outputs' errors have the covariance R + G G', G being the outputs' answer to the white noise that drives the gusts.
A Kalman filter with the true matrices whitens the sensitivities, which gives S' (R + G G')^-1 S without the large
matrix (Mehra's innovations form; Maine & Iliff, NASA RP-1168, section 5). Intensity and length of the gusts are known.
The matrices are differences of single steps of the plant that flew; nothing of the estimators is used.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from flight_bounds import STATES, Array, Experiment, Slopes, true_states

from sim_vehicle.layout import CHANNELS
from sim_vehicle.plant import Plant
from sim_vehicle.plantstate import PlantState, quaternion

_STEP = 1e-4  # m/s, rad/s, rad: of states and gusts
_STILL = np.zeros(3)


@dataclass(frozen=True)
class GustModel:
    """Exactly discretised Dryden filters of the three components, five states: f' = F f + noise, gust = H f."""

    F: Array
    H: Array
    Q: Array


def gust_model(sigma: float, length: float, airspeed: float, dt: float) -> GustModel:
    """Filters of MIL-F-8785C's spectra: first order along the path, second order across it."""
    step = dt * airspeed / length
    decay = math.exp(-step)
    F, Q, H = np.zeros((5, 5)), np.zeros((5, 5)), np.zeros((3, 5))
    F[0, 0], Q[0, 0], H[0, 0] = decay, sigma**2 * (1.0 - decay**2), 1.0
    across = decay * np.array([[1.0, 0.0], [step, 1.0]])
    # Variance of two equal lags in a row under noise that gives sqrt(3) x1 + (1 - sqrt(3)) x2 unit variance.
    stationary = sigma**2 * np.array([[0.5, 0.25], [0.25, 0.25]])
    for axis in (1, 2):
        place = slice(2 * axis - 1, 2 * axis + 1)
        F[place, place] = across
        Q[place, place] = stationary - across @ stationary @ across.T
        H[axis, place] = math.sqrt(3.0), 1.0 - math.sqrt(3.0)
    return GustModel(F, H, Q)


@dataclass(frozen=True)
class LinearPath:
    """The motion linearised about the truth, gust[k] being that which a sensor meets at sample k:

    x[k+1] = A[k] x[k] + B[k] (gust[k] + gust[k+1]) / 2, y[k] = C[k] x[k] + D[k] gust[k].
    """

    A: Array
    B: Array
    C: Array
    D: Array


def linear_path(experiment: Experiment, max_step: float = 0.005) -> LinearPath:
    """Central differences of single steps, states and gusts of the free motion only."""
    plant = Plant(experiment.vehicle, experiment.model, max_step=max_step)
    flown = experiment.flown
    path, count = true_states(flown), flown.time_s.size
    dt = float(flown.time_s[1] - flown.time_s[0])
    surfaces = np.stack([flown.truth[name] for name in ("de", "da", "dr", "throttle")], axis=1)
    columns = [CHANNELS.index(name) for name in experiment.outputs]
    free = [STATES.index(name) for name in experiment.states]
    air = [0, 1, 2] if experiment.lateral else [0, 2]
    n, m = len(free), len(air)
    A, B = np.zeros((count, n, n)), np.zeros((count, n, 3))
    C, D = np.zeros((count, len(columns), n)), np.zeros((count, len(columns), 3))

    def state(k: int, change: Array, place: Array) -> PlantState:
        """`place`: where the aircraft is; the attitude and the rest from nine numbers."""
        nine = path[k] + change
        x = np.concatenate((place, nine[:3], quaternion(*(float(a) for a in nine[6:])), nine[3:6], [0.0]))
        return plant.state_at(x, flown.command[max(k - 1, 0)], surfaces[k])

    for k in range(count):
        place = np.array([flown.truth[name][k] for name in ("north", "east", "down")])
        here = flown.gust_body[k]
        over = 0.5 * (here + flown.gust_body[min(k + 1, count - 1)])
        for j in range(n + m):
            ends, reads = [], []
            for sign in (1.0, -1.0):
                change, gust = np.zeros(9), np.zeros(3)
                if j < n:
                    change[free[j]] = sign * _STEP
                else:
                    gust[air[j - n]] = sign * _STEP
                moved = state(k, change, place)
                plant.evaluate(moved, _STILL, here + gust, 0.0)
                reads.append(plant.read(moved)[columns])
                plant.step(moved, flown.command[k], dt, _STILL, over + gust)
                ends.append(_nine(moved)[free])
            step, read = (ends[0] - ends[1]) / (2.0 * _STEP), (reads[0] - reads[1]) / (2.0 * _STEP)
            if j < n:
                A[k, :, j], C[k, :, j] = step, read
            else:
                B[k, :, air[j - n]], D[k, :, air[j - n]] = step, read
    return LinearPath(A, B, C, D)


def gust_information(told: Slopes, path: LinearPath, gusts: GustModel) -> Array:
    """Fisher information of the unknowns (P, P) with the gusts as process noise, calm at the first sample."""
    information = told.prior.copy()
    for white in whitened(told, path, gusts):
        information += white.T @ white
    return np.asarray(information, dtype=np.float64)


def whitened(told: Slopes, path: LinearPath, gusts: GustModel) -> Iterator[Array]:
    """The derivatives sample by sample, (outputs, P), as a Kalman filter whitens them; calm at the first sample."""
    n, f = path.A.shape[1], gusts.F.shape[0]
    size = n + f
    covariance, mean = np.zeros((size, size)), np.zeros((size, len(told.names)))
    for k in range(told.values.shape[0]):
        used = np.isfinite(told.sigma[k])
        H = np.zeros((int(used.sum()), size))
        H[:, :n], H[:, n:] = path.C[k][used], path.D[k][used] @ gusts.H
        gap = told.values[k][used] - H @ mean
        root = np.linalg.cholesky(H @ covariance @ H.T + np.diag(told.sigma[k][used] ** 2))
        white = np.linalg.solve(root, gap)
        yield np.asarray(white, dtype=np.float64)
        half = np.linalg.solve(root, H @ covariance)
        mean = mean + half.T @ white
        covariance = covariance - half.T @ half
        # The noise of a step changes the gust at its end, half of which the aircraft has felt by then.
        noise = np.vstack((0.5 * path.B[k] @ gusts.H, np.eye(f)))
        step = np.zeros((size, size))
        step[:n, :n], step[:n, n:] = path.A[k], noise[:n] @ (np.eye(f) + gusts.F)
        step[n:, n:] = gusts.F
        mean, covariance = step @ mean, step @ covariance @ step.T + noise @ gusts.Q @ noise.T


def _nine(state: PlantState) -> Array:
    """The STATES of a plant's state."""
    q0, q1, q2, q3 = state.x[6:10]
    phi = math.atan2(2.0 * (q2 * q3 + q0 * q1), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3)
    theta = math.asin(2.0 * (q0 * q2 - q1 * q3))
    psi = math.atan2(2.0 * (q1 * q2 + q0 * q3), q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3)
    return np.array([*state.x[3:6], *state.x[10:13], phi, theta, psi])
