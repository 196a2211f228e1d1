"""Derivatives about stability axes as derivatives about body axes."""

from __future__ import annotations

import math
from collections.abc import Mapping


def to_body(values: Mapping[str, float], alpha: float) -> dict[str, float]:
    """Coefficients about body axes.

    values: about stability axes (x along the velocity's projection on the plane of symmetry, z down), by our names.
    alpha: the angle from there to the body's x axis, rad. Lift, drag, side force and pitching moment are the same
    quantities in both; rolling and yawing moments turn, and so do roll and yaw rates (Etkin & Reid, Dynamics of
    Flight, app. B.12).
    """
    return _turned_rates(_turned_moments(values, alpha), alpha)


def _turned_moments(values: Mapping[str, float], alpha: float) -> dict[str, float]:
    found = {name: value for name, value in values.items() if not name.startswith(("Cl_", "Cn_"))}
    cos, sin = math.cos(alpha), math.sin(alpha)
    for regressor in dict.fromkeys(name[3:] for name in values if name.startswith(("Cl_", "Cn_"))):
        roll, yaw = values[f"Cl_{regressor}"], values[f"Cn_{regressor}"]
        found |= {f"Cl_{regressor}": roll * cos - yaw * sin, f"Cn_{regressor}": roll * sin + yaw * cos}
    return found


def _turned_rates(values: Mapping[str, float], alpha: float) -> dict[str, float]:
    """The stability axes' roll rate is p cos alpha + r sin alpha, their yaw rate r cos alpha - p sin alpha."""
    found = dict(values)
    cos, sin = math.cos(alpha), math.sin(alpha)
    for axis in ("CY", "Cl", "Cn"):
        p, r = values[f"{axis}_p"], values[f"{axis}_r"]
        found |= {f"{axis}_p": p * cos - r * sin, f"{axis}_r": p * sin + r * cos}
    return found
