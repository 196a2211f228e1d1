"""AVL's table of stability derivatives: what OPER's command ST writes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

from gcs.errors import PriorError
from gcs.priors.estimate import Estimates, of_program
from gcs.priors.names import NUMBER, number, ours
from gcs.priors.stability_axes import to_body

# Surfaces by AVL's name of the control variable.
_CONTROLS = {"elevator": "de", "aileron": "da", "rudder": "dr"}
_AXES = {"de": ("CL", "Cm"), "da": ("CY", "Cl", "Cn"), "dr": ("CY", "Cl", "Cn")}
_BODY_AXES = "Standard axis orientation"
_BEGIN = "Stability-axis derivatives"


def read(text: str, where: str) -> Estimates:
    """Coefficients of an AVL file. where: its name, for errors.

    AVL's derivatives are per radian, but per unit of a control variable, which is a degree where the control's gain is
    1 (AVL user's guide, CONTROL). Raises PriorError, one line, where something is missing or stands in other axes.
    """
    head, found, table = text.partition(_BEGIN)
    if not found:
        raise PriorError(f'{where}: has no "{_BEGIN}"; write it in AVL with OPER, X, ST')
    if _BODY_AXES not in head:
        raise PriorError(f"{where}: is not in AVL's standard axes (X fwd, Z down); turn them on in OPER's options, O")
    # Behind the table stands a line "Clb Cnr / Clr Cnb = …", which is no derivative.
    rows = "\n".join(line.partition("|")[2] for line in table.splitlines())
    state, slopes = _numbers(head), _numbers(rows)
    alpha = math.radians(_of(state, "Alpha", where))
    values, controls = ours(slopes, where, "AVL"), _controls(table)
    known = {name: _CONTROLS[name.casefold()] for name in controls if name.casefold() in _CONTROLS}
    if len(set(known.values())) < len(known):
        raise PriorError(f"{where}: {', '.join(known)} are several controls of one name; give each its own in AVL")
    for name, surface in known.items():
        for axis in _AXES[surface]:
            values[f"{axis}_{surface}"] = math.degrees(_of(slopes, f"{axis}d{controls[name]}", where))
    deflection = math.radians(sum(_of(state, name, where) for name, surface in known.items() if surface == "de"))
    for axis in ("CL", "Cm"):
        # The zero is that of a straight flight with the elevator at zero; other controls stay as the run had them.
        moved = {"alpha": alpha, "q": _of(state, "qc/2V", where), "de": deflection}
        by_motion = sum(values.get(f"{axis}_{regressor}", 0.0) * value for regressor, value in moved.items())
        values[f"{axis}_0"] = _of(state, f"{axis}tot", where) - by_motion
    values = to_body(values, alpha)
    if (induced := _induced_drag(head, state)) is not None:
        values["CD_k"] = induced
    return Estimates(of_program(values), tuple(_left_out(controls, known)))


def _left_out(controls: Iterable[str], known: Iterable[str]) -> list[str]:
    """What the file has and we do not take, and the other way round."""
    unknown = [name for name in controls if name not in known]
    words = [f"{', '.join(unknown)}: no control is named so; taken are {', '.join(_CONTROLS)}"] if unknown else []
    lacking = [name for name in _CONTROLS if name not in {one.casefold() for one in known}]
    return [*words, f"what {', '.join(lacking)} does: the file has no such control"] if lacking else words


def _numbers(text: str) -> dict[str, float]:
    """Every NAME = NUMBER of a text; the name without blanks."""
    return {name: number(value) for name, value in re.findall(rf"([^\s=|]+)\s*=\s*({NUMBER})(?=\s|$)", text)}


def _of(numbers: dict[str, float], name: str, where: str) -> float:
    if name not in numbers:
        raise PriorError(f"{where}: holds no number for {name}; write it anew in AVL with OPER, X, ST")
    return numbers[name]


def _controls(table: str) -> dict[str, str]:
    """Digits of each control by its name, as in `elevator     d01`."""
    lines = [line for line in table.splitlines() if "=" not in line]
    return dict(pair for line in lines for pair in re.findall(r"(\S+)\s+d(\d+)(?=\s|$)", line))


def _induced_drag(head: str, state: dict[str, float]) -> float | None:
    """Drag over lift squared, by span efficiency in the Trefftz plane."""
    efficiency = re.search(rf"\be\s*=\s*({NUMBER})\s*\|\s*Plane", head)
    area, span = state.get("Sref", 0.0), state.get("Bref", 0.0)
    if efficiency is None or number(efficiency[1]) <= 0.0 or area <= 0.0 or span <= 0.0:
        return None
    return area / (math.pi * number(efficiency[1]) * span**2)
