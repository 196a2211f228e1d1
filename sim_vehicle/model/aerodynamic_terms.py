"""The grammar of coefficient names: `CL_alpha`, `Cm_alpha_de`, `CD_de2`, `CD_k`, `CL_flap`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from difflib import get_close_matches

from sim_vehicle.errors import ModelFileError

AXES = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
REGRESSORS = ("alpha", "alphadot", "beta", "p", "q", "r", "de", "da", "dr", "CL", "throttle")
# Those of the motion; all others are inputs, as controls of other names are.
MOTION = ("alpha", "alphadot", "beta", "p", "q", "r", "CL")
MAX_FACTORS = 4
POLAR = "CD_k"

_TOKEN = re.compile(r"^(alphadot|alpha|beta|p|q|r|de|da|dr|CL|throttle)([2-4]?)$")
_CONTROL = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
# What a control of another name must not begin with, or a product of both could be read in two ways.
_TAKEN = re.compile(r"^((alphadot|alpha|beta|p|q|r|de|da|dr|CL|throttle)[0-9]*|k|elevator|aileron|rudder)(_|$)")
# As alike as this it is taken for a slip of a regressor.
_MISSPELT = 0.8


@dataclass(frozen=True)
class Term:
    """One term of the aerodynamic model: its axis (CL ... Cn) and the regressors it multiplies.

    factors: names from REGRESSORS, repeated for powers, then at most one control of another name, as flap; empty for
    the constant. CD_k is ("CL", "CL").
    """

    name: str
    axis: str
    factors: tuple[str, ...]

    @property
    def control(self) -> str:
        """The control of another name among the factors, "" for none."""
        return self.factors[-1] if self.factors and self.factors[-1] not in REGRESSORS else ""


def may_name_control(name: str) -> bool:
    """Whether coefficients can be named after a control of this name: it is no regressor nor spelt nearly as one, and
    begins with none.
    """
    alike = get_close_matches(name.casefold(), REGRESSORS, 1, _MISSPELT)
    return bool(_CONTROL.fullmatch(name)) and not _TAKEN.match(name) and not alike


def parse_term(name: str) -> Term:
    """Take a coefficient name apart. Raises ModelFileError for a name outside the grammar.

    Products stand in the order of REGRESSORS, and each has one name: CL_alpha2, never CL_alpha_alpha.
    """
    if name == POLAR:
        return Term(name, "CD", ("CL", "CL"))
    axis, _, rest = name.partition("_")
    if axis not in AXES or not rest:
        raise ModelFileError(f"coefficient {name!r}: a name is <{'|'.join(AXES)}>_<regressor>, as Cm_alpha")
    if rest == "0":
        return Term(name, axis, ())
    factors: list[str] = []
    control = ""
    tokens = rest.split("_")
    for place, token in enumerate(tokens):
        match = _TOKEN.match(token)
        if match is None:
            control = "_".join(tokens[place:])
            if not may_name_control(control):
                known = ", ".join(REGRESSORS)
                raise ModelFileError(
                    f"coefficient {name!r}: {token!r} is none of 0, k (CD only), {known}, nor the name of a control"
                )
            break
        factors += [match[1]] * int(match[2] or 1)
    if control:
        factors.append(control)
    if len(factors) > MAX_FACTORS:
        raise ModelFileError(f"coefficient {name!r} has {len(factors)} factors; at most {MAX_FACTORS} are flown")
    if axis == "CL" and "CL" in factors:
        raise ModelFileError(f"coefficient {name!r}: CL cannot depend on itself")
    if axis == "CL" and factors.count("alphadot") > 1:
        raise ModelFileError(f"coefficient {name!r}: CL can depend on alphadot only linearly")
    usual = _usual_name(axis, factors)
    if name != usual:
        raise ModelFileError(f"coefficient {name!r}: write it {usual}")
    return Term(name, axis, tuple(factors))


def _usual_name(axis: str, factors: list[str]) -> str:
    """The one spelling of a term, so that no model holds the same term twice."""
    if axis == "CD" and factors == ["CL", "CL"]:
        return POLAR
    known = [(name, factors.count(name)) for name in REGRESSORS if name in factors]
    powers = [*known, *((name, 1) for name in factors if name not in REGRESSORS)]
    return "_".join((axis, *(name if power == 1 else f"{name}{power}" for name, power in powers)))
