"""Dryden turbulence as a linear system driven by white noise: what a Kalman filter takes as process noise.

MIL-F-8785C, 3.7.1.2, in body axes: u passes a first-order filter, v and w a second-order one, all of one scale length.
Discretised exactly, so that variance and correlation hold for any sample interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Array

DEFAULT_LENGTH_M = 30.0  # of gusts, m, near the ground


@dataclass(frozen=True)
class Turbulence:
    """Intensities of the horizontal and the vertical gusts, m/s, and their scale length, m."""

    horizontal: float = 0.0
    vertical: float = 0.0
    length: float = DEFAULT_LENGTH_M

    @property
    def calm(self) -> bool:
        """Whether there is none."""
        return self.horizontal == 0.0 and self.vertical == 0.0


@dataclass(frozen=True)
class GustSystem:
    """n filter states, m/s, for the chosen body axes.

    transition: (n, n) per step; process: (n, n) covariance that a step adds; stationary: (n, n) covariance of the
    states; output: (axes, n) gusts from states.
    """

    transition: Array
    process: Array
    stationary: Array
    output: Array


def gust_system(turbulence: Turbulence, axes: Sequence[int], airspeed: float, interval_s: float) -> GustSystem:
    """Filters of the body axes `axes` (0, 1, 2 for u, v, w) at `airspeed` [m/s], one step being `interval_s`."""
    step = interval_s * airspeed / turbulence.length
    decay = float(np.exp(-step))
    # Block by block: a small matrix that scipy puts together takes longer than a sample's filter.
    size = sum(1 if axis == 0 else 2 for axis in axes)
    transition, covariance, output = np.zeros((size, size)), np.zeros((size, size)), np.zeros((len(axes), size))
    place = 0
    for row, axis in enumerate(axes):
        sigma = turbulence.vertical if axis == 2 else turbulence.horizontal
        if axis == 0:
            transition[place, place], covariance[place, place], output[row, place] = decay, sigma**2, 1.0
            place += 1
        else:
            both = slice(place, place + 2)
            transition[both, both] = decay * np.array([[1.0, 0.0], [step, 1.0]])
            covariance[both, both] = sigma**2 * np.array([[0.5, 0.25], [0.25, 0.25]])
            output[row, both] = np.sqrt(3.0), 1.0 - np.sqrt(3.0)
            place += 2
    process = covariance - transition @ covariance @ transition.T
    return GustSystem(transition, 0.5 * (process + process.T), covariance, output)
