"""Modes of the motion against the levels of MIL-F-8785C, scaled to a small aircraft.

Levels: MIL-F-8785C (1980), 3.2.1.2 (phugoid), 3.2.2.1 (short period, category B), 3.3.1.1 (Dutch roll), 3.3.1.2 (roll),
3.3.1.3 (spiral), class I. They are those of aircraft that carry people; times are scaled by the root of the span over
that of a light aircraft (Froude: Foster & Bowman, "Dynamic Stability and Handling Qualities of Small Unmanned Aerial
Vehicles", AIAA 2005-1023). Ratios of damping have no scale.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

# Span of the aircraft that the levels are about, m.
_SPAN = 10.0
# Of each mode its quantities: least (or, True, largest) value of levels 1, 2 and 3.
_LEVELS: dict[str, dict[str, tuple[tuple[float, float, float], bool]]] = {
    "short period": {"damping_ratio": ((0.30, 0.20, 0.15), False)},
    "phugoid": {"damping_ratio": ((0.04, 0.0, 0.0), False), "time_to_double": ((55.0, 55.0, 55.0), False)},
    "Dutch roll": {"damping_ratio": ((0.08, 0.02, 0.0), False), "frequency": ((0.4, 0.4, 0.4), False)},
    "roll": {"time_constant": ((1.4, 3.0, 10.0), True)},
    "spiral": {"time_to_double": ((20.0, 8.0, 4.0), False)},
}


def handling(modes: Sequence[Mapping[str, Any]], span: float) -> list[dict[str, Any]]:
    """Per mode and quantity the value, scaled to the span of the levels, and the level; 4 for worse than all.

    modes: as results hold them. span: m.
    """
    slower = math.sqrt(_SPAN / span)
    found = []
    for mode in modes:
        name = next((one for one in _LEVELS if one.lower() == str(mode["name"]).lower()), None)
        if name is None:
            continue
        real = float(mode["eigenvalue"][0])
        values = {
            "damping_ratio": (_value(mode, "damping_ratio"), "1"),
            "frequency": (_scaled(_value(mode, "frequency_hz"), 2.0 * math.pi / slower), "rad/s"),
            "time_constant": (_scaled(_value(mode, "time_constant_s"), slower), "s"),
            "time_to_double": (slower * math.log(2.0) / real if real > 0.0 else math.inf, "s"),
        }
        for quantity, (limits, largest) in _LEVELS[name].items():
            value, unit = values[quantity]
            if value is None or not math.isfinite(value):
                continue  # a spiral that ends by itself is of level 1
            if name == "phugoid" and (real > 0.0) is (quantity == "damping_ratio"):
                continue  # one that grows is judged by how fast it does: level 3 at best
            good = [value <= one if largest else value >= one for one in limits]
            level = good.index(True) + 1 if True in good else 4
            level = max(level, 3) if name == "phugoid" and real > 0.0 else level
            found.append({"mode": name, "quantity": quantity, "value": value, "unit": unit, "level": level})
    return found


def _value(mode: Mapping[str, Any], key: str) -> float | None:
    entry = mode.get(key)
    return None if entry is None else float(entry["value"])


def _scaled(value: float | None, by: float) -> float | None:
    return None if value is None else by * value
