"""The parts of a flight that are informative: in the air, and excited."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sysid.arrays import Array
from sysid.errors import SegmentError
from sysid.signals.flight import FlightData

Mask = NDArray[np.bool_]

RATES = ("p", "q", "r")
SURFACES = {"de": "longitudinal", "da": "lateral", "dr": "lateral"}
# Any of these missing at a sample makes the sample useless to every estimator.
_ESSENTIAL = ("ax", "ay", "az", "p", "q", "r", "airspeed", "phi", "theta", "de", "da", "dr")

MIN_AIRSPEED = 3.0  # m/s: below it a propeller aircraft stands, and the airspeed is noise
AIRBORNE_SHARE = 0.5  # of the flight's own high airspeed (90th percentile)
SLOW_FLIGHT_S = 3.0  # no aircraft lands and takes off again in less
GROUND_MARGIN_S = 3.0  # left out after a take-off and before a landing
SURFACE_FLOOR = np.deg2rad(0.4)  # travel of a surface within one second that counts as a command
RATE_FLOOR = np.deg2rad(4.0)  # change of a body rate within one second that counts as a response, rad/s
THROTTLE_FLOOR = 0.1
LEAD_S = 1.0  # trimmed flight kept before the first input
TAIL_S = 3.0  # the free response kept after the last one
MERGE_S = 3.0
MIN_LENGTH_S = 4.0
WINDOW_S, WINDOW_SHARE = 0.8, 0.7  # a record that is shorter itself is a window: so much of it, and so long
WHOLE_SHARE = 0.7  # an airborne part excited for more than this share is taken whole
SHORT_FLIGHT_S = 30.0  # so is one that is short altogether: trimmed samples determine the sensor biases


@dataclass(frozen=True)
class FlightSegment:
    """One part of a flight.

    start_s, end_s: s, on the flight's own time base. kind: "longitudinal", "lateral", "combined", "throttle"
    or "steady". reason: what was seen, in words. start, stop: sample indices for FlightData.window.
    """

    start_s: float
    end_s: float
    kind: str
    reason: str
    start: int
    stop: int


def find_segments(
    data: FlightData, min_length_s: float = MIN_LENGTH_S, require_excited: bool = True
) -> list[FlightSegment]:
    """Find the airborne, excited parts of a flight.

    data: needs `airspeed` (m/s; else `vn ve`), body rates, and the surfaces `de da dr` where known; `altitude`
        or `height` (m), where present, distinguishes take-off roll and landing from flight.
    min_length_s: shortest part given, s; of a record that begins and ends in the air and is not much longer itself
        WINDOW_SHARE of it, WINDOW_S at least.
    require_excited: if no part is excited, True raises and False gives the airborne parts as kind "steady".
    Returns the parts in order of time, without overlap and without gaps in the data.
    Raises SegmentError in one line if the flight holds none.
    """
    interval = data.interval_s
    airborne = airborne_mask(data)
    usable = airborne & _complete(data)
    if airborne[0] and airborne[-1]:
        min_length_s = min(min_length_s, max(WINDOW_SHARE * usable.size * interval, WINDOW_S))
    runs = [run for run in _runs(usable) if (run[1] - run[0]) * interval >= min_length_s]
    if not runs:
        raise SegmentError(
            f"{data.name}: no airborne part of {min_length_s:.2g} s without gaps in {_present(data)};"
            " give the part by --from and --to"
        )
    activity = _activity(data, usable)
    any_activity = np.logical_or.reduce(list(activity.values()))
    segments: list[FlightSegment] = []
    for start, stop in runs:
        for first, last in _excited_parts(any_activity[start:stop], interval, min_length_s):
            segments.append(_describe(data, start + first, start + last, activity))
    if segments:
        return segments
    longest = max(runs, key=lambda run: run[1] - run[0])
    if require_excited:
        raise SegmentError(
            f"{data.name}: airborne from {data.time_s[longest[0]]:.1f} to {data.time_s[longest[1] - 1]:.1f} s,"
            " but no surface moved and no rate changed; fly pulses or a multisine, or give --from and --to"
        )
    return [_describe(data, start, stop, activity) for start, stop in runs]


def airborne_mask(data: FlightData) -> Mask:
    """(N,) whether the aircraft flies: fast enough, off the ground, take-off roll and landing left out.

    Raises SegmentError if the flight has no speed to judge by, or never is fast enough.
    """
    speed = _speed(data)
    high = float(np.nanpercentile(speed, 90.0))
    if high < MIN_AIRSPEED:
        raise SegmentError(
            f"{data.name}: the airspeed stays below {MIN_AIRSPEED:g} m/s (90 % of the time under {high:.1f}):"
            " the aircraft never flew, or the airspeed is not calibrated"
        )
    fast = np.nan_to_num(speed, nan=0.0) > max(AIRBORNE_SHARE * high, MIN_AIRSPEED)
    interval = data.interval_s
    # A gust at rest is no take-off; slow flight over the top of a pull-up, or a stall, is no landing.
    rest, top = max(round(1.0 / interval), 1), max(round(SLOW_FLIGHT_S / interval), 1)
    fast = ndimage.binary_opening(np.pad(fast, top, mode="edge"), np.ones(rest, dtype=bool))
    fast = ndimage.binary_closing(fast, np.ones(top, dtype=bool))[top:-top]
    above = _above_ground(data, fast)
    margin = round(GROUND_MARGIN_S / interval)
    flying = np.zeros(fast.size, dtype=bool)
    for start, stop in _runs(fast):
        # The record's own ends are no take-off or landing.
        first = start if start == 0 else _lift_off(above, start, stop, margin, 1)
        last = stop if stop == fast.size else _lift_off(above, start, stop, margin, -1)
        flying[first : max(last, first)] = True
    return flying & ~_still(data)


def _speed(data: FlightData) -> Array:
    if "airspeed" in data and np.any(np.isfinite(data["airspeed"])):
        speed = data["airspeed"]
    elif "vn" in data and "ve" in data and np.any(np.isfinite(data["vn"] + data["ve"])):
        speed = np.hypot(data["vn"], data["ve"])
    else:
        raise SegmentError(f"{data.name}: no airspeed and no GPS velocity to distinguish flight from standing by")
    valid = np.isfinite(speed)
    filled = np.interp(data.time_s, data.time_s[valid], speed[valid])
    size = max(round(0.5 / data.interval_s), 1)
    return np.asarray(ndimage.uniform_filter1d(filled, size, mode="nearest"), dtype=np.float64)


def _above_ground(data: FlightData, fast: Mask) -> Mask | None:
    """Whether the aircraft is at least 1.5 m above where it last stood; None where it is not known."""
    if "height" in data and np.isfinite(data["height"]).mean() > 0.9:
        return np.asarray(np.nan_to_num(data["height"], nan=np.inf) > 1.0)
    if "altitude" not in data or not np.any(~fast & np.isfinite(data["altitude"])):
        return None
    ground = float(np.nanmedian(data["altitude"][~fast]))
    return np.asarray(np.nan_to_num(data["altitude"], nan=np.inf) > ground + 1.5)


def _lift_off(above: Mask | None, start: int, stop: int, margin: int, direction: int) -> int:
    """Index where flight begins (direction 1) or ends (-1) within a fast run."""
    if above is not None and np.any(above[start:stop]):
        off = np.flatnonzero(above[start:stop])
        margin //= 3
        return start + int(off[0]) + margin if direction > 0 else start + int(off[-1]) + 1 - margin
    return start + margin if direction > 0 else stop - margin


def _still(data: FlightData) -> Mask:
    """Parts where attitude and rates do not move at all over 2 s: standing, whatever a wind makes of the airspeed."""
    size = max(round(2.0 / data.interval_s), 3)
    still = np.ones(data.time_s.size, dtype=bool)
    used = False
    for name in (*RATES, "phi", "theta"):
        if name in data and np.isfinite(data[name]).any():
            used = True
            # 0.02 deg/s and 0.02 deg within 2 s: below any aircraft in the air, above a converter's last bit.
            still &= _travel(data[name], size) < np.deg2rad(0.02)
    return still if used else np.zeros(data.time_s.size, dtype=bool)


def _complete(data: FlightData) -> Mask:
    """Samples at which every essential signal that the flight has carries a value."""
    complete = np.ones(data.time_s.size, dtype=bool)
    for name in _ESSENTIAL:
        if name in data and np.isfinite(data[name]).any():
            complete &= np.isfinite(data[name])
    return complete


def _present(data: FlightData) -> str:
    return " ".join(name for name in _ESSENTIAL if name in data)


def _travel(values: Array, size: int) -> Array:
    """Range (max - min) within a centred window, NaN bridged."""
    valid = np.isfinite(values)
    index = np.arange(values.size)
    filled = np.interp(index, index[valid], values[valid])
    high = ndimage.maximum_filter1d(filled, size, mode="nearest")
    return np.asarray(high - ndimage.minimum_filter1d(filled, size, mode="nearest"), dtype=np.float64)


def _activity(data: FlightData, usable: Mask) -> dict[str, Mask]:
    """Per signal: where its travel within one second is above its quiet level."""
    size = max(round(1.0 / data.interval_s), 3)
    floors: dict[str, float] = {name: float(SURFACE_FLOOR) for name in SURFACES} | {"throttle": THROTTLE_FLOOR}
    floors |= {name: float(RATE_FLOOR) for name in RATES}
    activity: dict[str, Mask] = {"": np.zeros(data.time_s.size, dtype=bool)}
    for name, floor in floors.items():
        if name not in data or not np.isfinite(data[name]).any():
            continue
        travel = _travel(data[name], size)
        quiet = float(np.percentile(travel[usable], 10.0))
        # Half of the largest at most: a flight that is excited throughout has no quiet part.
        level = max(floor, min(2.5 * quiet, 0.5 * float(travel[usable].max())))
        activity[name] = travel > level
    return activity


def _excited_parts(active: Mask, interval: float, min_length_s: float) -> list[tuple[int, int]]:
    """Index pairs within one airborne run: inputs with the trim before and the response after them."""
    size = active.size
    if not np.any(active):
        return []
    if size * interval <= SHORT_FLIGHT_S or float(active.mean()) > WHOLE_SHARE:
        return [(0, size)]
    lead, tail = round(LEAD_S / interval), round(TAIL_S / interval)
    parts: list[list[int]] = []
    for start, stop in _runs(active):
        first, last = max(start - lead, 0), min(stop + tail, size)
        if parts and first - parts[-1][1] <= MERGE_S / interval:
            parts[-1][1] = last
        else:
            parts.append([first, last])
    shortest = int(np.ceil(min_length_s / interval))
    grown: list[tuple[int, int]] = []
    for first, last in parts:
        lack = max(shortest - (last - first), 0)
        first = max(first - lack // 2, 0)
        last = min(first + max(shortest, last - first), size)
        first = max(min(first, last - shortest), grown[-1][1] if grown else 0)
        if last - first >= shortest:
            grown.append((first, last))
    return grown


def _describe(data: FlightData, start: int, stop: int, activity: dict[str, Mask]) -> FlightSegment:
    moved = [name for name, mask in activity.items() if name and np.any(mask[start:stop])]
    kinds = {SURFACES[name] for name in moved if name in SURFACES}
    if not kinds and "q" in moved:
        kinds.add("longitudinal")
    if not kinds & {"lateral"} and not any(name in moved for name in SURFACES) and {"p", "r"} & set(moved):
        kinds.add("lateral")
    if len(kinds) > 1:
        kind = "combined"
    elif kinds:
        kind = kinds.pop()
    else:
        kind = "throttle" if "throttle" in moved else "steady"
    reason = f"airborne; active: {', '.join(moved)}" if moved else "airborne; nothing moved"
    return FlightSegment(float(data.time_s[start]), float(data.time_s[stop - 1]), kind, reason, start, stop)


def _runs(mask: Mask) -> list[tuple[int, int]]:
    """Start and stop of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]
