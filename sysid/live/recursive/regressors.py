"""The columns of all terms of all axes at once, compiled: terms are many, samples of a turn few."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain

import numpy as np

from sim_vehicle.jit import jit
from sim_vehicle.model.aerodynamic_terms import MOTION, Term
from sysid.arrays import Array, IntArray
from sysid.equation_error.equations import MOMENTS
from sysid.live.signals.sample_buffer import Flags

# Mean over an interval by the cubic through the samples before, at both ends, and behind.
_MEAN = (-1.0 / 24.0, 13.0 / 24.0, 13.0 / 24.0, -1.0 / 24.0)
TAIL = 3


class Regressors:
    """Of terms by axis, in order. factors: names of what they multiply, F."""

    def __init__(self, terms: Mapping[str, Sequence[Term]]) -> None:
        chosen = list(chain.from_iterable(terms.values()))
        self.factors = tuple(dict.fromkeys(chain.from_iterable(term.factors for term in chosen)))
        longest = max((len(term.factors) for term in chosen), default=0)
        self._factors = np.full((len(chosen), longest + 1), -1)
        for i, term in enumerate(chosen):
            self._factors[i, : len(term.factors)] = [self.factors.index(name) for name in term.factors]
        self._over_interval = np.array([term.axis in MOMENTS for term in chosen], np.bool_)
        self._held = np.array([name not in MOTION for name in self.factors], np.bool_)

    def write(self, columns: Mapping[str, Array], weight: Array, bends: Mapping[str, Array], found: Array) -> None:
        """Write each term's column into found (T, N - 3), from factors and weight at N samples.

        Forces hold at samples, under the mean command of the interval before; moments over the intervals behind them,
        whose mean of a rate bends makes that much larger.
        """
        table = np.array([columns[name] for name in self.factors]).reshape(len(self.factors), weight.size)
        added = np.zeros((len(self.factors), weight.size - TAIL))
        for name, bend in bends.items():
            if name in self.factors:
                added[self.factors.index(name)] = bend
        _columns(table, weight, added, self._factors, self._over_interval, self._held, found)


@jit
def _columns(
    table: Array, weight: Array, bends: Array, factors: IntArray, over_interval: Flags, held: Flags, found: Array
) -> None:  # fmt: skip
    for i in range(factors.shape[0]):
        for k in range(found.shape[1]):
            if over_interval[i]:
                mean = 0.0
                for m in range(len(_MEAN)):
                    smooth = _MEAN[m] * weight[k + m]
                    for f in factors[i]:
                        if f >= 0 and not held[f]:
                            smooth *= table[f, k + m]
                    mean += smooth
                if factors[i, 0] >= 0 and factors[i, 1] < 0:
                    mean += bends[factors[i, 0], k] * weight[k + 1]
                product, at = mean, k + 2
            else:
                product, at = weight[k + 1], k + 1
                for f in factors[i]:
                    if f >= 0 and not held[f]:
                        product *= table[f, k + 1]
            for f in factors[i]:
                if f >= 0 and held[f]:
                    product *= table[f, at]
            found[i, k] = product


def means(values: Array) -> Array:
    """(N - 3,) means over the intervals that have a sample on each side."""
    return np.asarray(np.convolve(values, _MEAN[::-1], mode="valid"), dtype=np.float64)
