"""Commands of a closed loop without what they owe to the residuals."""

from __future__ import annotations

import numpy as np

from sysid.arrays import Array
from sysid.posterior.inputs import InputSignal
from sysid.posterior.observations import CommonGrid

# On a shorter part the filter would take the whole command away, s.
SHORTEST_LOOP_S = 40.0
# Share of a command's variance explained by residuals, beyond chance, from which on it follows them.
FOLLOWS = 0.05
# The causal filter: steps and memory, s, and its ridge.
_STEP_S, _MEMORY_S, _RIDGE = 0.06, 1.5, 0.02


def cleaned(command: InputSignal, residual: Array, common: CommonGrid) -> tuple[InputSignal, float]:
    """The command less what a causal filter of the residuals (m, K) explains, and the share of it that this is.

    The share is adjusted for chance: many lags explain a part of anything.
    """
    every = max(1, round(_STEP_S / common.interval_s))
    lags = max(2, round(_MEMORY_S / (every * common.interval_s)))
    inner = residual[:, common.taper > 0.5]
    scale = np.maximum(inner.std(axis=1, keepdims=True), 1e-12)
    # Means over the samples up to each moment: causal, and no frequency folds down.
    normal = (residual - inner.mean(axis=1, keepdims=True)) / scale * common.taper
    kernel = np.ones(every) / every
    means = np.stack([np.convolve(row, kernel)[: row.size] for row in normal])[:, ::every]
    count = means.shape[1]
    A = np.zeros((count, residual.shape[0] * lags))
    for lag in range(lags):
        A[lag:, lag::lags] = means[:, : count - lag].T
    times = common.points[::every]
    u = command.at(times)
    off = u - u.mean()
    weights = np.linalg.solve(A.T @ A + _RIDGE * count * np.eye(A.shape[1]), A.T @ off)
    explained = A @ weights
    power = float(off @ off)
    share = 1.0 - float((off - explained) @ (off - explained)) / max(power, 1e-300)
    chance = A.shape[1] / max(count - 1, 1)
    adjusted = 1.0 - (1.0 - share) / max(1.0 - chance, 0.05)
    values = command.at(common.points) - np.interp(common.points, times, explained)
    return InputSignal(common.points, values, "joined"), adjusted
