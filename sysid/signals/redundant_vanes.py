"""Two vanes of one kind: the second as a further measurement of the first's angle.

A vane at (x, y, z) reads alpha - x q / V + y p / V, or beta + x r / V - z p / V (Jolly, Unhelkar & Arya, section III).
The second one's reading is moved to the first one's place and both are averaged by their noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim_vehicle.vehicle.vehicle_file import Sensor, Vehicle
from sysid.arrays import Array
from sysid.numerics.normal_equations import inverse
from sysid.numerics.smoothing import noise_sigma
from sysid.signals.flight import FlightData
from sysid.signals.sensor_errors import SENSOR_ERRORS

PAIRS = {"alpha": "alpha2", "beta": "beta2"}
_NEEDED = ("airspeed", "p", "q", "r")


def combined_vanes(data: FlightData, vehicle: Vehicle) -> tuple[FlightData, dict[str, float]]:
    """The flight with both vanes of a kind in one column, and the share that each vane has in it.

    Vanes that disagree by more than a cheap vane's own errors are not averaged: the first counts alone, with a warning.
    A second vane without a first one stands in its place.
    """
    columns, warnings, shares = dict(data.columns), list(data.warnings), dict.fromkeys(PAIRS, 1.0)
    for first, second in PAIRS.items():
        if second not in data or not all(name in data for name in _NEEDED):
            continue
        moved = _at_the_first(data, first, vehicle)
        if first not in data:
            columns[first], shares[first], shares[second] = moved, 0.0, 1.0
            warnings.append(f"{first}: only the second vane is there; {second} is used")
            continue
        doubt = _disagreement(data[first] + (data[second] - moved), data[second], first)
        if doubt:
            warnings.append(f"{second} disagrees with {first}: {doubt}; {first} alone is used: check both mountings")
            continue
        weight = _noise(moved, data.interval_s) ** -2.0
        own = _noise(data[first], data.interval_s) ** -2.0
        shares[first], shares[second] = own / (own + weight), weight / (own + weight)
        both = shares[first] * data[first] + shares[second] * moved
        columns[first] = np.where(np.isfinite(both), both, np.where(np.isfinite(data[first]), data[first], moved))
    return replace(data, columns=columns, warnings=tuple(warnings)), shares


def _at_the_first(data: FlightData, first: str, vehicle: Vehicle) -> Array:
    """The second vane's reading as the first one would read it."""
    here, there = vehicle.sensors[f"{first}_vane"], vehicle.sensors[f"{first}2_vane"]
    x, y, z = np.subtract(here.position, there.position)
    speed = np.maximum(data["airspeed"], 1.0)
    values = data[PAIRS[first]]
    if first == "alpha":
        return np.asarray(values - x * data["q"] / speed + y * data["p"] / speed)
    values = _as_kind(values, there, here, data.columns.get("alpha", np.zeros(values.size)))
    return np.asarray(values + x * data["r"] / speed - z * data["p"] / speed)


def _as_kind(values: Array, there: Sensor, here: Sensor, alpha: Array) -> Array:
    """Between asin(v / V) and atan(v / u): tan(flank) = tan(beta) / cos(alpha)."""
    if there.kind == here.kind:
        return values
    cosine = np.cos(np.nan_to_num(alpha))
    return np.asarray(np.arctan(np.tan(values) * (cosine if there.kind == "flank" else 1.0 / cosine)))


def _noise(values: Array, interval_s: float) -> float:
    return max(noise_sigma(values[np.isfinite(values)], interval_s), 1e-5)


def _disagreement(one: Array, two: Array, name: str) -> str:
    """In words how the second vane differs from what the first one would read there, empty where both may be right."""
    good = np.isfinite(one) & np.isfinite(two)
    if np.count_nonzero(good) < 50:
        return "they hardly ever read at the same time"
    difference, expected = (two - one)[good], one[good]
    design = np.column_stack([np.ones(expected.size), expected])
    (offset, slope), *_ = np.linalg.lstsq(design, difference, rcond=None)
    rest = float(np.std(difference - design @ (offset, slope)))
    std = rest * np.sqrt(np.diag(inverse(design.T @ design)))
    differences = []
    if abs(offset) > SENSOR_ERRORS[f"{name}_bias"][3] + 3.0 * std[0]:
        differences.append(f"it reads {np.degrees(offset):+.1f} deg more")
    if abs(slope) > SENSOR_ERRORS[f"{name}_scale"][3] + 3.0 * std[1]:
        differences.append(f"its scale is {1.0 + slope:.2f} of the other's")
    return " and ".join(differences)
