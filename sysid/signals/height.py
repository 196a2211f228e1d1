"""Height along a flight."""

from __future__ import annotations

import numpy as np

from sysid.arrays import Array
from sysid.numerics.smoothing import fourier_smooth
from sysid.signals.flight import FlightData

# A recording begins on the ground if the airspeed stays below this through so long, m/s, s.
_STANDING_SPEED, _STANDING_S = 3.0, 1.0
# Small aircraft change their height in this band.
_BAND_HZ = 2.0
_PRESENT = 0.9
_FEWEST = 16  # samples that can be smoothed


def height_above_ground(data: FlightData) -> Array:
    """(N,) m, smoothed without lag; (0,) where it is not known.

    A rangefinder's `height` counts before the altitude, which is taken above where the recording began if the aircraft
    stood there.
    """
    if _there(data, "height"):
        return _smooth(data["height"], data.interval_s)
    standing = slice(0, max(round(_STANDING_S / data.interval_s), 1))
    if not _there(data, "altitude") or not _there(data, "airspeed"):
        return np.zeros(0)
    speed, ground = data["airspeed"][standing], data["altitude"][standing]
    if not np.isfinite(speed).any() or not np.isfinite(ground).any() or np.nanmax(speed) > _STANDING_SPEED:
        return np.zeros(0)
    return _smooth(data["altitude"] - np.nanmedian(ground), data.interval_s)


def height_in_flight(data: FlightData) -> Array:
    """(N,) m above the middle of the flight, smoothed without lag; (0,) where it is not known.

    Recorded altitude counts before the integral of the velocity over ground.
    """
    if _there(data, "altitude"):
        height = _smooth(data["altitude"], data.interval_s)
    elif "vd" in data and np.isfinite(data["vd"]).sum() >= _FEWEST:
        height = -data.interval_s * np.cumsum(_bridged(data["vd"]))
    else:
        return np.zeros(0)
    return np.ascontiguousarray(height - np.median(height))


def _there(data: FlightData, name: str) -> bool:
    return name in data and float(np.isfinite(data[name]).mean()) > _PRESENT


def _smooth(values: Array, interval_s: float) -> Array:
    """Values with their gaps bridged, without the sensor's noise."""
    bridged = _bridged(values)
    if values.size < _FEWEST or np.ptp(bridged) == 0.0:
        return bridged
    return np.ascontiguousarray(fourier_smooth(bridged, interval_s, _BAND_HZ).values)


def _bridged(values: Array) -> Array:
    good = np.isfinite(values)
    place = np.arange(values.size)
    return np.ascontiguousarray(np.interp(place, place[good], values[good]))
