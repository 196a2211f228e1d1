"""Samples moved in time by parts of an interval."""

from __future__ import annotations

import numpy as np

from sysid.arrays import Array


def read_later(values: Array, delay: float, interval: float) -> Array:
    """Reading at sample k + delay / interval: shifted, by parts of a sample along the cubic through four.

    Values at the ends are repeated; NaN makes its neighbours NaN where parts of a sample are asked for.

    Parameters
    ----------
    values : Array, shape (N,) or (N, K)
        Uniform samples, each column in its own unit.
    delay : float
        Time by which the signal is read later, s.
    interval : float
        Sample interval, s.

    Returns
    -------
    Array, shape (N,) or (N, K)
        Shifted samples, shape and units of `values`.
    """
    place = delay / interval
    whole = int(np.floor(place + 1e-9))
    part = max(place - whole, 0.0)
    # The ends repeated far enough, so that all neighbours are slices.
    count = values.shape[0]
    moved = min(max(whole, -count - 2), count + 1)
    edge = abs(moved) + 2
    ends = np.concatenate([np.repeat(values[:1], edge, axis=0), values, np.repeat(values[-1:], edge, axis=0)])

    def near(offset: int) -> Array:
        taken: Array = ends[edge + moved + offset :][:count]
        return taken

    if part < 1e-6:
        return near(0).copy()
    return (
        -part * (part - 1.0) * (part - 2.0) / 6.0 * near(-1)
        + (part + 1.0) * (part - 1.0) * (part - 2.0) / 2.0 * near(0)
        - (part + 1.0) * part * (part - 2.0) / 2.0 * near(1)
        + (part + 1.0) * part * (part - 1.0) / 6.0 * near(2)
    )


def held_back(values: Array, delay: float, interval: float) -> Array:
    """Commands as they act when the aircraft follows late: the mean of what is held in each interval.

    Parameters
    ----------
    values : Array, shape (N,) or (N, K)
        Commands held from each sample to the next, each column in its own unit.
    delay : float
        Time by which the aircraft follows late, s.
    interval : float
        Sample interval, s.

    Returns
    -------
    Array, shape (N,) or (N, K)
        Delayed commands, shape and units of `values`; the first value is repeated before the beginning.
    """
    place = delay / interval
    whole = int(np.floor(place + 1e-9))
    part = max(place - whole, 0.0)
    index = np.arange(values.shape[0]) - whole
    now = values[np.clip(index, 0, values.shape[0] - 1)]
    before = values[np.clip(index - 1, 0, values.shape[0] - 1)]
    mixed: Array = (1.0 - part) * now + part * before
    return mixed
