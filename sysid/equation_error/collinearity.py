"""Which regressors a flight cannot distinguish: condition indices with variance proportions, and variance inflation.

Source: D. A. Belsley, E. Kuh, R. E. Welsch, "Regression Diagnostics", Wiley 1980, chapter 3: columns scaled to unit
length and not centred; an index above 30 with two or more proportions above one half is harmful.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Array
from sysid.errors import EstimationError
from sysid.numerics.normal_equations import inverse

# Condition index and share of variance from which collinearity harms (Belsley, Kuh & Welsch 1980); variance
# inflation and correlation that are called high.
HARMFUL_INDEX = 30.0
HARMFUL_SHARE = 0.5
HIGH_VIF = 10.0
HIGH_CORRELATION = 0.9


@dataclass(frozen=True)
class Collinearity:
    """Diagnostics of P regressors.

    indices: (P,) condition indices, ascending. proportions: (P, P), row k the shares of each estimate's variance that
    stand with index k; every column sums to 1. vif: (P,) variance inflation about the constant term.
    """

    names: tuple[str, ...]
    indices: Array
    proportions: Array
    vif: Array

    @property
    def condition(self) -> float:
        """The largest condition index."""
        return float(self.indices[-1])

    def groups(self) -> list[tuple[float, tuple[str, ...]]]:
        """Harmful dependencies: condition index and the regressors that take part in each, worst first."""
        found = []
        for index, shares in zip(self.indices[::-1], self.proportions[::-1], strict=True):
            members = tuple(name for name, share in zip(self.names, shares, strict=True) if share > HARMFUL_SHARE)
            if index >= HARMFUL_INDEX and len(members) > 1:
                found.append((float(index), members))
        return found

    def words(self) -> list[str]:
        """What a reader should know, one line each; empty where all can be distinguished."""
        lines = [
            f"{', '.join(members)} move together (condition index {index:.0f}): their sum is identifiable, each alone "
            "hardly"
            for index, members in self.groups()
        ]
        collinear = {name for _, members in self.groups() for name in members}
        lines += [
            f"{name} is nearly a combination of the other regressors (variance inflation {vif:.0f})"
            for name, vif in zip(self.names, self.vif, strict=True)
            if vif > HIGH_VIF and name not in collinear
        ]
        return lines


def collinearity(X: Array, names: Sequence[str], constant: int | None = None) -> Collinearity:
    """Diagnostics of regressors X (N, P).

    constant: column of the constant term, whose part in the others is no inflation; None if there is none.
    Raises EstimationError for a column of zeros or columns that are not finite.
    """
    length = np.sqrt(np.sum(X**2, axis=0))
    if not np.isfinite(length).all() or np.any(length == 0.0):
        raise EstimationError(f"collinearity: a regressor of {', '.join(names)} is zero throughout or not finite")
    singular, Vt = np.linalg.svd(X / length, full_matrices=False)[1:]
    singular = np.maximum(singular, 1e-15 * singular[0])
    phi = (Vt.T / singular) ** 2
    proportions = (phi / phi.sum(axis=1, keepdims=True)).T
    return Collinearity(tuple(names), singular[0] / singular, proportions, _inflation(X / length, constant))


def _inflation(X: Array, constant: int | None) -> Array:
    """1 / (1 - R_j^2), R_j of column j on the others with the constant's part taken off both."""
    vif = np.ones(X.shape[1])
    others = [j for j in range(X.shape[1]) if j != constant]
    rest = X[:, others]
    if constant is not None:
        one = X[:, constant]
        rest = rest - np.outer(one, one @ rest)
    size = np.sqrt(np.sum(rest**2, axis=0))
    moving = size > 1e-10
    if np.count_nonzero(moving) > 1:
        scaled = rest[:, moving] / size[moving]
        vif[np.array(others)[moving]] = np.diag(inverse(scaled.T @ scaled))
    return vif


def correlated_pairs(names: Sequence[str], correlation: Array) -> list[tuple[str, str, float]]:
    """Pairs of estimates whose errors are correlated beyond HIGH_CORRELATION, strongest first."""
    pairs = [
        (names[i], names[j], float(correlation[i, j]))
        for i in range(len(names))
        for j in range(i)
        if abs(correlation[i, j]) > HIGH_CORRELATION
    ]
    return sorted(pairs, key=lambda pair: -abs(pair[2]))
