"""How far the commands follow what a model leaves: an autopilot, or a pilot, who answers gusts with the surfaces.

Direct estimates from a closed loop mix the aircraft with the inverse of what flies it, by the share of the commands
that answers noise (Soderstrom, Gustavsson & Ljung, Int. J. Control 21, 1975): the share is what bars must hold.
"""

from __future__ import annotations

import numpy as np

from sysid.arrays import Array
from sysid.posterior.inputs import InputSignal
from sysid.posterior.observations import CommonGrid

# A shorter part cannot tell an answer from chance, s.
SHORTEST_LOOP_S = 20.0
# Share of a command's variance, beyond chance, below which it follows nothing.
_LEAST_SHARE = 0.05
# The causal filter: steps and memory, s, and its ridge.
_STEP_S, _MEMORY_S, _RIDGE = 0.06, 0.9, 0.02


def feedback_share(command: InputSignal, residual: Array, common: CommonGrid) -> float:
    """Share of a command's variance that a causal filter of the residuals (m, K) explains, 0 to 1.

    Adjusted for chance, by which many lags explain a part of anything.
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
    u = command.at(common.points[::every])
    off = u - u.mean()
    power = float(off @ off)
    if count < 2 * A.shape[1] or power == 0.0:
        return 0.0
    weights = np.linalg.solve(A.T @ A + _RIDGE * count * np.eye(A.shape[1]), A.T @ off)
    left = off - A @ weights
    adjusted = 1.0 - float(left @ left) / power / (1.0 - A.shape[1] / count)
    return adjusted if adjusted > _LEAST_SHARE else 0.0
