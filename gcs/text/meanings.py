"""What a coefficient is, in plain words."""

from __future__ import annotations

from itertools import groupby

from sim_vehicle.errors import ModelFileError
from sim_vehicle.model.aerodynamic_terms import POLAR, parse_term

_AXES = {
    "CL": "lift", "CD": "drag", "CY": "side force", "Cl": "rolling moment", "Cm": "pitching moment",
    "Cn": "yawing moment",
}  # fmt: skip
_REGRESSORS = {
    "alpha": "angle of attack", "alphadot": "rate of the angle of attack", "beta": "sideslip", "p": "roll rate",
    "q": "pitch rate", "r": "yaw rate", "de": "elevator", "da": "aileron", "dr": "rudder", "CL": "lift",
    "throttle": "throttle",
}  # fmt: skip
_POWERS = {1: "", 2: " squared", 3: " cubed", 4: " to the fourth"}
# What the field calls them.
_CALLED = {
    "CL_alpha": "lift slope", "Cm_alpha": "pitch stability", "Cm_q": "pitch damping", "Cm_de": "elevator power",
    "Cl_beta": "dihedral effect", "Cl_p": "roll damping", "Cl_da": "aileron power", "Cn_beta": "weathercock stability",
    "Cn_r": "yaw damping", "Cn_dr": "rudder power", "Cn_da": "adverse yaw", POLAR: "induced drag",
}  # fmt: skip


def meaning(name: str) -> str:
    """A coefficient in words, as "pitch damping: pitching moment by pitch rate"; empty for what is none."""
    try:
        term = parse_term(name)
    except ModelFileError:
        return ""
    factors = [
        f"{_REGRESSORS.get(one, one.replace('_', ' '))}{_POWERS[len([*alike])]}" for one, alike in groupby(term.factors)
    ]
    words = f"{_AXES[term.axis]} {'by ' + ' times '.join(factors) if factors else 'at zero angles and rates'}"
    return f"{_CALLED[name]}: {words}" if name in _CALLED else words
