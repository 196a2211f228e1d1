"""Candidate terms of a polynomial aerodynamic model, in the names of the model file."""

from __future__ import annotations

from collections.abc import Collection

from sim_vehicle.terms import Term, parse_term

# Symmetry of the airframe: sideslip enters lift, drag and pitching moment squared, and the lateral axes are odd in it.
_LONGITUDINAL = ("alpha", "alpha2", "alpha3", "beta2", "q", "alpha_q", "de", "alpha_de", "de2")
_LATERAL = (
    "beta", "beta3", "alpha_beta", "p", "alpha_p", "r", "alpha_r", "da", "alpha_da", "dr", "alpha_dr",
)  # fmt: skip
_DRAG = ("k", "CL", "alpha", "alpha2", "beta2", "q", "de", "alpha_de", "de2", "de_CL")
_BY_AXIS = {
    "CL": _LONGITUDINAL, "CD": _DRAG, "Cm": _LONGITUDINAL, "CY": _LATERAL, "Cl": _LATERAL, "Cn": _LATERAL,
}  # fmt: skip


def candidate_terms(axis: str, moved: Collection[str]) -> list[Term]:
    """Terms that a polynomial model of an axis may have, simplest first, the constant among them.

    moved: regressors that the flight moved; a term with any other factor is left out.
    """
    names = [f"{axis}_0", *(f"{axis}_{part}" for part in _BY_AXIS[axis])]
    return [term for term in map(parse_term, names) if set(term.factors) <= {*moved, "CL"}]
