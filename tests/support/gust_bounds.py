"""Cramer-Rao bound in turbulence: gusts of Dryden form as process noise of the motion linearised about the truth.

The outputs' errors have the covariance R + G G', G being the outputs' answer to the white noise that drives the gusts.
A Kalman filter with the true matrices whitens the sensitivities, which gives S' (R + G G')^-1 S without the large
matrix (Mehra's innovations form; Maine & Iliff, NASA RP-1168, section 5). Intensity and length of the gusts are known.
The matrices are differences of single steps of the simulator; nothing of the estimators is used.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from flight_bounds import STATES, SUB_STEPS, Array, Experiment, Slopes, true_states

from sim_vehicle.effects import START_TIME
from sim_vehicle.physics.actuation import advance_actuators, start_actuators, surfaces_at_rest
from sim_vehicle.physics.dynamics import derivatives
from sim_vehicle.physics.ideal_sensors import read_sensors
from sim_vehicle.physics.layout import ACTUATOR_SIZE, CHANNELS, SENSOR_SIZE, STATE_SIZE, WORK_SIZE, Aux
from sim_vehicle.physics.rotation import quaternion
from sim_vehicle.physics.simulation import effects_flown, settle_lift, tick
from sim_vehicle.vehicle.packed_model import PackedModel, flatten

_STEP = 1e-4  # m/s, rad/s, rad: of states and gusts
_STILL, _FREE = np.zeros(3), np.zeros(0)


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


def linear_path(experiment: Experiment) -> LinearPath:
    """Central differences of single steps, states and gusts of the free motion only.

    Thrust is as it was measured and the servos are where they were, as in the whole simulations of `slopes`: a path
    that answers otherwise than those makes innovations of what coefficients and starting states could imitate.
    """
    flown, flat = experiment.flown, flatten(experiment.vehicle, experiment.model)
    path, count = true_states(flown), flown.time_s.size
    columns = [CHANNELS.index(name) for name in experiment.outputs]
    free = [STATES.index(name) for name in experiment.states]
    air = [0, 1, 2] if experiment.lateral else [0, 2]
    n, m = len(free), len(air)
    A, B = np.zeros((count, n, n)), np.zeros((count, n, 3))
    C, D = np.zeros((count, len(columns), n)), np.zeros((count, len(columns), 3))
    steps = _Steps(experiment, flat)
    for k in range(count):
        for j in range(n + m):
            ends, reads = [], []
            for sign in (1.0, -1.0):
                change, gust = np.zeros(9), np.zeros(3)
                if j < n:
                    change[free[j]] = sign * _STEP
                else:
                    gust[air[j - n]] = sign * _STEP
                reading, end = steps.step(k, path[k] + change, gust)
                reads.append(reading[columns])
                ends.append(end[free])
            step, read = (ends[0] - ends[1]) / (2.0 * _STEP), (reads[0] - reads[1]) / (2.0 * _STEP)
            if j < n:
                A[k, :, j], C[k, :, j] = step, read
            else:
                B[k, :, air[j - n]], D[k, :, air[j - n]] = step, read
    return LinearPath(A, B, C, D)


class _Steps:
    """Single steps of a flight from any of its samples, with recorded thrust and with servos that run all along."""

    def __init__(self, experiment: Experiment, flat: PackedModel) -> None:
        self._flown, self._flat = experiment.flown, flat
        self._effects = effects_flown(flat.E, float(self._flown.truth["thrust"][0]))
        self._command = np.ascontiguousarray(self._flown.command)
        self._dt = float(self._flown.time_s[1] - self._flown.time_s[0])
        actuators, mean, surfaces = np.zeros(ACTUATOR_SIZE), np.zeros(4), np.zeros(4)
        start_actuators(self._command[0], actuators)
        surfaces_at_rest(self._command[0], self._effects, surfaces)
        self._servos: list[tuple[Array, Array]] = []
        step = self._dt / SUB_STEPS
        for k in range(self._command.shape[0]):
            self._servos.append((actuators.copy(), surfaces.copy()))
            for i in range(SUB_STEPS):
                advance_actuators(
                    self._command, k, i * step, step, self._dt, flat.P, self._effects, actuators, mean, surfaces
                )

    def step(self, k: int, nine: Array, gust: Array) -> tuple[Array, Array]:
        """What sensors read at sample k from nine states, and the states at the next; gust: (3,) on top."""
        flown, flat, dt = self._flown, self._flat, self._dt
        truth, after = flown.truth, min(k + 1, flown.time_s.size - 1)
        here = flown.gust_body[k] + gust
        over = 0.5 * (flown.gust_body[k] + flown.gust_body[after]) + gust
        thrust, rho = truth["thrust"], float(truth["rho"][k])
        actuators, surfaces = (one.copy() for one in self._servos[k])
        place = [truth[name][k] for name in ("north", "east", "down")]
        x = np.concatenate((place, nine[:3], quaternion(*(float(a) for a in nine[6:])), nine[3:6], [np.nan]))
        W, scratch, rate = np.zeros(WORK_SIZE), np.zeros((6, STATE_SIZE)), np.zeros(STATE_SIZE)
        reading, mean = np.zeros(len(CHANNELS)), np.zeros(4)
        W[Aux.time] = self._effects[START_TIME] + k * dt
        model = flat.arrays._replace(E=self._effects)
        settle_lift(x, surfaces, float(thrust[k]), rho, model, W, rate)
        derivatives(x, surfaces, float(thrust[k]), _STILL, here, rho, *model, W, rate)
        read_sensors(x, W, flat.P, self._effects, 0.0, np.zeros(SENSOR_SIZE), reading)
        tick(x, actuators, self._command, k, dt, SUB_STEPS, _STILL, over, rho, 0.5 * float(thrust[k] + thrust[after]),
             _FREE, *model, W, scratch, mean, surfaces)  # fmt: skip
        return reading, _nine(x)


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


def _nine(x: Array) -> Array:
    """The STATES of a state of the simulation (14,)."""
    q0, q1, q2, q3 = x[6:10]
    phi = math.atan2(2.0 * (q2 * q3 + q0 * q1), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3)
    theta = math.asin(2.0 * (q0 * q2 - q1 * q3))
    psi = math.atan2(2.0 * (q1 * q2 + q0 * q3), q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3)
    return np.array([*x[3:6], *x[10:13], phi, theta, psi])
