"""The Kalman filter's update by one scalar reading."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit_inlined

Array = NDArray[np.float64]


@jit_inlined
def innovation(s: Array, p: Array, h: Array, left: float, noise: float, hp: Array) -> tuple[float, float]:
    """One reading's innovation and its variance; hp: (nx,) result, covariance of the state with what is read.

    s, p: (nx,), (nx, nx) expected state and covariance. h: (nx,) reading by state. left: measured, less what a state
    of zero reads. noise: variance.
    """
    nu, big = left, noise
    for a in range(s.size):
        total = 0.0
        for b in range(s.size):
            total += p[a, b] * h[b]
        hp[a] = total
    for a in range(s.size):
        nu -= h[a] * s[a]
        big += h[a] * hp[a]
    return nu, big
