"""Two sensors of one kind: the second as a further measurement of what the first reads.

A vane or a pitot tube away from the centre of gravity feels the rates too (Jolly, Unhelkar & Arya, section III;
`sim_vehicle.vehicle.second_sensors`). The second one's reading is moved to the first one's place and both are averaged
by their noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim_vehicle.vehicle.second_sensors import SECOND_SENSORS, by_place
from sim_vehicle.vehicle.sensors import Sensor
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.numerics.normal_equations import inverse
from sysid.numerics.smoothing import noise_sigma
from sysid.signals.flight import FlightData
from sysid.signals.sensor_errors import SENSOR_ERRORS

PAIRS = {one.of: name for name, one in SECOND_SENSORS.items()}
_NEEDED = ("airspeed", "p", "q", "r")


def combined_sensors(data: FlightData, vehicle: Vehicle) -> tuple[FlightData, dict[str, float]]:
    """The flight with both sensors of a kind in one column, and the share that each of them has in it.

    Two that disagree by more than a cheap sensor's own errors are not averaged: the first counts alone, with a warning.
    A second vane without a first one stands in its place.
    """
    columns, warnings, shares = dict(data.columns), list(data.warnings), dict.fromkeys(PAIRS, 1.0)
    for first, second in PAIRS.items():
        if second not in data or not all(name in data for name in _NEEDED):
            continue
        moved = _at_the_first(data, first, vehicle)
        if first not in data:
            columns[first], shares[first], shares[second] = moved, 0.0, 1.0
            warnings.append(f"{first}: only the second sensor is there; {second} is used")
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
    second = SECOND_SENSORS[PAIRS[first]]
    here, there = vehicle.sensors[second.first], vehicle.sensors[second.key]
    x, y, z = np.subtract(here.position, there.position).tolist()
    values = data[PAIRS[first]]
    speed = np.maximum(data["airspeed"], 1.0)
    if first == "beta":
        values = _as_kind(values, there, here, data.columns.get("alpha", np.zeros(values.size)))
    return np.asarray(values + by_place(first, (x, y, z), (data["p"], data["q"], data["r"]), speed))


def _as_kind(values: Array, there: Sensor, here: Sensor, alpha: Array) -> Array:
    """Between asin(v / V) and atan(v / u): tan(flank) = tan(beta) / cos(alpha)."""
    if there.kind == here.kind:
        return values
    cosine = np.cos(np.nan_to_num(alpha))
    return np.asarray(np.arctan(np.tan(values) * (cosine if there.kind == "flank" else 1.0 / cosine)))


def _plausible(name: str, kind: str) -> float:
    """Size of an error that a cheap sensor may have; of a scale that no table has, that of an airspeed."""
    sizes = {(output, of): size for output, of, _, size in SENSOR_ERRORS.values()}
    return sizes.get((name, kind), sizes["airspeed", "scale"] if kind == "scale" else np.inf)


def _in_words(name: str, value: float) -> str:
    return f"{value:+.1f} m/s" if name == "airspeed" else f"{np.degrees(value):+.1f} deg"


def _noise(values: Array, interval_s: float) -> float:
    return max(noise_sigma(values[np.isfinite(values)], interval_s), 1e-5)


def _disagreement(one: Array, two: Array, name: str) -> str:
    """In words how the second differs from what the first would read there, empty where both may be right."""
    good = np.isfinite(one) & np.isfinite(two)
    if np.count_nonzero(good) < 50:
        return "they hardly ever read at the same time"
    # Over the mean of both, in which the noise of either makes no slope.
    difference, mean = (two - one)[good], 0.5 * (one + two)[good]
    design = np.column_stack([np.ones(mean.size), mean])
    (at_zero, over_mean), *_ = np.linalg.lstsq(design, difference, rcond=None)
    rest = float(np.std(difference - design @ (at_zero, over_mean)))
    std = rest * np.sqrt(np.diag(inverse(design.T @ design)))
    slope = 2.0 * over_mean / (2.0 - over_mean)
    offset = at_zero / (1.0 - 0.5 * over_mean)
    differences = []
    if abs(offset) > _plausible(name, "bias") + 3.0 * std[0]:
        differences.append(f"it reads {_in_words(name, offset)} more")
    if abs(slope) > _plausible(name, "scale") + 3.0 * std[1]:
        differences.append(f"its scale is {1.0 + slope:.2f} of the other's")
    return " and ".join(differences)
