"""A thrust of zero, throughout, on which the flight could not have stayed up: a dead sensor, or a column left empty.

Drag is thrust less what the aircraft gains: by energy D / W = T / W - (g dh + V dV) / (g V dt), along the path, and by
the accelerometers D = T cos(alpha) - m (ax cos(alpha) + az sin(alpha)) (Klein & Morelli, Aircraft System
Identification, 2nd ed., 2016, eqs. 3.36 and 5.2). What rises with the air, gliding, keeps its height too: a vane and
the accelerometers show its drag. Without them, or with a vane that is a degree or two off, it is not distinguished from
a dead sensor, and its drag is refused rather than believed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim_vehicle.constants import STANDARD_GRAVITY
from sysid.arrays import Array
from sysid.signals.flight import FlightSignals, repeats
from sysid.signals.preparation import Prepared, Stretch

# No aircraft glides further than so many times its height; and the drag over lift that accelerometers and a vane, with
# their zeros, may show of one without thrust, at least.
_BEST_GLIDE, _LEAST_FELT = 60.0, 0.03
# Error of a height, m, at either end of a stretch.
_HEIGHT_M = 1.0
_HEIGHTS = ("height", "altitude", "gps_altitude")


def without_dead_thrust(signals: FlightSignals, prepared: Prepared) -> FlightSignals:
    """The flight without the signal that its thrust is taken from, where that is zero throughout and cannot be.

    prepared: the same flight. Itself where nothing is wrong, or nothing shows it.
    """
    name = prepared.thrust_source.signal
    if name not in signals.signals or not _is_zero(signals.signals[name].values):
        return signals
    gained, doubt = _by_energy(prepared)
    felt = _by_accelerometers(prepared) if {"ax", "az"} <= signals.signals.keys() else None
    if not (-gained + 2.0 * doubt < 1.0 / _BEST_GLIDE and (felt is None or felt < _LEAST_FELT)):
        return signals
    kept = {key: one for key, one in signals.signals.items() if key != name}
    words = (
        f"{name} is 0 throughout, and without thrust this flight would have lost height or speed (it would glide more"
        f" than {_BEST_GLIDE:.0f} times its height): the column was never filled, or its sensor is dead; it is left out"
    )
    return replace(signals, signals=kept, warnings=(*signals.warnings, words))


def _is_zero(values: Array) -> bool:
    finite = values[np.isfinite(values)]
    return finite.size > 1 and repeats(values) and float(finite[0]) == 0.0


def _by_energy(prepared: Prepared) -> tuple[float, float]:
    """Thrust less drag over the weight, mean along the paths, and its standard error, infinite without a height."""
    gained, path, ends = 0.0, 0.0, 0
    for stretch in prepared.stretches:
        height, speed = height_of(stretch), stretch.data["airspeed"] * prepared.layout.airspeed_factor
        good = np.isfinite(speed) if height is None else np.isfinite(speed) & np.isfinite(height)
        if height is None or np.count_nonzero(good) < 2:
            continue
        first, last = np.flatnonzero(good)[[0, -1]]
        kinetic = (speed[last] ** 2 - speed[first] ** 2) / (2.0 * STANDARD_GRAVITY)
        gained += float(height[last] - height[first] + kinetic)
        path += float(np.nanmean(speed)) * float(stretch.data.time_s[last] - stretch.data.time_s[first])
        ends += 2
    return (gained / path, _HEIGHT_M * float(np.sqrt(ends)) / path) if path > 0.0 else (0.0, np.inf)


def height_of(stretch: Stretch) -> Array | None:
    """Height along a stretch, by a barometer or GPS, else by the vertical speed.

    Parameters
    ----------
    stretch : Stretch
        With N samples.

    Returns
    -------
    Array, shape (N,), or None
        m, from any level, NaN where nothing was read; None without any.
    """
    for name in _HEIGHTS:
        if name in stretch.data and np.isfinite(stretch.data[name]).sum() > 1:
            return np.asarray(stretch.data[name])
    if "vd" not in stretch.data or np.isfinite(stretch.data["vd"]).sum() < 2:
        return None
    down, time_s = stretch.data["vd"], stretch.data.time_s
    good = np.isfinite(down)
    return np.asarray(-np.cumsum(np.interp(time_s, time_s[good], down[good])) * stretch.data.interval_s)


def _by_accelerometers(prepared: Prepared) -> float | None:
    """Drag over lift that accelerometers feel where there is no thrust; None without a vane."""
    drag, lift = [], []
    for stretch in prepared.stretches:
        if "alpha" not in stretch.data:
            return None
        ax, az, alpha = (stretch.data[name] for name in ("ax", "az", "alpha"))
        drag.append(-(ax * np.cos(alpha) + az * np.sin(alpha)))
        lift.append(ax * np.sin(alpha) - az * np.cos(alpha))
    return float(np.nanmean(np.concatenate(drag)) / np.nanmean(np.concatenate(lift)))
