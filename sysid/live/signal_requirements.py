"""Which signals an axis needs: what an aircraft that lacks some of them cannot identify, and why."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from sim_vehicle.model.aerodynamic_terms import Term, parse_term
from sysid.equation_error.coefficients import AXES
from sysid.problem.model_structure import LONGITUDINAL_AXES

# Without one of these no axis can be estimated.
CORE = ("ax", "ay", "az", "p", "q", "r", "alpha", "airspeed", "air_density")
OPTIONAL = ("beta", "phi", "theta", "psi")


def refusals(
    names: Sequence[str], surfaces: Collection[str], there: Collection[str], thrust: str | None
) -> dict[str, tuple[str, str]]:
    """Coefficients that cannot be estimated by the signals that are `there`: why, and what to fly.

    surfaces: signals of the vehicle's. thrust: the signal that gives thrust, None for none.
    """
    refused: dict[str, tuple[str, str]] = {}
    missing = [name for name in CORE if name not in there]
    for name in names:
        term = parse_term(name)
        lost = [factor for factor in term.factors if factor in surfaces and factor not in there]
        if missing:
            cure = " (give it in [environment] of the vehicle file)" if missing == ["air_density"] else ""
            refused[name] = (f"there is no {', '.join(missing)}{cure}", "")
        elif term.axis not in LONGITUDINAL_AXES and "beta" not in there:
            refused[name] = ("there is no sideslip vane (beta)", "")
        elif term.axis in ("CL", "CD") and thrust is None:
            refused[name] = ("thrust is neither measured nor given by [propulsion]", "")
        elif lost:
            refused[name] = (f"there is no {', '.join(lost)}: its servo's output does not come", "")
    return refused


def axes_of(
    names: Sequence[str], refused: Mapping[str, tuple[str, str]], before: Mapping[str, Sequence[str]]
) -> tuple[dict[str, list[Term]], dict[str, str]]:
    """The terms of each axis that can be estimated now, and why others stand still.

    before: the coefficients of each axis that has been estimated. One that has lost some of them stands still: without
    their signals its equation would no longer hold. What it knows stands.
    """
    terms: dict[str, list[Term]] = {}
    standing: dict[str, str] = {}
    for axis in AXES:
        chosen = [name for name in names if name.startswith(f"{axis}_") and name not in refused]
        lost = [name for name in before.get(axis, ()) if name in refused]
        if lost:
            standing[axis] = refused[lost[0]][0]
        elif chosen:
            terms[axis] = [parse_term(name) for name in chosen]
    return terms, standing
