"""Columns of equations at the lower rate at which changes are looked for."""

from __future__ import annotations

import numpy as np
from scipy import signal

from sysid.arrays import Array, IntArray

# Of the low-pass, and rate of the samples behind it: the motion that test inputs make ends at 2 to 3 Hz.
CUTOFF_HZ = 4.0
RATE_HZ = 10.0
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
