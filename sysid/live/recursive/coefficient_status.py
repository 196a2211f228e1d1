"""Which coefficients are known by now, why the others are not, and what to fly next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim_vehicle.model.aerodynamic_terms import parse_term
from sysid.live.recursive.frequency_estimator import CoefficientEstimates
from sysid.problem.model_structure import REFUSED_SHARE, helpful_manoeuvre, usual_size

# Correlation of two estimates beyond which their regressors are said to move together (Klein & Morelli, chapter 5).
_TOGETHER = 0.9
# rms below which a regressor has hardly moved: half a degree, or a rate that makes as much lift.
_STILL = {"alpha": 0.005, "beta": 0.005, "de": 0.005, "da": 0.005, "dr": 0.005, "p": 0.003, "q": 0.0005, "r": 0.001}


@dataclass(frozen=True)
class CoefficientStatus:
    """One coefficient as it is known now. why, fly: of one that is not."""

    name: str
    value: float
    std: float
    known: bool
    why: str = ""
    fly: str = ""

    @property
    def unit(self) -> str:
        """1, or 1/rad where it multiplies an angle."""
        angles = {"alpha", "beta", "de", "da", "dr"} & set(parse_term(self.name).factors)
        return "1/rad" if angles else "1"


def judged(estimate: CoefficientEstimates, index: int, value: float, std: float) -> CoefficientStatus:
    """Whether a coefficient counts as known, by the rule that holds after the flight as well."""
    name = estimate.names[index]
    if std <= REFUSED_SHARE * max(abs(value), usual_size(name)) and np.isfinite(std):
        return CoefficientStatus(name, value, std, True)
    return CoefficientStatus(name, value, std, False, _reason(estimate, index, value, std), helpful_manoeuvre(name))


def _reason(estimate: CoefficientEstimates, index: int, value: float, std: float) -> str:
    for factor in parse_term(estimate.names[index]).factors:
        if estimate.moved[index] < _STILL.get(factor, 0.0):
            return f"{factor} has hardly moved"
    others = np.abs(estimate.correlation[index]).copy()
    others[index] = 0.0
    partner = int(np.argmax(others))
    if others[partner] > _TOGETHER:
        own, other = (name.partition("_")[2] for name in (estimate.names[index], estimate.names[partner]))
        return f"{own} and {other} have moved together: their correlation is {others[partner]:.2f}"
    share = std / max(abs(value), usual_size(estimate.names[index]))
    return f"its standard error, {std:.2g}, is still {share:.0%} of it"
