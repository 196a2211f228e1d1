"""Compiled loops below a cloud of points: the lowest of each stretch, and the line that supports them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit_arrays

Array = NDArray[np.float64]


@jit_arrays
def lowest(place: NDArray[np.int64], value: Array, count: int) -> NDArray[np.int64]:
    """Index of the smallest value of each stretch that holds any. place: (N,) in 0..count-1."""
    best = np.full(count, -1, np.int64)
    for i in range(place.size):
        held = best[place[i]]
        if held < 0 or value[i] < value[held]:
            best[place[i]] = i
    return best[best >= 0]


@jit_arrays
def support_lines(t: Array, values: Array, centre: float) -> Array:
    """(R, 2) height at `centre` and slope of the highest line below each row of `values` (R, N); t: (N,) ascending.

    That line is the edge of the lower convex hull over `centre` (Andrew's monotone chain). Where `centre` is the mean
    of t it has the smallest sum of distances, which makes it the most likely one for delays that are exponential.
    """
    lines = np.zeros((values.shape[0], 2))
    hull = np.empty(t.size, np.int64)
    for r in range(values.shape[0]):
        d = values[r]
        m = 0
        for i in range(t.size):
            while m >= 2 and (d[hull[m - 1]] - d[hull[m - 2]]) * (t[i] - t[hull[m - 2]]) >= (d[i] - d[hull[m - 2]]) * (
                t[hull[m - 1]] - t[hull[m - 2]]
            ):
                m -= 1
            hull[m] = i
            m += 1
        lines[r, 0] = d[hull[0]]
        for k in range(m - 1):
            left, right = hull[k], hull[k + 1]
            if t[right] >= centre and t[right] > t[left]:
                lines[r, 1] = (d[right] - d[left]) / (t[right] - t[left])
                lines[r, 0] = d[left] + lines[r, 1] * (centre - t[left])
                break
    return lines
