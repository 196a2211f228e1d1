"""What the battery gave in steady stretches of a flight, beside what the aircraft gained by it.

Over a window thrust times airspeed is drag times airspeed and what height and speed gained,
T V = D V + W d(h + V^2 / 2g) / dt (Anderson, Aircraft Performance and Design, 1999, section 5.10). With the drag of a
model that is the efficiency from battery to air, and an error of the thrust, which is one of that drag too, cancels in
what level flight costs the battery.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from sim_vehicle.constants import STANDARD_GRAVITY
from sysid.signal_check.dead_thrust import height_of
from sysid.signals.preparation import Prepared, Stretch
from sysid.signals.thrust.electric import AT_REST, POWER

# Windows, s: drag at the mean airspeed and load is less than the mean drag, the more of it they change within one. What
# a barometer's noise makes of the height that is gained in so short a time has mean zero. Banked or pulled by more they
# are none.
_WINDOW_S, _MOST_BANK, _LOADS = 0.5, 0.5, (0.75, 1.3)
# Share of the largest power that counts as flight with power, and the most windows that a result keeps.
_LEAST_SHARE, _MOST = 0.1, 400


def power_balance(flights: Sequence[Prepared]) -> dict[str, Any] | None:
    """Steady windows of flights in which the battery was read.

    Parameters
    ----------
    flights : Sequence of Prepared
        Flights as they were estimated from.

    Returns
    -------
    dict or None
        rest: W, what flows with the throttle closed. windows: airspeed, m/s, air_density, kg/m^3, load (lift over
        weight), power of the battery, W, and gained, m/s: how fast height and speed together grew. None without such.
    """
    windows = [one for flight in flights for stretch in flight.stretches for one in _windows(flight, stretch)]
    resting = [one for flight in flights for stretch in flight.stretches for one in _at_rest(stretch)]
    rest = float(np.median(resting)) if resting else 0.0
    most = max((one["power"] for one in windows), default=0.0)
    powered = [one for one in windows if one["power"] - rest > _LEAST_SHARE * (most - rest)]
    if not powered:
        return None
    kept = np.unique(np.linspace(0, len(powered) - 1, min(len(powered), _MOST)).astype(int))
    return {"rest": rest, "windows": [powered[i] for i in kept]}


def _at_rest(stretch: Stretch) -> list[float]:
    if POWER not in stretch.data or "throttle" not in stretch.data:
        return []
    closed = (stretch.data["throttle"] < AT_REST) & np.isfinite(stretch.data[POWER])
    return [float(one) for one in stretch.data[POWER][closed]]


def _windows(flight: Prepared, stretch: Stretch) -> Iterator[dict[str, float]]:
    data, height = stretch.data, height_of(stretch)
    if POWER not in data or "airspeed" not in data or height is None:
        return
    speed = data["airspeed"] * flight.layout.airspeed_factor
    energy = height + speed**2 / (2.0 * STANDARD_GRAVITY)
    size = max(round(_WINDOW_S / data.interval_s), 3)
    read = np.isfinite(data[POWER])
    if not read.any():
        return
    given = np.interp(data.time_s, data.time_s[read], data[POWER][read])
    for begin in range(0, data.time_s.size - size + 1, size):
        inside = slice(begin, begin + size)
        time_s, power = data.time_s[inside], given[inside]
        known = np.isfinite(energy[inside])
        banks = np.abs(data["phi"][inside]) if "phi" in data else np.zeros(size)
        felt = -data["az"][inside] / STANDARD_GRAVITY if "az" in data else np.ones(size)
        if np.count_nonzero(known) < 0.5 * size or not np.isfinite(banks).any() or not np.isfinite(felt).any():
            continue
        if not (np.nanmax(banks) < _MOST_BANK and _LOADS[0] < np.nanmean(felt) < _LOADS[1]):
            continue
        yield {
            "airspeed": float(np.nanmean(speed[inside])),
            "air_density": float(np.mean(stretch.record.rho)),
            # As the turn asks for: an accelerometer's zero would count as weight.
            "load": 1.0 / math.cos(float(np.nanmean(banks))),
            "power": float(np.mean(power)),
            "gained": float(np.polyfit(time_s[known], energy[inside][known], 1)[0]),
        }
