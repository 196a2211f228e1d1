"""Equation error in the frequency domain for one axis, from recursive transforms of its columns.

Samples are taken in windows of 10 s, whose lines at whole multiples of 0.1 Hz are orthogonal. A full window's products
are added up and its transforms begin anew; the open window counts as it stands. So nothing is lost between
the lines however long the flight is, and products of each line are kept, by which residuals are known line by line.
White noise of a vane, whose size the samples themselves tell, adds a known power to the regressors' own: it is taken
off, else it would make every derivative too small.
Sources: Morelli, AIAA-99-4043; Klein & Morelli, chapter 7; W. A. Fuller, "Measurement Error Models", 1987, 2.2
(known error variances); H. White, Econometrica 48, 1980.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.flight import Array
from sysid.live.fourier import RecursiveFourier
from sysid.live.lines import weighted
from sysid.structure import PRIOR_SHARE, usual_size

WINDOW_S = 10.0
HIGHEST_HZ = 2.5
_LEAST_S = 1.0
VANES = ("alpha", "beta")


@dataclass(frozen=True)
class Estimate:
    """Coefficients of one axis. names: P. values, std: (P,). correlation: (P, P). moved: (P,) rms of each regressor."""

    names: tuple[str, ...]
    values: Array
    covariance: Array
    correlation: Array
    moved: Array

    @property
    def std(self) -> Array:
        """(P,) standard errors."""
        return np.sqrt(np.diag(self.covariance))


class AxisEstimator:
    """Takes the columns of `LiveEquations` for one axis and gives its coefficients at any time.

    names: the terms' coefficients, the constant's among them. noisy: for each, which vane's or gyro's noise is in it
    ("" none).
    biases: sensor errors whose columns follow those of the terms; how large they are the caller knows.
    """

    def __init__(
        self, names: Sequence[str], noisy: Sequence[str], interval_s: float, biases: Sequence[str] = ()
    ) -> None:
        self.biases = tuple(biases)
        self.names = tuple(names)
        self.noisy = tuple(noisy)
        self._size = round(WINDOW_S / interval_s)
        self._interval_s = interval_s
        lines = np.arange(0, round(HIGHEST_HZ * WINDOW_S) + 1)
        self._frequencies = lines / (self._size * interval_s)
        self._width = len(names) + len(biases) + 2
        self._fourier = RecursiveFourier(self._frequencies, interval_s, self._width)
        self._moving = [i for i, name in enumerate(names) if not name.endswith("_0")]
        # What does not change from one estimate to the next. The constant is a nuisance in the lines: it matters only
        # in the open window.
        self._chosen = [*self._moving, *range(len(names), self._width - 1)]
        self._square = np.ix_(self._moving, self._moving)
        rest = [0.0] * (len(biases) + 1)
        self._vane = np.array([self.noisy[i] in VANES for i in self._moving] + [False] * len(rest))
        self._sizes = np.array([usual_size(names[i]) for i in self._moving] + rest)
        self._doubts = [PRIOR_SHARE * usual_size(names[i]) for i in self._moving]
        self.restart()

    def restart(self) -> None:
        """Forget all samples."""
        self._fourier.restart()
        self._products = np.zeros((self._frequencies.size, self._width, self._width))
        self._sums = np.zeros(self._width)
        self._squares = np.zeros(self._width)
        self._windows = 0
        self._count = 0
        self._weights = 0.0

    @property
    def seconds(self) -> float:
        """Time that the samples cover."""
        return self._count * self._interval_s

    def add(self, columns: Array) -> None:
        """Take (K, P + B + 2) columns: terms, biases, weight, left side."""
        self._sums += columns.sum(axis=0)
        self._squares += np.sum(columns**2, axis=0)
        self._weights += float(np.sum(columns[:, -2] ** 2))
        self._count += columns.shape[0]
        while columns.shape[0]:
            room = self._size - self._fourier.count
            self._fourier.add(columns[:room])
            columns = columns[room:]
            if self._fourier.count == self._size:
                self._products += _products(self._fourier.values)
                self._windows += 1
                self._fourier.restart()

    def estimate(
        self, noise: Mapping[str, float], biases: Mapping[str, tuple[float, float]] | None = None
    ) -> Estimate | None:
        """Coefficients now; None in the first second.

        noise: vane (rad^2) or nondimensional rate -> variance of its white noise; only a vane's is taken off. biases:
        sensor error -> value and standard error, which the coefficients' errors then hold; one that is not given
        counts as 0.
        """
        if self.seconds < _LEAST_S:
            return None
        products = self._products + _products(self._fourier.values)
        chosen, left = self._chosen, self._width - 1
        used = products[1:, chosen]
        X, y = used[:, :, chosen], np.ascontiguousarray(used[:, :, left])
        power = np.ascontiguousarray(products[1:, left, left])
        rest = [0.0] * (len(self.biases) + 1)
        error = np.array([self._weights * noise.get(self.noisy[i], 0.0) for i in self._moving] + rest)
        known = [(biases or {}).get(name, (0.0, 1e-9)) for name in self.biases]
        doubts = [*self._doubts, *(std for _, std in known), 100.0]
        mean = np.array([0.0] * len(self._moving) + [value for value, _ in known] + [0.0])
        theta, covariance = weighted(
            np.ascontiguousarray(X), y, power, np.where(self._vane, error, 0.0), np.where(self._vane, 0.0, error),
            self._sizes, self._frequencies[1:], self._count / self._size, mean, np.array(doubts),
        )  # fmt: skip
        return self._with_constant(chosen[:-1], theta[:-1], covariance[:-1, :-1])

    def _with_constant(self, chosen: list[int], theta: Array, covariance: Array) -> Estimate:
        """With the constant, from the means."""
        moving, count, free = self._moving, len(self.names), len(self._moving)
        values, full = np.zeros(count), np.zeros((count, count))
        values[moving] = theta[:free]
        full[self._square] = covariance[:free, :free]
        ones = self._sums[-2]
        means = self._sums[chosen] / ones
        for i in set(range(count)) - set(moving):
            values[i] = self._sums[-1] / ones - means @ theta
            cross = -covariance @ means
            full[i, moving] = full[moving, i] = cross[:free]
            full[i, i] = means @ covariance @ means
        scale = np.sqrt(np.maximum(np.diag(full), 1e-300))
        spread = self._squares[:count] / self._count - (self._sums[:count] / self._count) ** 2
        moved = np.sqrt(np.maximum(spread, 0.0))
        return Estimate(self.names, values, full, full / np.outer(scale, scale), moved)

    def mean(self) -> Array:
        """(P + 2,) means of the columns over the mean weight."""
        return np.asarray(self._sums / self._sums[-2])


def _products(values: np.ndarray) -> Array:
    """(M, n, n) real products of the transforms at each line."""
    return np.asarray(np.einsum("mi,mj->mij", values.conj(), values).real)
