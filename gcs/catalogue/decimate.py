"""Thinning a signal for plotting so that no peak is lost."""

from __future__ import annotations

import numpy as np

from sysid.arrays import Array


def decimate(time_s: Array, values: Array, points: int) -> tuple[Array, Array]:
    """About `points` samples of a signal, the smallest and the largest of each stretch, in the order of time.

    time_s, values: (N,) with NaN where there is no value. Returns both as they are if N <= points.
    """
    count = time_s.size
    if count <= points:
        return time_s, values
    edges = np.linspace(0, count, max(points // 2, 1) + 1).astype(np.int64)
    low = np.where(np.isnan(values), np.inf, values)
    high = np.where(np.isnan(values), -np.inf, values)
    keep: list[int] = []
    for start, stop in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        first, second = start + int(np.argmin(low[start:stop])), start + int(np.argmax(high[start:stop]))
        keep.extend((min(first, second), max(first, second)) if first != second else (first,))
    return time_s[keep], values[keep]
