"""A derivative that no flight has given, with its doubt, and how much the kinds of program are doubted."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from sim_vehicle.model.aerodynamic_terms import parse_term

# Share of its value by which a derivative of a vortex lattice or panel method may be off, 1 sigma; judgement
# (docs/howto/prior.md). By name, else by what it goes with.
_OF_NAME = {"CL_0": 0.10, "CL_alpha": 0.10, "CL_q": 0.30, "Cm_q": 0.30, "Cl_p": 0.30, "Cn_r": 0.30}
_OF_REGRESSOR = {
    "0": 0.3, "CL_CL": 0.3, "alpha": 0.3, "beta": 0.3, "p": 0.5, "q": 0.5, "r": 0.5, "de": 0.4, "da": 0.4, "dr": 0.4,
}  # fmt: skip
# What is not known of a derivative however small it is, 1 sigma: per rad, rates nondimensional; judgement.
_LEAST = {
    "CL_0": 0.1, "CL_alpha": 0.2, "CL_q": 1.0, "CL_de": 0.1, "CD_0": 0.02, "CD_k": 0.01,
    "Cm_0": 0.05, "Cm_alpha": 0.15, "Cm_q": 1.5, "Cm_de": 0.1,
    "CY_0": 0.02, "Cl_0": 0.005, "Cn_0": 0.005,
    "CY_beta": 0.1, "CY_p": 0.1, "CY_r": 0.1, "CY_da": 0.05, "CY_dr": 0.05,
    "Cl_beta": 0.03, "Cl_p": 0.05, "Cl_r": 0.05, "Cl_da": 0.02, "Cl_dr": 0.02,
    "Cn_beta": 0.03, "Cn_p": 0.05, "Cn_r": 0.03, "Cn_da": 0.02, "Cn_dr": 0.02,
}  # fmt: skip


@dataclass(frozen=True)
class Estimate:
    """A coefficient of which a share, and at least `least`, is in doubt (1 sigma). value: per rad, rates
    nondimensional.
    """

    value: float
    share: float
    least: float

    def std(self, doubt: float | None) -> float:
        """Its standard deviation. doubt: the share that somebody states instead of the usual one."""
        return math.hypot((self.share if doubt is None else doubt) * self.value, self.least)


@dataclass(frozen=True)
class Estimates:
    """What one source gives, and what it does not give or could not be used of it, in words."""

    of: Mapping[str, Estimate]
    left_out: tuple[str, ...] = ()


def of_program(values: Mapping[str, float]) -> dict[str, Estimate]:
    """Coefficients as another program has them, with what such programs are doubted."""
    found = {}
    for name, value in values.items():
        share = _OF_NAME.get(name, _OF_REGRESSOR["_".join(parse_term(name).factors) or "0"])
        found[name] = Estimate(value, share, least(name))
    return found


def symmetric() -> dict[str, Estimate]:
    """What is zero on an aircraft whose right half mirrors its left one, as far as aircraft are built so."""
    return {name: Estimate(0.0, 0.0, least(name)) for name in ("CY_0", "Cl_0", "Cn_0")}


def least(name: str) -> float:
    """What is not known of a coefficient however small it is, 1 sigma."""
    return _LEAST[name]
