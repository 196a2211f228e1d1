"""The 95 % interval of an estimate in a result file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Z95 = 1.96


def of_the_flight(entry: Mapping[str, Any]) -> float | None:
    """Standard error of what the flight leaves open alone: flights of one aircraft share what else there is, and it
    moves none of their differences.
    """
    std: float | None = entry.get("statistical_std", entry.get("std"))
    return std


def interval(entry: Mapping[str, Any]) -> tuple[float, float] | None:
    """Ends of the 95 % interval: the entry's own, else value ± 1.96 std; None without either."""
    if own := entry.get("interval") or entry.get("ci95"):
        low, high = own
        return float(low), float(high)
    value, std = entry.get("value"), entry.get("std")
    return None if value is None or std is None else (value - Z95 * std, value + Z95 * std)
