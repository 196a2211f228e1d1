"""Which coefficients a model has by default, how large they usually are, and what flight identifies them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache

from sim_vehicle.model.aerodynamic_terms import AXES, parse_term
from sysid.numerics.statistics import without

LONGITUDINAL_AXES = ("CL", "CD", "Cm")

DEFAULT_LONGITUDINAL = (
    "CL_0", "CL_alpha", "CL_q", "CL_de", "CD_0", "CD_k", "Cm_0", "Cm_alpha", "Cm_q", "Cm_de",
)  # fmt: skip
DEFAULT_LATERAL = (
    "CY_0", "CY_beta", "CY_p", "CY_r", "CY_da", "CY_dr", "Cl_0", "Cl_beta", "Cl_p", "Cl_r", "Cl_da", "Cl_dr",
    "Cn_0", "Cn_beta", "Cn_p", "Cn_r", "Cn_da", "Cn_dr",
)  # fmt: skip

# Usual size of a derivative by axis and regressor for fixed wings below two metres (the ranges of the effect catalogue
# and of published sets: Aerosonde, Zagi, Ultra Stick 25e). It scales priors and the limit beyond which a number says
# nothing.
_USUAL = {
    "CL": {"0": 0.3, "alpha": 4.0, "q": 5.0, "alphadot": 3.0, "de": 0.5, "": 2.0},
    "CD": {"0": 0.05, "k": 0.2, "": 0.3},
    "Cm": {"0": 0.05, "alpha": 0.6, "q": 8.0, "alphadot": 4.0, "de": 0.8, "": 1.0},
    "CY": {"0": 0.05, "beta": 0.5, "p": 0.3, "r": 0.4, "": 0.2},
    "Cl": {"0": 0.01, "beta": 0.08, "p": 0.4, "r": 0.15, "da": 0.15, "dr": 0.03, "": 0.1},
    "Cn": {"0": 0.01, "beta": 0.08, "p": 0.08, "r": 0.15, "da": 0.03, "dr": 0.1, "": 0.1},
}
# A coefficient is refused when its standard error exceeds both shares: of its own size and of the usual one.
REFUSED_SHARE = 0.3
# No aircraft has a derivative so many times as large as usual: what gives it such a value is something else.
_BEYOND = 10.0
# How far from zero a coefficient may lie a priori, in usual sizes.
PRIOR_WIDTH = 20.0

_MANOEUVRE = {
    "de": "elevator-multisine",
    "da": "aileron-multisine",
    "dr": "rudder-multisine",
    "throttle": "throttle-step",
}


@cache
def usual_size(name: str) -> float:
    """Usual magnitude of a coefficient."""
    term = parse_term(name)
    table = _USUAL[term.axis]
    key = "k" if name == "CD_k" else "0" if not term.factors else "_".join(term.factors)
    return table.get(key, table[""])


def not_identified(name: str, value: float, std: float, shared: float = 0.0) -> str | None:
    """Why a coefficient is refused that the flight leaves as large as such a one usually is; None where it is known.

    shared: part of its standard error that inertia and travel give all coefficients of an axis or a surface together:
    their ratios, and the modes, are known all the same.
    """
    usual = usual_size(name)
    if without(std, shared) <= REFUSED_SHARE * max(abs(value), usual):
        return None
    return f"not identified: {value:.2g} ± {1.96 * std:.2g} (95 %), and usual is a size of {usual:.2g}"


def not_believed(name: str, value: float) -> str | None:
    """Why a derivative of this size is not reported; None where it may be so, or where nothing is known of its size."""
    usual = usual_size(name)
    term = parse_term(name)
    known = name == "CD_k" or ("_".join(term.factors) or "0") in _USUAL[term.axis]
    if not known or abs(value) <= _BEYOND * usual:
        return None
    return (
        f"{value:.3g} is {abs(value) / usual:.0f} times what is usual ({usual:.2g}): rough air, a sensor's error or "
        "what the structure lacks passes for it"
    )


def is_longitudinal(name: str) -> bool:
    """Whether a coefficient belongs to lift, drag or pitching moment."""
    return parse_term(name).axis in LONGITUDINAL_AXES


def helpful_manoeuvre(name: str) -> str:
    """The manoeuvre that excites what a coefficient multiplies."""
    term = parse_term(name)
    if term.control:
        return f"{term.control}-multisine"
    for factor in term.factors:
        if factor in _MANOEUVRE:
            return _MANOEUVRE[factor]
    if term.axis == "CD":
        return "roller-coaster"
    if term.axis in LONGITUDINAL_AXES:
        return "elevator-multisine"
    return "aileron-multisine,rudder-multisine"


def default_structure(surfaces: Iterable[str], named: Iterable[str] = ()) -> tuple[str, ...]:
    """The linear model for a vehicle with these surfaces (of de, da, dr) and controls of other names, each of which may
    act on every axis.
    """
    present, longitudinal, lateral = set(surfaces), list(DEFAULT_LONGITUDINAL), list(DEFAULT_LATERAL)
    for control in named:
        longitudinal += [f"{axis}_{control}" for axis in LONGITUDINAL_AXES]
        lateral += [f"{axis}_{control}" for axis in AXES if axis not in LONGITUDINAL_AXES]
    names: Sequence[str] = (*longitudinal, *lateral)
    return tuple(n for n in names if not ({"de", "da", "dr"} & set(parse_term(n).factors)) - present)
