"""Names of coefficients and regressors as the field writes them, and the model's equations with numbers."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from gcs.report.markup import decimals, shown
from sim_vehicle.errors import ModelFileError
from sim_vehicle.model.aerodynamic_terms import AXES, parse_term

_REGRESSORS = {
    "alpha": "α", "alphadot": '<span class="hat">α̇</span>', "beta": "β", "p": "p̂", "q": "q̂", "r": "r̂",
    "de": "δ<sub>e</sub>", "da": "δ<sub>a</sub>", "dr": "δ<sub>r</sub>", "throttle": "δ<sub>t</sub>",
    "CL": "C<sub>L</sub>",
}  # fmt: skip
_POWERS = ("", "", "²", "³", "⁴")
LEGEND = (
    "Angles and surface deflections in rad; p̂ = p b / 2V, q̂ = q c / 2V, r̂ = r b / 2V, and α̇ stands for α̇ c / 2V. "
    "CL and CD act in stability axes, CY along body y; moments are about the centre of gravity."
)


def axis_symbol(axis: str) -> str:
    """CL as C with its subscript."""
    return f"C<sub>{escape(axis[1:])}</sub>"


def symbol(name: str) -> str:
    """A coefficient's name with subscripts; a name outside the grammar as it stands."""
    try:
        term = parse_term(name)
    except ModelFileError:
        return escape(name)
    if name == "CD_k":
        return "k"
    index = "".join(_plain(factor) for factor in _product(term.factors)) or "0"
    return f"C<sub>{escape(term.axis[1:])}{'' if index[0].isdigit() else ' '}{index}</sub>"


def equations(coefficients: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """One equation for each axis in HTML, terms that were refused left out."""
    return [line for axis in AXES if (line := _equation(axis, coefficients))]


def _equation(axis: str, coefficients: Mapping[str, Mapping[str, Any]]) -> str:
    parts: list[str] = []
    for name, entry in coefficients.items():
        if name.partition("_")[0] != axis or entry.get("value") is None:
            continue
        value, std = float(entry["value"]), entry.get("std")
        places = decimals(value, std)
        size = shown(abs(value)) if places is None else f"{abs(value):.{places}f}"
        sign = ("− " if value < 0.0 else "+ ") if parts else "−" if value < 0.0 else ""
        parts.append(f"{sign}{size} {_regressor(name)}".strip())
    return f"{axis_symbol(axis)} = {' '.join(parts)}" if parts else ""


def _regressor(name: str) -> str:
    try:
        factors = parse_term(name).factors
    except ModelFileError:
        return escape(name)
    return " ".join(
        _REGRESSORS.get(factor, f"δ<sub>{escape(factor)}</sub>") + power for factor, power in _product(factors)
    )


def _product(factors: tuple[str, ...]) -> list[tuple[str, str]]:
    return [(factor, _POWERS[factors.count(factor)]) for factor in dict.fromkeys(factors)]


def _plain(factor: tuple[str, str]) -> str:
    """Within a subscript: letters without subscripts of their own."""
    name, power = factor
    bare = {"p": "p", "q": "q", "r": "r", "de": "δe", "da": "δa", "dr": "δr", "throttle": "δt", "CL": "CL"}
    return bare.get(name, {"alpha": "α", "alphadot": "α̇", "beta": "β"}.get(name, f"δ{name}")) + power
