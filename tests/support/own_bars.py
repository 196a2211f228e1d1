"""What error bars hold where the rest of the vehicle file is exact, as that of a simulated aircraft is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from sim_vehicle.model.model_file import Coefficient


def own_bar(entry: Coefficient | Mapping[str, Any]) -> float:
    """Standard error of the flight and of what the vehicle file states, without usual errors of mass, inertia, density
    and linkages: the simulator makes none, and bars that hold them would hide a fault of the rest.
    """
    found = entry.to_json() if isinstance(entry, Coefficient) else entry
    usual = (shift for source, shift in found.get("systematic", {}).items() if source.endswith("pct"))
    return math.sqrt(max(float(found["std"]) ** 2 - sum(shift**2 for shift in usual), 0.0))
