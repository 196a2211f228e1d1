"""Stepwise regression: which terms a flight supports, one at a time, each decision on record.

A term enters if its partial F exceeds a threshold and the predicted square error falls; after each entry the terms
that no longer pass are taken out again. Partial F counts with coloured residuals: (value / standard error)^2, since
samples of a filtered record are not independent and the ordinary F lets in almost anything.
Source: Klein & Morelli, "Aircraft System Identification", chapter 5 (stepwise regression, PSE).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from sysid.errors import EstimationError
from sysid.flight import Array
from sysid.regression import RegressionResult, regress

F_ENTER, F_LEAVE = 12.0, 8.0
_MOST_STEPS = 40


@dataclass(frozen=True)
class TermTest:
    """The hypothesis that a term is zero, given the other terms of a model.

    value, std: its estimate, coloured standard error. partial_f: (value / std)^2. p_value: chance of one as large if
    the term were zero. r2_gain: by which R2 rises with the term. reason: in words why it is in or out.
    """

    name: str
    value: float
    std: float
    partial_f: float
    p_value: float
    r2_gain: float
    reason: str


@dataclass(frozen=True)
class Selection:
    """Terms chosen, the regression on them, the tests of the terms left out, and each step as a line."""

    names: tuple[str, ...]
    result: RegressionResult
    excluded: tuple[TermTest, ...]
    history: tuple[str, ...]


def predicted_square_error(y: Array, residual: Array, count: int, bandwidth: float = 1.0) -> float:
    """PSE = mean squared residual + sigma_max^2 p / N, sigma_max^2 the variance of y (Klein & Morelli, eq. 5.93).

    count: p, terms. bandwidth: share of the samples that are independent of each other.
    """
    return float(np.mean(residual**2) + np.var(y) * count / (y.size * bandwidth))


def p_value(partial_f: float, free: float) -> float:
    """Chance of a partial F at least so large for a term that is zero; free: degrees of freedom left."""
    return float(stats.f.sf(partial_f, 1.0, max(free, 1.0)))


def trial(
    y: Array, X: Array, names: Sequence[str], column: Array, name: str, lengths: Sequence[int], bandwidth: float
) -> TermTest:
    """The test of one more column (N,) beside the regressors X (N, P) of a model."""
    free = y.size * bandwidth - len(names) - 1
    try:
        wider = regress(y, np.column_stack([X, column]), [*names, name], lengths, bandwidth)
    except EstimationError as error:
        return TermTest(name, 0.0, np.inf, 0.0, 1.0, 0.0, str(error))
    residual = y - X @ np.linalg.lstsq(X, y, rcond=None)[0]
    gain = (float(residual @ residual) - float(wider.residual @ wider.residual)) / float(np.sum((y - y.mean()) ** 2))
    value, std = float(wider.values[-1]), float(wider.std[-1])
    partial_f = (value / std) ** 2 if std > 0.0 else 0.0
    p = p_value(partial_f, free)
    if wider.vif[-1] > 100.0:
        reason = f"nearly a combination of the others (variance inflation {wider.vif[-1]:.0f})"
    elif partial_f < F_ENTER:
        reason = f"not told from zero: partial F {partial_f:.1f}, p = {p:.2g}"
    else:
        reason = f"differs from zero: partial F {partial_f:.0f}, p = {p:.1g}, R2 rises by {gain:.2g}"
    return TermTest(name, value, std, partial_f, p, gain, reason)


def stepwise(
    y: Array,
    X: Array,
    names: Sequence[str],
    forced: Sequence[str] = (),
    lengths: Sequence[int] | None = None,
    bandwidth: float = 1.0,
) -> Selection:
    """Choose among the columns of X (N, P) those that the regressand y (N,) supports.

    names: P names. forced: names that are in from the start and stay. lengths, bandwidth: see sysid.regression.regress.
    Raises EstimationError for names that are not there or a model without any term.
    """
    strange = [name for name in forced if name not in names]
    if strange:
        raise EstimationError(f"stepwise: {strange[0]} is none of the candidates")
    parts = tuple(lengths) if lengths is not None else (y.size,)
    inside = [list(names).index(name) for name in forced]
    history: list[str] = []
    for _ in range(_MOST_STEPS):
        entering = _next(y, X, names, inside, parts, bandwidth)
        if entering is None:
            break
        inside.append(entering)
        leaving = _weakest(y, X, names, inside, forced, parts, bandwidth)
        history.append(f"{names[entering]} enters" + "".join(f", {names[j]} leaves" for j in leaving))
        inside = [j for j in inside if j not in leaving]
        if entering in leaving:
            break
    if not inside:
        raise EstimationError("stepwise: no candidate tells anything of the regressand")
    chosen = [names[j] for j in inside]
    result = regress(y, X[:, inside], chosen, parts, bandwidth)
    excluded = [
        trial(y, X[:, inside], chosen, X[:, j], names[j], parts, bandwidth)
        for j in range(len(names))
        if j not in inside
    ]
    return Selection(tuple(chosen), result, tuple(excluded), tuple(history))


def _next(
    y: Array, X: Array, names: Sequence[str], inside: Sequence[int], parts: Sequence[int], bandwidth: float
) -> int | None:
    """The column with the largest partial correlation if it passes the tests, else None."""
    outside = [j for j in range(X.shape[1]) if j not in inside]
    if not outside or y.size * bandwidth - len(inside) < 3.0:
        return None
    basis = np.linalg.qr(X[:, list(inside)])[0] if inside else np.zeros((y.size, 0))
    residual = y - basis @ (basis.T @ y)
    rest = X[:, outside] - basis @ (basis.T @ X[:, outside])
    size = np.sqrt(np.sum(rest**2, axis=0))
    usable = size > 1e-6 * np.sqrt(np.sum(X[:, outside] ** 2, axis=0))
    score = np.where(usable, np.abs(residual @ rest) / np.where(usable, size, 1.0), 0.0)
    best = int(np.argmax(score))
    if score[best] == 0.0:
        return None
    after = residual - rest[:, best] * (residual @ rest[:, best]) / size[best] ** 2
    count = len(inside)
    if predicted_square_error(y, after, count + 1, bandwidth) >= predicted_square_error(y, residual, count, bandwidth):
        return None
    column = outside[best]
    tried = [*inside, column]
    found = regress(y, X[:, tried], [names[j] for j in tried], parts, bandwidth)
    return column if (found.values[-1] / found.std[-1]) ** 2 > F_ENTER else None


def _weakest(
    y: Array,
    X: Array,
    names: Sequence[str],
    inside: Sequence[int],
    forced: Sequence[str],
    parts: Sequence[int],
    bandwidth: float,
) -> list[int]:
    """Columns whose partial F has fallen below the threshold, taken out one after the other."""
    kept, gone = list(inside), []
    while len(kept) > 1:
        found = regress(y, X[:, kept], [names[j] for j in kept], parts, bandwidth)
        partial_f = (found.values / found.std) ** 2
        partial_f[[names[j] in forced for j in kept]] = np.inf
        worst = int(np.argmin(partial_f))
        if partial_f[worst] >= F_LEAVE:
            break
        gone.append(kept.pop(worst))
    return gone
