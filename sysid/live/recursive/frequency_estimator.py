"""Equation error in the frequency domain for one axis, from recursive transforms of its columns.

Samples are taken in windows of 10 s, whose lines at whole multiples of 0.1 Hz are orthogonal. A full window's products
are added up and its transforms begin anew; the open window counts as it stands. So nothing is lost between
the lines however long the flight is, and products of each line are kept, by which residuals are known line by line.
White noise of a vane, whose size is estimated from the samples themselves, adds a known power to the regressors' own:
it is taken off, else it would make every derivative too small.
Sources: Morelli, AIAA-99-4043; Klein & Morelli, chapter 7; W. A. Fuller, "Measurement Error Models", 1987, 2.2
(known error variances); H. White, Econometrica 48, 1980.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim_vehicle.jit import jit, jit_inlined
from sysid.arrays import Array, IntArray
from sysid.live.recursive.recursive_fourier import Complex, RecursiveFourier
from sysid.live.recursive.spectral_least_squares import weighted
from sysid.problem.model_structure import PRIOR_WIDTH, usual_size

# Of the Fourier sums, s: lines lie 1/WINDOW_S apart; up to HIGHEST_HZ; from LEAST_S of flight on.
WINDOW_S = 10.0
HIGHEST_HZ = 2.5
_LEAST_S = 1.0
VANES = ("alpha", "beta")


@dataclass(frozen=True)
class CoefficientEstimates:
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
        self._moving = np.array([i for i, name in enumerate(names) if not name.endswith("_0")], np.int64)
        # What does not change from one estimate to the next. The constant is a nuisance in the lines: it matters only
        # in the open window.
        self._chosen = np.array([*self._moving, *range(len(names), self._width - 1)], np.int64)
        rest = [0.0] * (len(biases) + 1)
        self._vane = np.array([self.noisy[i] in VANES for i in self._moving] + [False] * len(rest))
        self._sizes = np.array([usual_size(names[i]) for i in self._moving] + rest)
        self._doubts = [PRIOR_WIDTH * usual_size(names[i]) for i in self._moving]
        self.restart()

    def restart(self) -> None:
        """Forget all samples."""
        self._fourier.restart()
        self._products = np.zeros((self._frequencies.size, self._width, self._width))
        self._sums = np.zeros(self._width)
        self._squares = np.zeros(self._width)
        self._count = 0

    @property
    def seconds(self) -> float:
        """Time that the samples cover."""
        return self._count * self._interval_s

    def add(self, columns: Array) -> None:
        """Take (K, P + B + 2) columns: terms, biases, weight, left side."""
        columns = np.ascontiguousarray(columns)
        _add_sums(columns, self._sums, self._squares)
        self._count += columns.shape[0]
        while columns.shape[0]:
            room = self._size - self._fourier.count
            self._fourier.add(columns[:room])
            columns = columns[room:]
            if self._fourier.count == self._size:
                _add_products(self._fourier.values, self._products)
                self._fourier.restart()

    def estimate(
        self, noise: Mapping[str, float], biases: Mapping[str, tuple[float, float]] | None = None
    ) -> CoefficientEstimates | None:
        """Coefficients now; None in the first second.

        noise: vane (rad^2) or nondimensional rate -> variance of its white noise; only a vane's is taken off. biases:
        sensor error -> value and standard error, which the coefficients' errors then hold; one that is not given
        counts as 0.
        """
        if self.seconds < _LEAST_S:
            return None
        lines, size = self._frequencies.size - 1, self._chosen.size
        X, y, power = np.empty((lines, size, size)), np.empty((lines, size)), np.empty(lines)
        _gather(self._products, self._fourier.values, self._chosen, X, y, power)
        rest = [0.0] * (len(self.biases) + 1)
        weights = self._squares[-2]
        error = np.array([weights * noise.get(self.noisy[i], 0.0) for i in self._moving] + rest)
        known = [(biases or {}).get(name, (0.0, 1e-9)) for name in self.biases]
        doubts = [*self._doubts, *(std for _, std in known), 100.0]
        mean = np.array([0.0] * len(self._moving) + [value for value, _ in known] + [0.0])
        theta, covariance = weighted(
            X, y, power, np.where(self._vane, error, 0.0), np.where(self._vane, 0.0, error),
            self._sizes, self._frequencies[1:], self._count / self._size, mean, np.array(doubts),
        )  # fmt: skip
        return self._with_constant(theta, covariance)

    def _with_constant(self, theta: Array, covariance: Array) -> CoefficientEstimates:
        """With the constant, from the means. theta, covariance: of the chosen columns, the weight's last."""
        count = len(self.names)
        values, full, correlation = np.zeros(count), np.zeros((count, count)), np.empty((count, count))
        moved = np.empty(count)
        _complete(
            theta, covariance, self._chosen, self._moving.size, self._sums, self._squares, self._count,
            values, full, correlation, moved,
        )  # fmt: skip
        return CoefficientEstimates(self.names, values, full, correlation, moved)


@jit_inlined
def _product(values: Complex, m: int, i: int, j: int) -> float:
    """Of two columns' transforms at a line, the real part of one times the other's conjugate."""
    return float(values[m, i].real * values[m, j].real + values[m, i].imag * values[m, j].imag)


@jit
def _add_sums(columns: Array, sums: Array, squares: Array) -> None:
    for k in range(columns.shape[0]):
        for i in range(columns.shape[1]):
            sums[i] += columns[k, i]
            squares[i] += columns[k, i] ** 2


@jit
def _add_products(values: Complex, products: Array) -> None:
    """Add the products (M, n, n) of the transforms (M, n) at each line."""
    for m in range(values.shape[0]):
        for i in range(values.shape[1]):
            for j in range(values.shape[1]):
                products[m, i, j] += _product(values, m, i, j)


@jit
def _gather(products: Array, values: Complex, chosen: IntArray, X: Array, y: Array, power: Array) -> None:
    """Products of all windows, the open one among them, of the chosen columns and the last, at all lines but one."""
    last = values.shape[1] - 1
    for m in range(1, values.shape[0]):
        for a in range(chosen.size):
            for b in range(chosen.size):
                i, j = chosen[a], chosen[b]
                X[m - 1, a, b] = products[m, i, j] + _product(values, m, i, j)
            y[m - 1, a] = products[m, chosen[a], last] + _product(values, m, chosen[a], last)
        power[m - 1] = products[m, last, last] + _product(values, m, last, last)


@jit
def _complete(
    theta: Array, covariance: Array, chosen: IntArray, free: int, sums: Array, squares: Array, count: int,
    values: Array, full: Array, correlation: Array, moved: Array,
) -> None:  # fmt: skip
    """Values and covariance of all coefficients from those of the chosen columns, whose first `free` are coefficients.

    The others are constants: what is left of the left side's mean.
    """
    size, ones = values.size, sums[sums.size - 2]
    constant = sums[sums.size - 1] / ones
    for a in range(chosen.size - 1):
        constant -= sums[chosen[a]] / ones * theta[a]
    for i in range(size):
        values[i] = constant
    for a in range(free):
        values[chosen[a]] = theta[a]
        for b in range(free):
            full[chosen[a], chosen[b]] = covariance[a, b]
    place = 0
    for i in range(size):
        if place < free and chosen[place] == i:
            place += 1
            continue
        for a in range(chosen.size - 1):
            cross = 0.0
            for b in range(chosen.size - 1):
                cross -= covariance[a, b] * sums[chosen[b]] / ones
            full[i, i] -= cross * sums[chosen[a]] / ones
            if a < free:
                full[i, chosen[a]] = full[chosen[a], i] = cross
    for i in range(size):
        moved[i] = np.sqrt(max(squares[i] / count - (sums[i] / count) ** 2, 0.0))
        for j in range(size):
            correlation[i, j] = full[i, j] / np.sqrt(max(full[i, i], 1e-300) * max(full[j, j], 1e-300))
