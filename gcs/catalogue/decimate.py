"""Thinning a signal for plotting so that no peak is lost."""

from __future__ import annotations

import itertools

import numpy as np

from sysid.arrays import Array


def decimate(time_s: Array, values: Array, points: int) -> tuple[Array, Array]:
    """About `points` samples of a signal, the smallest and the largest of each stretch, in the order of time.

    time_s, values: (N,) with NaN where there is no value; where they are mapped from a file, no more than a stretch of
    them is in memory at a time. Returns both as they are if N <= points.
    """
    count = time_s.size
    if count <= points:
        return time_s, values
    edges = np.linspace(0, count, max(points // 2, 1) + 1).astype(np.int64).tolist()
    keep: list[int] = []
    for start, stop in itertools.pairwise(edges):
        stretch = np.asarray(values[start:stop])
        missing = np.isnan(stretch)
        if missing.any():
            low = int(np.argmin(np.where(missing, np.inf, stretch)))
            high = int(np.argmax(np.where(missing, -np.inf, stretch)))
        else:
            low, high = int(np.argmin(stretch)), int(np.argmax(stretch))
        keep.extend((start + min(low, high), start + max(low, high)) if low != high else (start + low,))
    return time_s[keep], values[keep]
