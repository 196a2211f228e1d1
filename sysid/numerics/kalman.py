"""The Kalman filter's update by one scalar reading."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit_inlined

Array = NDArray[np.float64]


@jit_inlined
def innovation(s: Array, p: Array, h: Array, left: float, noise: float, hp: Array) -> tuple[float, float]:
    """One reading's innovation and its variance.

    Parameters
    ----------
    s : Array, shape (nx,)
        Expected state, each in its own unit.
    p : Array, shape (nx, nx)
        Covariance of the expected state, in the product of the units of both states.
    h : Array, shape (nx,)
        Derivative of the reading by the state, in the reading's unit over the state's.
    left : float
        Measured reading, less what a state of zero reads, in the reading's unit.
    noise : float
        Variance of the reading's noise, in the square of its unit.
    hp : Array, shape (nx,)
        Covariance of the state with what is read, in the state's unit times the reading's; result, written over.

    Returns
    -------
    nu : float
        Innovation, in the reading's unit.
    big : float
        Variance of the innovation, in the square of the reading's unit.
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
