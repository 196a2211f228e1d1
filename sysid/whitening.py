"""Whitening of coloured series by an autoregression."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.flight import Array


def autoregression(series: Sequence[Array], order: int) -> Array:
    """Whitening filter (order + 1,) 1, -a1, -a2 ... of pooled series, by the Yule-Walker equations."""
    count = sum(one.size for one in series)
    covariance = np.array([
        sum(float(one[lag:] @ one[: one.size - lag]) for one in series if one.size > lag) / count
        for lag in range(order + 1)
    ])  # fmt: skip
    if covariance[0] <= 0.0:
        return np.concatenate(([1.0], np.zeros(order)))
    # A little white noise keeps the equations solvable for a series without any.
    covariance[0] *= 1.0 + 1e-9
    places = np.abs(np.subtract.outer(np.arange(order), np.arange(order)))
    weights = np.linalg.solve(covariance[places], covariance[1:])
    return np.concatenate(([1.0], -weights))


def whiten(values: Array, taps: Array) -> Array:
    """(N,) or (N, P) passed through the whitening filter along the first axis; the first samples, half in, left out."""
    order = taps.size - 1
    if values.ndim == 1:
        return np.convolve(values, taps, mode="valid")
    white: Array = taps[0] * values[order:]
    for lag in range(1, order + 1):
        white = white + taps[lag] * values[order - lag : values.shape[0] - lag]
    return white
