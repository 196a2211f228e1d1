"""Stepwise regression: which terms a flight supports, one at a time, each decision on record.

A term enters if its partial F exceeds a threshold and the predicted square error falls, and leaves again when later
ones make it needless. What is left must pass with partial F for coloured residuals, (value / standard error)^2: the
samples of a filtered record are not independent, and the ordinary F keeps almost anything. While terms are missing the
residual holds their motion, so that the coloured F would let nothing in.
Source: Klein & Morelli, "Aircraft System Identification", chapter 5 (stepwise regression, PSE).

Candidate terms of a polynomial aerodynamic model, in the names of the model file.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from sim_vehicle.model.aerodynamic_terms import Term, parse_term
from sysid.arrays import Array
from sysid.equation_error.least_squares import RegressionResult, regress
from sysid.errors import EstimationError

# Partial F ratios by which a term enters and leaves (4 to 20 are usual: of many candidates chance alone gives one that
# has 4), and most steps.
F_ENTER, F_LEAVE = 12.0, 8.0
_MOST_STEPS = 40
# Share of the best partial correlation that counts as no worse.
_AS_GOOD = 0.97

# Symmetry of the airframe: sideslip enters lift, drag and pitching moment squared, and the lateral axes are odd in it.
_LONGITUDINAL = ("alpha", "alpha2", "alpha3", "beta2", "q", "alpha_q", "de", "alpha_de", "de2")
_LATERAL = (
    "beta", "beta3", "alpha_beta", "p", "alpha_p", "r", "alpha_r", "da", "alpha_da", "dr", "alpha_dr",
)  # fmt: skip
_DRAG = ("k", "CL", "alpha", "alpha2", "beta2", "q", "de", "alpha_de", "de2", "de_CL")
_BY_AXIS = {
    "CL": _LONGITUDINAL, "CD": _DRAG, "Cm": _LONGITUDINAL, "CY": _LATERAL, "Cl": _LATERAL, "Cn": _LATERAL,
}  # fmt: skip


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


def predicted_square_error(residual: Array, count: int, largest_variance: float, bandwidth: float = 1.0) -> float:
    """PSE = mean squared residual + sigma_max^2 p / N (Klein & Morelli, chapter 5).

    count: p, terms. largest_variance: sigma_max^2, an upper bound of the noise's variance (`noise_bound`).
    bandwidth: share of the samples that are independent of each other.
    """
    return float(np.mean(residual**2) + largest_variance * count / (residual.size * bandwidth))


def noise_bound(y: Array, X: Array) -> float:
    """Upper bound of the noise's variance: 25 times what all candidates together leave, at most the variance of y.

    The variance of y alone would keep out a control derivative that explains half a percent beside a strong slope.
    """
    left = y - X @ np.linalg.lstsq(X, y, rcond=1e-10)[0]
    return float(min(np.var(y), 25.0 * np.mean(left**2)))


def p_value(partial_f: float, free: float) -> float:
    """Chance of a partial F at least so large for a term that is zero; free: degrees of freedom left."""
    return float(special.fdtrc(1.0, max(free, 1.0), partial_f))


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
        reason = f"not significant: partial F {partial_f:.1f}, p = {p:.2g}"
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

    names: P names. forced: names that are in from the start and stay. lengths, bandwidth: see
    sysid.equation_error.least_squares.regress. Raises EstimationError for names that are not there or a model without
    any term.
    """
    strange = [name for name in forced if name not in names]
    if strange:
        raise EstimationError(f"stepwise: {strange[0]} is none of the candidates")
    parts = tuple(lengths) if lengths is not None else (y.size,)
    inside = [list(names).index(name) for name in forced]
    history: list[str] = []
    bound = noise_bound(y, X)
    for _ in range(_MOST_STEPS):
        entering = _next(y, X, inside, bound, bandwidth)
        if entering is None:
            break
        inside.append(entering)
        leaving = _leaving(y, X, names, inside, forced, parts, bandwidth, coloured=False)
        history.append(f"{names[entering]} enters" + "".join(f", {names[j]} leaves" for j in leaving))
        inside = [j for j in inside if j not in leaving]
        if entering in leaving:
            break
    late = _leaving(y, X, names, inside, forced, parts, bandwidth, coloured=True) if inside else []
    history += [f"{names[j]} leaves: nothing beside coloured residuals" for j in late]
    inside = [j for j in inside if j not in late]
    if not inside:
        raise EstimationError("stepwise: no candidate explains anything of the regressand")
    chosen = [names[j] for j in inside]
    result = regress(y, X[:, inside], chosen, parts, bandwidth)
    excluded = [
        trial(y, X[:, inside], chosen, X[:, j], names[j], parts, bandwidth)
        for j in range(len(names))
        if j not in inside
    ]
    return Selection(tuple(chosen), result, tuple(excluded), tuple(history))


def _next(y: Array, X: Array, inside: Sequence[int], bound: float, bandwidth: float) -> int | None:
    """The column with the largest partial correlation if it passes the tests, else None.

    Of columns that do nearly as well the first is taken: candidates stand with the simplest first.
    """
    outside = [j for j in range(X.shape[1]) if j not in inside]
    free = y.size * bandwidth - len(inside) - 1.0
    if not outside or free < 2.0:
        return None
    basis = np.linalg.qr(X[:, list(inside)])[0] if inside else np.zeros((y.size, 0))
    residual = y - basis @ (basis.T @ y)
    rest = X[:, outside] - basis @ (basis.T @ X[:, outside])
    size = np.sqrt(np.sum(rest**2, axis=0))
    usable = size > 1e-6 * np.sqrt(np.sum(X[:, outside] ** 2, axis=0))
    score = np.where(usable, np.abs(residual @ rest) / np.where(usable, size, 1.0), 0.0)
    best = int(np.argmax(score >= _AS_GOOD * np.max(score)))
    if score[best] == 0.0:
        return None
    after = residual - rest[:, best] * (residual @ rest[:, best]) / size[best] ** 2
    count = len(inside)
    falls = predicted_square_error(after, count + 1, bound, bandwidth) < predicted_square_error(
        residual, count, bound, bandwidth
    )
    partial_f = score[best] ** 2 / max(float(after @ after) / free, 1e-300)
    return outside[best] if falls and partial_f > F_ENTER else None


def _leaving(
    y: Array,
    X: Array,
    names: Sequence[str],
    inside: Sequence[int],
    forced: Sequence[str],
    parts: Sequence[int],
    bandwidth: float,
    coloured: bool,
) -> list[int]:
    """Columns whose partial F is below the threshold, taken out one after the other."""
    kept, gone = list(inside), []
    while len(kept) > 1:
        found = regress(y, X[:, kept], [names[j] for j in kept], parts, bandwidth)
        partial_f = (found.values / (found.std if coloured else found.std_white)) ** 2
        partial_f[[names[j] in forced for j in kept]] = np.inf
        worst = int(np.argmin(partial_f))
        if partial_f[worst] >= (F_ENTER if coloured else F_LEAVE):
            break
        gone.append(kept.pop(worst))
    return gone


def candidate_terms(axis: str, moved: Collection[str]) -> list[Term]:
    """Terms that a polynomial model of an axis may have, simplest first, the constant among them.

    moved: regressors that the flight moved; a term with any other factor is left out.
    """
    names = [f"{axis}_0", *(f"{axis}_{part}" for part in _BY_AXIS[axis])]
    return [term for term in map(parse_term, names) if set(term.factors) <= {*moved, "CL"}]
