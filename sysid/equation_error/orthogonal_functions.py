"""Multivariate orthogonal functions: a polynomial model found without guessing its terms.

Candidate columns are made orthogonal to each other one by one, so that what each takes off the squared error is known
for itself; the order is that of what they take, the number where the predicted square error (or the error on blocks
left out) is least. The functions chosen are turned back into ordinary terms, which a reader can judge.
Sources: E. A. Morelli, "Global nonlinear aerodynamic modeling using multivariate orthogonal functions", Journal of
Aircraft 32(2), 1995; Klein & Morelli, chapter 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sysid.arrays import Array
from sysid.equation_error.least_squares import RegressionResult, regress
from sysid.equation_error.stepwise import noise_bound
from sysid.errors import EstimationError

CRITERIA = ("pse", "cross-validation")
_FOLDS = 8  # of cross validation
# A column of which less than this share is new cannot be distinguished from those before it.
_NEW_SHARE = 1e-4


@dataclass(frozen=True)
class OrthogonalModel:
    """Terms in the order of what they explain.

    names: K chosen. result: regression on them as ordinary terms. order: all candidates that could be made orthogonal,
    K of them chosen. criterion: (len(order) + 1,) predicted square error with 0, 1, 2 ... of them.
    """

    names: tuple[str, ...]
    result: RegressionResult
    order: tuple[str, ...]
    criterion: Array


def orthogonal_model(
    y: Array,
    X: Array,
    names: Sequence[str],
    lengths: Sequence[int] | None = None,
    bandwidth: float = 1.0,
    criterion: str = "pse",
) -> OrthogonalModel:
    """Choose terms among the columns of X (N, P) for the regressand y (N,).

    names: P names; a constant among them comes first. lengths, bandwidth: see
    sysid.equation_error.least_squares.regress. criterion: "pse" predicted square error, "cross-validation" error on
    blocks of consecutive samples left out. Raises EstimationError for an unknown criterion or a regressand that nothing
    explains.
    """
    if criterion not in CRITERIA:
        raise EstimationError(f"unknown criterion {criterion!r}; known are {', '.join(CRITERIA)}")
    order, explained = ranked(y, X)
    if criterion == "pse":
        terms = np.arange(len(order) + 1)
        left = float(y @ y) - np.concatenate(([0.0], np.cumsum(explained)))
        scores = left / y.size + noise_bound(y, X) * terms / (y.size * bandwidth)
    else:
        scores = _left_out_error(y, X[:, order])
    count = int(np.argmin(scores))
    if count == 0:
        raise EstimationError("orthogonal functions: no candidate explains more than chance would")
    chosen = [names[j] for j in order[:count]]
    result = regress(y, X[:, order[:count]], chosen, lengths, bandwidth)
    return OrthogonalModel(tuple(chosen), result, tuple(names[j] for j in order), scores)


def ranked(y: Array, X: Array) -> tuple[list[int], Array]:
    """Columns by what they take off the squared error beside those before them, and how much (Gram-Schmidt).

    The first column is the first taken; columns that hardly differ from a combination of others are left out.
    """
    rest = np.asarray(X, dtype=np.float64).copy()
    full = np.sum(rest**2, axis=0)
    residual = y.copy()
    order: list[int] = []
    explained: list[float] = []
    while len(order) < X.shape[1]:
        size = np.sum(rest**2, axis=0)
        usable = size > _NEW_SHARE**2 * np.maximum(full, 1e-300)
        usable[order] = False
        if not usable.any():
            break
        gain = np.where(usable, (residual @ rest) ** 2 / np.where(usable, size, 1.0), -1.0)
        best = int(np.argmax(gain)) if order or not usable[0] else 0
        function = rest[:, best] / np.sqrt(size[best])
        order.append(best)
        explained.append(float(gain[best]))
        residual = residual - function * (function @ residual)
        rest = rest - np.outer(function, function @ rest)
        # Once more: the first subtraction leaves what rounding made of nearly dependent columns.
        rest = rest - np.outer(function, function @ rest)
    return order, np.array(explained)


def _left_out_error(y: Array, X: Array) -> Array:
    """(P + 1,) mean squared error on blocks left out, by models of the first 0, 1 ... P columns."""
    edges = np.linspace(0, y.size, _FOLDS + 1).astype(int)
    total = np.zeros(X.shape[1] + 1)
    for start, stop in pairwise(edges):
        kept = np.ones(y.size, dtype=np.bool_)
        kept[start:stop] = False
        for count in range(X.shape[1] + 1):
            values = np.linalg.lstsq(X[kept, :count], y[kept], rcond=1e-8)[0]
            total[count] += float(np.sum((y[start:stop] - X[start:stop, :count] @ values) ** 2))
    return total / y.size
