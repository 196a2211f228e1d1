"""Recursive least squares with forgetting, and error bars that count the residuals' autocorrelation.

The covariance is P [sum over lags of R(i) sum x[k] x[k-i]'] P, residual autocorrelations R(i) and lagged products being
updated at each sample (after J. A. Grauer & E. A. Morelli; the batch form is Klein & Morelli's, section 5.2).
Source of the recursion: Klein & Morelli, "Aircraft System Identification", chapter 8.
"""

from __future__ import annotations

import numpy as np
from scipy import signal

from sim_vehicle.jit import jit_arrays
from sysid.arrays import Array, IntArray

CUTOFF_HZ = 4.0
RATE_HZ = 10.0
MEMORY_S = 20.0
_LAGS = 10
# Share of the usual leverage below which a sample is no excitation: nothing is forgotten for it.
_GATE = 0.1
# Start of P in usual sizes: so large that one second of any motion outweighs it.
_NOTHING_KNOWN = 1e4


# Equivalent noise bandwidth of the filter, fourth order, over its cut-off frequency: (pi / 8) / sin(pi / 8).
_BUTTERWORTH_BAND = 1.026


class Decimator:
    """Low-passes columns without looking ahead, both sides of an equation alike, and takes every n-th sample.

    white_noise_left: the share of white noise's variance that passes.
    """

    def __init__(self, interval_s: float) -> None:
        self._step = max(round(1.0 / (RATE_HZ * interval_s)), 1)
        high = min(2.0 * CUTOFF_HZ * interval_s, 0.9)
        self.white_noise_left = _BUTTERWORTH_BAND * high
        self._filter = signal.butter(4, high, output="sos")
        self._rest = signal.sosfilt_zi(self._filter)
        self._state: Array | None = None
        self._count = 0

    def take(self, samples: Array) -> tuple[Array, IntArray]:
        """Filtered samples (K', n) of those (K, n) taken, and their places among them."""
        if self._state is None:
            self._state = self._rest[:, :, None] * samples[0]
        filtered, self._state = signal.sosfilt(self._filter, samples, axis=0, zi=self._state)
        places = np.flatnonzero((self._count + np.arange(samples.shape[0])) % self._step == 0)
        self._count += samples.shape[0]
        return np.asarray(filtered[places]), places.astype(np.int64)

    def restart(self) -> None:
        """What comes next does not continue."""
        self._state = None


@jit_arrays
def _recur(
    X: Array,
    y: Array,
    memory: float,
    values: Array,
    P: Array,
    lagged: Array,
    autocorrelation: Array,
    before: Array,
    rest: Array,
    weight: float,
) -> float:
    """Take samples X (K, n), y (K,) into all that is known, whose arrays are changed; the new weight.

    memory: samples of the forgetting. before (lags, n), rest (lags,): the last samples and their residuals, newest
    first, zeros where there were none yet.
    """
    n = values.size
    lags = rest.size
    Px = np.zeros(n)
    for k in range(y.size):
        leverage, innovation = 0.0, y[k]
        for i in range(n):
            Px[i] = 0.0
            for j in range(n):
                Px[i] += P[i, j] * X[k, j]
            leverage += X[k, i] * Px[i]
            innovation -= X[k, i] * values[i]
        forget = 1.0 - 1.0 / memory if leverage > _GATE * n / memory else 1.0
        # The innovations of the start are the start's, so autocorrelations are those of what is left behind.
        residual = y[k]
        for i in range(n):
            values[i] += Px[i] / (forget + leverage) * innovation
            residual -= X[k, i] * values[i]
            for j in range(n):
                P[i, j] = (P[i, j] - Px[i] * Px[j] / (forget + leverage)) / forget
        for lag in range(lags - 1, 0, -1):
            before[lag] = before[lag - 1]
            rest[lag] = rest[lag - 1]
        before[0] = X[k]
        rest[0] = residual
        weight = forget * weight + 1.0
        for lag in range(lags):
            autocorrelation[lag] = forget * autocorrelation[lag] + residual * rest[lag]
            for i in range(n):
                for j in range(n):
                    lagged[lag, i, j] = forget * lagged[lag, i, j] + X[k, i] * before[lag, j]
    return weight


class RecursiveLeastSquares:
    """Coefficients of one axis by samples at RATE_HZ. scales: (P,) usual sizes, of which the start knows nothing."""

    def __init__(self, scales: Array) -> None:
        size = scales.size
        self.values = np.zeros(size)
        self._P = np.diag((_NOTHING_KNOWN * scales) ** 2)
        self._lagged = np.zeros((_LAGS, size, size))
        self._autocorrelation = np.zeros(_LAGS)
        self._weight = 0.0
        self._before = np.zeros((_LAGS, size))
        self._rest = np.zeros(_LAGS)

    def add(self, X: Array, y: Array) -> None:
        """Take samples X (K, P), y (K,)."""
        self._weight = _recur(
            X, y, RATE_HZ * MEMORY_S, self.values, self._P, self._lagged, self._autocorrelation,
            self._before, self._rest, self._weight,
        )  # fmt: skip

    @property
    def std(self) -> Array:
        """(P,) standard errors for coloured residuals; infinite before there are samples to spare."""
        spare = self._weight - self.values.size
        if spare <= 1.0:
            return np.full(self.values.size, np.inf)
        R = self._autocorrelation / spare
        middle = R[0] * self._lagged[0]
        for i in range(1, _LAGS):
            taper = 1.0 - i / _LAGS  # Bartlett's, which keeps the sum positive (Newey & West, 1987)
            middle = middle + taper * R[i] * (self._lagged[i] + self._lagged[i].T)
        return np.asarray(np.sqrt(np.maximum(np.diag(self._P @ middle @ self._P), np.diag(self._P) * R[0])))
