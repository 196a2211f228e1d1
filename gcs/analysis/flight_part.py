"""The part of a flight that a user asks for, checked before anything is read."""

from __future__ import annotations

import math


def part_problem(start: float | None, stop: float | None) -> str:
    """What is wrong with the seconds `from` and `to`, and what to give; empty where nothing is."""
    for name, value in (("from", start), ("to", stop)):
        if value is not None and not (math.isfinite(value) and value >= 0.0):
            return f"{name} is {value:g} s: give seconds from the flight's first stamp, 0 or more"
    if stop is not None and stop <= (start or 0.0):
        return f"to ({stop:g} s) is not later than from ({start or 0.0:g} s): give a part that ends after it begins"
    return ""
