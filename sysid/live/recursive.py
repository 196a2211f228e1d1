"""Recursive least squares with forgetting, and error bars that count the residuals' autocorrelation.

The covariance is P [sum over lags of R(i) sum x[k] x[k-i]'] P, residual autocorrelations R(i) and lagged products being
updated at each sample (after J. A. Grauer & E. A. Morelli; the batch form is Klein & Morelli's, section 5.2).
Source of the recursion: Klein & Morelli, "Aircraft System Identification", chapter 8.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from scipy import signal

from sysid.flight import Array, IntArray

CUTOFF_HZ = 4.0
RATE_HZ = 10.0
MEMORY_S = 20.0
_LAGS = 10
# Share of the usual leverage below which a sample is no excitation: nothing is forgotten for it.
_GATE = 0.1
# Start of P in usual sizes: so large that one second of any motion outweighs it.
_NOTHING_KNOWN = 1e4


class Decimator:
    """Low-passes columns without looking ahead, both sides of an equation alike, and takes every n-th sample."""

    def __init__(self, interval_s: float, columns: int) -> None:
        self._step = max(round(1.0 / (RATE_HZ * interval_s)), 1)
        high = min(2.0 * CUTOFF_HZ * interval_s, 0.9)
        self._filter = signal.butter(4, high, output="sos")
        self._rest = signal.sosfilt_zi(self._filter)
        self._columns = columns
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


class RecursiveLeastSquares:
    """Coefficients of one axis by samples at RATE_HZ. scales: (P,) usual sizes, of which the start knows nothing."""

    def __init__(self, scales: Array) -> None:
        size = scales.size
        self.values = np.zeros(size)
        self._P = np.diag((_NOTHING_KNOWN * scales) ** 2)
        self._forget = 1.0 - 1.0 / (RATE_HZ * MEMORY_S)
        self._lagged = np.zeros((_LAGS, size, size))
        self._autocorrelation = np.zeros(_LAGS)
        self._weight = 0.0
        self._last: deque[tuple[Array, float]] = deque(maxlen=_LAGS)

    def add(self, x: Array, y: float) -> float:
        """Take one sample; the error of its prediction by what was known before."""
        Px = self._P @ x
        leverage = float(x @ Px)
        forget = self._forget if leverage > _GATE * x.size / (RATE_HZ * MEMORY_S) else 1.0
        gain = Px / (forget + leverage)
        innovation = float(y - x @ self.values)
        self.values = self.values + gain * innovation
        self._P = (self._P - np.outer(gain, Px)) / forget
        # The innovations of the start are the start's.
        residual = float(y - x @ self.values)
        self._last.appendleft((x, residual))
        self._weight = forget * self._weight + 1.0
        self._lagged *= forget
        self._autocorrelation *= forget
        for i, (x_before, v_before) in enumerate(self._last):
            self._lagged[i] += np.outer(x, x_before)
            self._autocorrelation[i] += residual * v_before
        return innovation

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
