"""One pass of the kinematic filter over all parts of a flight, and the step of the sensor errors that it asks for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.arrays import Array
from sysid.compatibility.ekf import PARAMETERS, filter_part, smooth_part
from sysid.compatibility.ekf_part import Part
from sysid.errors import EstimationError
from sysid.numerics.parallel import side_by_side

Mask = NDArray[np.bool_]

_COUNT = len(PARAMETERS)
# Prior of the first state, wide on purpose, m/s and rad; length of gusts, m.
_START_VELOCITY, _START_ANGLE = 20.0, 0.5
_GUST_LENGTH_M = 30.0


@dataclass(frozen=True)
class Solution:
    """Result of one pass over all parts: information (18, 18) and gradient (18,) of all sensor errors summed over them,
    innovations and their variances (N, 9) of each part, smoothed deviations (N, 9) of each part.
    """

    likelihood: float
    information: Array
    gradient: Array
    innovations: list[Array]
    variances: list[Array]
    smoothed: list[Array]


@dataclass(frozen=True)
class ReconstructionSettings:
    """What a pass takes besides the nominal trajectory."""

    noise: Array
    q_imu: Array
    gust_sigma: float
    free: Mask
    mean: Array
    std: Array


def run_pass(
    parts: list[Part], theta: Array, setting: ReconstructionSettings, smooth: bool = False, slopes: bool = False
) -> Solution:
    """Filter every part with these sensor errors (18,), in the order of PARAMETERS; smooth backwards or take
    sensitivities on request. Raises EstimationError where the filter diverges.
    """
    p_start = np.diag([_START_VELOCITY**2] * 3 + [_START_ANGLE**2] * 3 + [setting.gust_sigma**2] * 3)
    likelihood, information, gradient = 0.0, np.zeros((_COUNT, _COUNT)), np.zeros(_COUNT)
    innovations, variances, smoothed = [], [], []

    def forward(part: Part) -> tuple[tuple[float, Array, Array, Array, Array], Array | None]:
        decay = float(np.exp(-part.dt * part.speed / _GUST_LENGTH_M))
        linear = part.linearised(theta)
        passed = filter_part(
            *(part.nominal, part.gusts, theta, *linear, part.z, setting.noise, setting.q_imu),
            *(np.array([setting.gust_sigma, decay]), p_start, smooth, slopes),
        )
        return passed[:5], smooth_part(*passed[3:], linear[1], linear[3], decay) if smooth else None

    for passed, backward in side_by_side(forward, parts):
        likelihood += passed[0]
        information += passed[1]
        gradient += passed[2]
        innovations.append(passed[3])
        variances.append(passed[4])
        if backward is not None:
            smoothed.append(backward)
    if not np.isfinite(likelihood):
        raise EstimationError("data compatibility diverged: check units, signs and sensor positions")
    return Solution(likelihood, information, gradient, innovations, variances, smoothed)


def step(solution: Solution, theta: Array, setting: ReconstructionSettings) -> tuple[Array, Array]:
    """Gauss-Newton step (P,) and covariance (P, P) of the free sensor errors."""
    free = np.flatnonzero(setting.free)
    unit = setting.std[free]
    # Scaled by the prior's standard deviations, whose units differ by orders of magnitude.
    information = solution.information[np.ix_(free, free)] * np.outer(unit, unit) + np.eye(free.size)
    covariance = np.linalg.inv(information) * np.outer(unit, unit)
    gradient = solution.gradient[free] + (setting.mean[free] - theta[free]) / unit**2
    return covariance @ gradient, covariance


def apply(parts: list[Part], solution: Solution) -> None:
    """Move every part's nominal trajectory to the smoothed one."""
    for part, smoothed in zip(parts, solution.smoothed, strict=True):
        part.nominal = part.nominal + smoothed[:, :6]
        part.gusts = part.gusts + smoothed[:, 6:]
