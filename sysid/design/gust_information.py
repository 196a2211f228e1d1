"""What turbulence leaves of the information in a flight, the gusts being process noise of the linearised motion.

The outputs' errors then have a covariance that a Kalman filter of the motion whitens; the information is that of the
sensitivities after the same filter (Mehra, IEEE TAC 19(6), 1974; Maine & Iliff, NASA RP-1168, section 5). It is the
bound of an estimator that knows the turbulence; plain output error stays above it. With x the change of the states and
f those of the gusts' filters (Dryden's form, as in sim_vehicle.flight.wind):

    x[k+1] = F[k] x[k] + B[k] H (f[k] + f[k+1]) / 2,  f[k+1] = Phi f[k] + noise,  y[k] = C[k] x[k] + D[k] H f[k]

A sensor meets the gust of its sample, the aircraft on its way the mean of both ends: the noise that changes the gust
within a step moves the aircraft in the same step.

The matrices follow the path: about trim alone, motion that the trimmed aircraft does not have would pass for motion
that no gust can cause, and seem to hold several times the information.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.state import PlantState
from sim_vehicle.physics.layout import CHANNELS, STATE_SIZE
from sim_vehicle.physics.rotation import quaternion
from sysid.arrays import Array
from sysid.signals.record import STATES

GUST_LENGTH_M = 20.0  # of the simulator's turbulence
_STEP = 1e-4  # m/s, rad/s, rad
_STILL = np.zeros(3)
_INPUTS = ("de", "da", "dr", "throttle")
_TERMS = 6  # of the series of the matrix exponential; a step is short against every mode


@dataclass(frozen=True)
class GustFilters:
    """Exactly discretised Dryden filters of the three components: f' = Phi f + noise of covariance Q, gust = H f."""

    Phi: Array
    H: Array
    Q: Array
    stationary: Array


@dataclass(frozen=True)
class GustyPath:
    """The motion linearised along a flight of N samples: rates of the nine STATES, and readings of all CHANNELS.

    A: (N, 9, 9), amid the step that begins at each sample. B: (N, 9, 3), by the gusts in body axes. C: (N, 19, 9), at
    each sample. D: (N, 19, 3). interval_s: s.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    interval_s: float
    filters: GustFilters

    def whitened(self, rows: Array, sigma: Array, first: int, free: list[int], columns: list[int]) -> Array:
        """Rows (N, J, P) of sensitivities of a run after the whitening filter; their products sum to the information.

        sigma: (N, J) noise. first: the run's first sample in the flight. free: its free states; the others are
        imposed. columns: places in CHANNELS of the J outputs.
        """
        count = rows.shape[0]
        here = slice(first, first + count)
        F, B = self._discrete(here, free)
        C, D = self.C[here][:, columns][:, :, free], self.D[here][:, columns]
        filters, n, f = self.filters, len(free), self.filters.Phi.shape[0]
        covariance, step = np.zeros((n + f, n + f)), np.zeros((n + f, n + f))
        covariance[n:, n:], step[n:, n:] = filters.stationary, filters.Phi
        read, shaken = np.zeros((len(columns), n + f)), np.vstack((np.zeros((n, f)), np.eye(f)))
        mean, white = np.zeros((n + f, rows.shape[2])), np.empty_like(rows)
        for k in range(count):
            read[:, :n], read[:, n:] = C[k], D[k] @ filters.H
            shaken[:n] = 0.5 * B[k] @ filters.H  # by the gust at the step's end, and by that at its begin
            step[:n, :n], step[:n, n:] = F[k], shaken[:n] @ (np.eye(f) + filters.Phi)
            crossed = read @ covariance
            root = np.linalg.cholesky(crossed @ read.T + np.diag(sigma[k] ** 2))
            both = np.linalg.solve(root, np.hstack((rows[k] - read @ mean, crossed)))
            white[k], half = both[:, : rows.shape[2]], both[:, rows.shape[2] :]
            mean = step @ (mean + half.T @ white[k])
            covariance = step @ (covariance - half.T @ half) @ step.T + shaken @ filters.Q @ shaken.T
        return white

    def _discrete(self, here: slice, free: list[int]) -> tuple[Array, Array]:
        """F and B of each step."""
        A, B = self.A[here][:, free][:, :, free], self.B[here][:, free]
        power = np.broadcast_to(np.eye(len(free)), A.shape) * self.interval_s
        F, integral = np.broadcast_to(np.eye(len(free)), A.shape).copy(), np.zeros_like(A)
        for term in range(1, _TERMS + 1):
            integral += power
            F += power @ A
            power = power @ A * (self.interval_s / (term + 1))
        return F, integral @ B


def gusty_path(plant: Plant, flown: FlownFlight, sigma: float, length: float = GUST_LENGTH_M) -> GustyPath:
    """The motion along a flight in calm air, for turbulence of `sigma` m/s and `length` m."""
    interval = float(flown.time_s[1] - flown.time_s[0])
    count, n = flown.time_s.size, len(STATES)
    A, B = np.zeros((count, n, n)), np.zeros((count, n, 3))
    C, D = np.zeros((count, len(CHANNELS), n)), np.zeros((count, len(CHANNELS), 3))
    path = _states(flown)
    surfaces = np.stack([flown.truth[name] for name in _INPUTS], axis=1)
    for k in range(count):
        after = min(k + 1, count - 1)
        within = plant.state_at(np.eye(STATE_SIZE)[6], flown.command[k], surfaces[after])
        within.x[2] = flown.truth["down"][k]
        ended = plant.state_at(np.eye(STATE_SIZE)[6], flown.command[k], surfaces[k])
        ended.x[2] = flown.truth["down"][k]
        middle = 0.5 * (path[k] + path[after])
        for j in range(n + 3):
            rates, reads = [], []
            for sign in (1.0, -1.0):
                change, gust = np.zeros(n), np.zeros(3)
                (change if j < n else gust)[j if j < n else j - n] = sign * _STEP
                rates.append(_rates(plant, within, middle + change, gust))
                _put(ended, path[k] + change, gust)
                plant.evaluate(ended, _STILL, gust, 0.0)
                reads.append(plant.read(ended))
            slope, seen = (rates[0] - rates[1]) / (2.0 * _STEP), (reads[0] - reads[1]) / (2.0 * _STEP)
            if j < n:
                A[k, :, j], C[k, :, j] = slope, seen
            else:
                B[k, :, j - n], D[k, :, j - n] = slope, seen
    return GustyPath(A, B, C, D, interval, dryden_filters(sigma, length, float(flown.truth["V"].mean()), interval))


def _put(state: PlantState, nine: Array, gust: Array) -> None:
    """Give a plant's state the nine STATES."""
    state.x[3:6], state.x[10:13] = nine[:3], nine[3:6]
    state.x[6:10] = quaternion(*nine[6:].tolist())
    state.x[13] = math.atan2(nine[2] - gust[2], nine[0] - gust[0])  # a lift that lags is taken as settled


def _rates(plant: Plant, state: PlantState, nine: Array, gust: Array) -> Array:
    """Rates of the nine STATES; `state` is the place to work in."""
    _put(state, nine, gust)
    rate = plant.rates(state, _STILL, gust)
    p, q, r, phi, theta, _ = nine[3:]
    turn = q * math.sin(phi) + r * math.cos(phi)
    angles = (p + math.tan(theta) * turn, q * math.cos(phi) - r * math.sin(phi), turn / math.cos(theta))
    return np.concatenate((rate[3:6], rate[10:13], angles))


def _states(flown: FlownFlight) -> Array:
    """(N, 9) STATES of a flight in calm air, psi unwrapped."""
    truth = flown.truth
    speed, alpha, beta = truth["V"], truth["alpha"], truth["beta"]
    air = {
        "u": speed * np.cos(beta) * np.cos(alpha),
        "v": speed * np.sin(beta),
        "w": speed * np.cos(beta) * np.sin(alpha),
    }
    return np.stack([(truth | air | {"psi": np.unwrap(truth["psi"])})[name] for name in STATES], axis=1)


def dryden_filters(sigma: float, length: float, airspeed: float, interval_s: float) -> GustFilters:
    """Filters of turbulence of `sigma` m/s and `length` m met at `airspeed` m/s."""
    step = interval_s * airspeed / length
    decay = math.exp(-step)
    Phi, H, stationary = np.zeros((5, 5)), np.zeros((3, 5)), np.zeros((5, 5))
    Phi[0, 0], H[0, 0], stationary[0, 0] = decay, 1.0, 1.0
    for axis in (1, 2):
        place = slice(2 * axis - 1, 2 * axis + 1)
        Phi[place, place] = decay * np.array([[1.0, 0.0], [step, 1.0]])
        H[axis, place] = math.sqrt(3.0), 1.0 - math.sqrt(3.0)
        stationary[place, place] = [[0.5, 0.25], [0.25, 0.25]]
    stationary *= sigma**2
    return GustFilters(Phi, H, stationary - Phi @ stationary @ Phi.T, stationary)
