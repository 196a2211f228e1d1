"""Measurements with their own stamps: what a simulation on an even grid is compared with, message by message.

Nothing is put onto another sensor's time base before it is compared. A simulated series is read at each message's own
stamps (four-point Lagrange interpolation); what is left there is put on a common grid for its spectrum. Both are one
sparse matrix, and residuals and sensitivities go through the same one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from sysid.arrays import Array
from sysid.posterior.inputs import unbroken

# Behind a burst of lost samples the residual is not counted for so long, s: what the commands lost in it did swings on,
# a Dutch roll of small aircraft by 1 to 2 % after 2.5 s. Where bursts are so many that less than half of a part would
# be left, for less long.
AFTER_GAPS_S = (2.5, 1.2, 0.5)
# A message that is missing for longer than this is a burst, s.
_BURST_S = 0.2


@dataclass(frozen=True)
class Channel:
    """One measured output of a part. time_s, values: (M,) on its own stamps, finite."""

    output: str
    time_s: Array
    values: Array


def bursts(time_s: Array) -> list[tuple[float, float]]:
    """Where a message is missing for longer than its rate explains: begin and end, s."""
    return [
        (float(time_s[one - 1]), float(time_s[one]))
        for one, _ in unbroken(time_s)[1:]
        if time_s[one] - time_s[one - 1] > _BURST_S
    ]


def read_at(grid: Array, stamps: Array) -> sparse.csr_array:
    """(M, N) four-point Lagrange interpolation of a series on an even grid at stamps within it."""
    dt, n = float(grid[1] - grid[0]), grid.size
    position = np.clip((stamps - grid[0]) / dt, 0.0, n - 1.0)
    first = np.clip(np.floor(position).astype(np.int64) - 1, 0, n - 4)
    t = position - first
    weights = (
        -(t - 1.0) * (t - 2.0) * (t - 3.0) / 6.0,
        t * (t - 2.0) * (t - 3.0) / 2.0,
        -t * (t - 1.0) * (t - 3.0) / 2.0,
        t * (t - 1.0) * (t - 2.0) / 6.0,
    )
    rows = np.repeat(np.arange(stamps.size), 4)
    columns = (first[:, None] + np.arange(4)).ravel()
    return sparse.csr_array((np.stack(weights, axis=1).ravel(), (rows, columns)), shape=(stamps.size, n))


def joined_at(stamps: Array, points: Array) -> sparse.csr_array:
    """(K, M) straight lines between values at stamps, read at points; constant beyond the ends."""
    last = np.clip(np.searchsorted(stamps, points, side="right"), 1, stamps.size - 1)
    share = np.clip((points - stamps[last - 1]) / np.maximum(stamps[last] - stamps[last - 1], 1e-12), 0.0, 1.0)
    rows = np.repeat(np.arange(points.size), 2)
    columns = np.stack((last - 1, last), axis=1).ravel()
    values = np.stack((1.0 - share, share), axis=1).ravel()
    return sparse.csr_array((values, (rows, columns)), shape=(points.size, stamps.size))


@dataclass(frozen=True)
class CommonGrid:
    """The even grid on which residuals are compared. counted: (K,) whether a point counts; taper: (K,) of the ends."""

    points: Array
    counted: Array
    taper: Array

    @property
    def interval_s(self) -> float:
        """Step, s."""
        return float(self.points[1] - self.points[0])

    @property
    def duration_s(self) -> float:
        """Length, s."""
        return self.interval_s * self.points.size

    def bridged(self, matrix: sparse.csr_array) -> sparse.csr_array:
        """The matrix to this grid with what does not count replaced by lines between what does."""
        if self.counted.all():
            return matrix
        kept = np.flatnonzero(self.counted)
        return sparse.csr_array(joined_at(self.points[kept], self.points) @ matrix[kept])


def common_grid(
    begin: float, end: float, interval_s: float, lost: list[tuple[float, float]], rise: float
) -> CommonGrid:
    """Grid from begin to end, points in bursts of lost samples (begin, end) left out; rise: of the taper, s."""
    count = int((end - begin) / interval_s)
    points: Array = begin + interval_s * np.arange(_smooth_size(count), dtype=np.float64)
    counted = np.ones(points.size, dtype=bool)
    for after in AFTER_GAPS_S:
        counted[:] = True
        for first, last in lost:
            counted &= ~((points > first - 0.02) & (points < last + after))
        if 2 * np.count_nonzero(counted) >= points.size:
            break
    if np.count_nonzero(counted) < 4:
        counted[:] = True
    edge = max(2, min(round(rise / interval_s), points.size // 8))
    taper = np.ones(points.size)
    ramp = 0.5 - 0.5 * np.cos(np.pi * (np.arange(edge) + 0.5) / edge)
    taper[:edge], taper[-edge:] = ramp, ramp[::-1]
    return CommonGrid(points, counted, taper)


def _smooth_size(count: int) -> int:
    """Largest number up to `count` without prime factors above 5, for the Fourier transform."""
    while count > 8:
        left = count
        for factor in (2, 3, 5):
            while left % factor == 0:
                left //= factor
        if left == 1:
            break
        count -= 1
    return count
