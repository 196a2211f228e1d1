"""Whether a coefficient is the same in every band of frequency, and what it says of its standard error if it is not.

A derivative is one number, whatever the frequency at which it is estimated. What biases a regression depends on
frequency: commands that a closed loop derives from a motion that gusts make, a gust that the vane sees and the wing
does not, delays, physics that the model lacks. None of them shows in the residuals, which least squares makes
orthogonal to the regressors, nor between parts of a flight, which all have the same bias. So each axis is regressed in
several bands as well, and where they differ by more than their errors the scatter about the estimate is added to its
variance. Source of the scatter: R. C. Paule, J. Mandel, "Consensus values and weighting factors", Journal of Research
of the National Bureau of Standards 87(5), 1982.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import special

from sim_vehicle.model.aerodynamic_terms import Term, parse_term
from sysid.arrays import Array
from sysid.equation_error.equations import Equations, axes_of
from sysid.equation_error.frequency_domain import band_of, frequency_regression
from sysid.errors import EstimationError
from sysid.numerics.gaussian import Gaussian

MOST_BANDS = 5  # of frequency in which a derivative is estimated by itself
# Lines of a band per term, below which its own standard errors are guesses.
_LINES = 8
# Scatter, as a share of the estimate, from which not even its sign is sure: two standard deviations reach zero.
_UNSURE = 0.5
# Chance that bands which agree are reported as different, per coefficient.
_CHANCE = 1e-3


@dataclass(frozen=True)
class BandEstimates:
    """One coefficient, estimated from each of B bands.

    bands_hz: (B, 2) edges. values, std: (B,) NaN where a band holds no information. scatter: standard deviation of the
    true values over the bands about the estimate of the whole band, 0 where the bands agree with it.
    """

    bands_hz: Array
    values: Array
    std: Array
    scatter: float


def band_estimates(equations: Equations, joint: Gaussian) -> dict[str, BandEstimates]:
    """Every derivative of `joint` in each of up to MOST_BANDS bands; nothing where the flights are too short for two.

    equations: settled ones of the parts that `joint` was regressed on. joint: estimates of the whole band.
    """
    whole = joint.entries()
    found: dict[str, BandEstimates] = {}
    for axis, terms in axes_of([parse_term(name) for name in joint.names]):
        edges = _edges(equations, len(terms))
        if edges.shape[0] < 2:
            continue
        names = [term.name for term in terms if term.factors]
        values, std = np.full((2, edges.shape[0], len(names)), np.nan)
        for b, (low, high) in enumerate(edges):
            try:
                one = frequency_regression(equations, axis, terms, (float(low), float(high)))
            except EstimationError:
                continue
            values[b], std[b] = one.values, one.std
        for j, name in enumerate(names):
            scatter = _scatter(*whole[name], values[:, j], std[:, j])
            found[name] = BandEstimates(edges, values[:, j], std[:, j], scatter)
    return found


def widened(joint: Gaussian, equations: Equations, found: Mapping[str, BandEstimates]) -> Gaussian:
    """`joint` with the scatter of each derivative in its covariance; the constant of its axis moves along."""
    covariance = joint.covariance.copy()
    for axis, terms in axes_of([parse_term(name) for name in joint.names]):
        moves = _moves(equations, axis, terms)
        place = [joint.names.index(term.name) for term in terms]
        for j, term in enumerate(terms):
            if term.name in found:
                covariance[np.ix_(place, place)] += found[term.name].scatter ** 2 * np.outer(moves[j], moves[j])
    return Gaussian(joint.names, joint.mean, covariance)


def refusal(value: float, found: BandEstimates) -> str | None:
    """Why an estimate cannot be given at all, where bands differ by as much as its own size."""
    if found.scatter <= _UNSURE * abs(value):
        return None
    estimated = found.values[np.isfinite(found.values)]
    return (
        f"bands of frequency give {estimated.min():.3g} to {estimated.max():.3g}: feedback, gusts or missing physics "
        "bias the regression by its own size"
    )


def warning(found: Mapping[str, BandEstimates]) -> list[str]:
    """One line that names what differs between bands; none where nothing does."""
    names = [name for name, one in found.items() if one.scatter > 0.0]
    if not names:
        return []
    return [
        f"{', '.join(names)}: bands of frequency give different values, so the regression is biased (commands that "
        "follow gusts in a closed loop, gusts that the vane sees and the wing does not, delays, missing physics); "
        "their bars hold that scatter; fly a multisine in calm air"
    ]


def _edges(equations: Equations, terms: int) -> Array:
    """(B, 2) bands of equal width where the commands have their power, with lines enough for each term."""
    try:
        low, high = band_of(equations)
    except EstimationError:
        return np.zeros((0, 2))
    duration = sum(equations.lengths) * equations.interval_s
    count = min(MOST_BANDS, int(duration * (high - low) / (_LINES * max(terms, 1))))
    return np.array(list(pairwise(np.linspace(low, high, max(count, 1) + 1))))


def _scatter(value: float, std: float, values: Array, errors: Array) -> float:
    """Paule and Mandel's scatter of band values about an estimate; 0 where chance would do."""
    estimated = np.isfinite(values) & np.isfinite(errors) & (errors > 0.0)
    if estimated.sum() < 2:
        return 0.0
    squares, variances = (values[estimated] - value) ** 2, errors[estimated] ** 2 + std**2
    if float(np.sum(squares / variances)) < float(special.chdtri(estimated.sum(), _CHANCE)):
        return 0.0

    def excess(scatter: float) -> float:
        return float(np.sum(squares / (variances + scatter**2))) - float(estimated.sum())

    from scipy.optimize import brentq  # slow to import, and seldom wanted

    return float(brentq(excess, 0.0, float(np.sqrt(np.sum(squares)))))


def _moves(equations: Equations, axis: str, terms: Sequence[Term]) -> Array:
    """(P, P): row j is how all terms move where term j does: the axis' constant keeps the mean of the regressand."""
    moves = np.eye(len(terms))
    constant = next((i for i, term in enumerate(terms) if not term.factors), None)
    if constant is not None:
        mean = equations.matrix(terms).mean(axis=0)
        others = [j for j in range(len(terms)) if j != constant]
        moves[others, constant] = -mean[others] / mean[constant]
    return moves
