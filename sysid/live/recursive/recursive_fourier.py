"""The recursive finite Fourier transform: one rotation and one addition for each line and sample.

X(w) += x[k] exp(-j w k T), so that the transform of all samples so far is there at any time.
Source: E. A. Morelli, "Real-time parameter estimation in the frequency domain", AIAA-99-4043, 1999.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit
from sysid.arrays import Array

Complex = NDArray[np.complex128]


class RecursiveFourier:
    """Transforms of n columns at M frequencies, Hz, of samples `interval_s` apart."""

    def __init__(self, frequencies_hz: Array, interval_s: float, columns: int) -> None:
        self._step: Complex = np.asarray(-2j * np.pi * frequencies_hz * interval_s, np.complex128)
        self._turn: Complex = np.exp(self._step)
        self.count = 0
        self.values: Complex = np.zeros((frequencies_hz.size, columns), np.complex128)

    def add(self, samples: Array) -> None:
        """Take samples (k, n), contiguous in memory, that follow those before."""
        _add(samples, np.exp(self._step * self.count), self._turn, self.values)
        self.count += samples.shape[0]

    def restart(self) -> None:
        """Forget all samples."""
        self.values[:] = 0.0
        self.count = 0


@jit
def _add(samples: Array, phasor: Complex, turn: Complex, values: Complex) -> None:
    """phasor: (M,) of the first sample, which is changed. turn: (M,) from one sample to the next."""
    for k in range(samples.shape[0]):
        for m in range(phasor.size):
            for i in range(samples.shape[1]):
                values[m, i] += phasor[m] * samples[k, i]
            phasor[m] *= turn[m]
