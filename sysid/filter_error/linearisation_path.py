"""Where a record is linearised, and how that moves to where the filter runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.arrays import Array, IntArray

# rad of airflow and attitude over which readings are straight lines to a sensor's noise: what is bent, half the square,
# is 0.012 m/s2 of gravity and a thousandth of the airspeed, 0.02 m/s of a small aircraft's.
_LINEAR = 0.05


@dataclass
class Path:
    """Where a record is linearised: (N, 9) states u v w [m/s] p q r [rad/s] phi theta psi [rad] and (N, 3) gusts [m/s]
    before and after each sample.

    begin: (9,) the state expected before anything was read: the mean of what is known of the start, wherever the first
    readings are linearised.
    """

    before: Array
    after: Array
    gust_before: Array
    gust_after: Array
    begin: Array

    @classmethod
    def along(cls, states: Array) -> Path:
        """Through reconstructed states (N, 9), in calm air."""
        calm = np.zeros((states.shape[0], 3))
        return cls(states.copy(), states.copy(), calm, calm.copy(), states[0].copy())

    def copy(self) -> Path:
        """The same, free to move."""
        return Path(
            self.before.copy(), self.after.copy(), self.gust_before.copy(), self.gust_after.copy(), self.begin.copy()
        )

    @property
    def gust_over(self) -> Array:
        """(N - 1, 3) mean gust of each step, as far as it is known at its begin."""
        return 0.5 * (self.gust_after[:-1] + self.gust_before[1:])

    @property
    def begin_deviation(self) -> Array:
        """(9,) the state expected before anything was read, as a deviation from where that is linearised."""
        return apart(self.begin, self.before[0])

    def moved(self, free: IntArray, before: Array, after: Array) -> Path:
        """The path by deviations (N, nf) of its free states before and after each sample.

        Where the first readings give another airflow or attitude than they could be linearised over, they are
        linearised where they lead to, as an iterated Kalman filter does (B. M. Bell & F. W. Cathey, IEEE TAC 38(2),
        1993): what was known of the start stays as it was, and counts against them.
        """
        path = self.copy()
        path.before[:, free] += before
        path.after[:, free] += after
        path.before[0] = self.begin
        if _is_far(self.begin, path.after[0]):
            path.before[0, free] = path.after[0, free]
        return path


def apart(ahead: Array, behind: Array) -> Array:
    """(..., 9) differences of states, angles the short way round."""
    found = np.asarray(ahead - behind)
    for place in (6, 8):
        found[..., place] = (found[..., place] + np.pi) % (2.0 * np.pi) - np.pi
    return found


def _is_far(expected: Array, known: Array) -> bool:
    """Whether the state (9,) known after a sample has another airflow or attitude than a linear reading bears."""
    speed = max(float(np.linalg.norm(expected[:3])), 1.0)
    away = np.abs(apart(known, expected))
    return bool(np.max(away[:3]) > _LINEAR * speed or np.max(away[6:8]) > _LINEAR)
