"""How much white noise a sensor's samples hold, from the samples alone."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sysid.arrays import Array

_MEMORY = 300  # rows
# Sum of the squares of the fourth difference's weights: the variance of white noise in it.
_FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
# Of the square of a normal variate, the median over the mean.
_MEDIAN_OF_SQUARES = 0.4549


@dataclass
class WhiteNoise:
    """Variance of a sensor's white noise, by the fourth difference, in which motion does not show.

    jumps: whether what is measured may bend from one sample to the next, as a rate does at a step of a command. Then
    the median estimates it.
    """

    jumps: bool = False
    tail: Array = field(default_factory=lambda: np.empty(0))
    recent: Array = field(default_factory=lambda: np.empty(0))
    variance: float = np.nan
    count: int = 0

    def take(self, values: Array, *, continues: bool) -> None:
        """Take samples, which follow those before or not."""
        joined = np.concatenate([self.tail, values]) if continues else values
        self.tail = joined[-4:]
        if joined.size < 5:
            return
        squares = np.convolve(joined, _FOURTH, mode="valid") ** 2 / float(_FOURTH @ _FOURTH)
        if self.jumps:
            self.recent = np.concatenate([self.recent, squares])[-_MEMORY:]
            self.variance = _median(self.recent) / _MEDIAN_OF_SQUARES
            return
        self.count += squares.size
        share = min(squares.size / min(self.count, _MEMORY), 1.0)
        mean = float(np.mean(squares))
        self.variance = mean if not np.isfinite(self.variance) else self.variance + share * (mean - self.variance)


def _median(values: Array) -> float:
    """As numpy's, which takes six times as long for so few."""
    low, high = (values.size - 1) // 2, values.size // 2
    ordered = np.partition(values, (low, high))
    return 0.5 * float(ordered[low] + ordered[high])
