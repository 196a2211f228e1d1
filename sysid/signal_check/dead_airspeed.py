"""Airspeed whose sensor gives one value throughout: believed where the motion bears it out, else made from GPS.

The velocity over ground is that through the air and the wind together, v_g = V d + w, with d the direction of flight by
attitude and vanes (Klein & Morelli, Aircraft System Identification, 2nd ed., 2016, chapter 10). What of v_g stands
across d gives the wind; how fast the speed changes, the accelerometers say.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import SignalError
from sysid.numerics.normal_equations import inverse
from sysid.signals.flight import FlightSignals, Signal, finite, repeats

BY_GPS = "GPS velocity, wind and accelerometers"
# Grid on which speeds are put together, s, and the frequency below which GPS is believed, above it accelerometers, Hz.
_STEP_S, _CROSSING_HZ = 0.04, 0.05
# A speed whose changes are smaller than this share is constant.
_CONSTANT = 0.02
# How strong a wind usually is, m/s, and how far, as a share of the speed, attitude and gusts turn the direction of
# flight away from what is taken for it, in samples that have nothing to do with one another any more, s apart.
_USUAL_WIND, _ASTRAY, _APART_S = 4.0, 0.06, 2.0
# What is known at best of such a speed, and of one that nothing else is known of, shares.
_LEAST_STD, _BY_ITSELF_STD, _NEAR_USUAL = 0.02, 0.15, 0.3
_LEAST_SPEED = 3.0
_NEEDED = ("ax", "ay", "az", "phi", "theta")


@dataclass(frozen=True)
class Airflow:
    """A flight whose airspeed may be used. scale_std: by what share all of it may be wrong, 0 where it is measured."""

    signals: FlightSignals
    scale_std: float


def with_airspeed(signals: FlightSignals, vehicle: Vehicle) -> Airflow:
    """The flight with an airspeed that its motion bears out, where the sensor repeats one value.

    Raises SignalError where nothing says how fast the aircraft flew.
    """
    read = signals.signals.get("airspeed")
    if read is None or not repeats(read.values):
        return Airflow(signals, 0.0)
    level = float(read.values[np.isfinite(read.values)][0])
    time_s = _grid(signals)
    by_motion = _speed_changes(signals, time_s, vehicle) if time_s.size else None
    by_gps = _speed_by_gps(signals, time_s) if by_motion is not None else None
    if by_gps is not None and by_motion is not None:
        slow, std = by_gps
        speed = np.maximum(slow + by_motion, 0.0)
        density = _density(signals, time_s, vehicle)
        true = level if vehicle.sensors.airspeed.kind == "true" else level * np.sqrt(SEA_LEVEL_DENSITY / density)
        flying = speed > _LEAST_SPEED
        off = np.abs(speed - true)[flying]
        if flying.any() and (np.std(by_motion[flying]) > _CONSTANT * level or np.any(off > 3.0 * std)):
            shown = speed if vehicle.sensors.airspeed.kind == "true" else speed * np.sqrt(density / SEA_LEVEL_DENSITY)
            share = max(std / float(np.median(speed[flying])), _LEAST_STD)
            words = f"its sensor is dead or not connected; {BY_GPS} stand for it, to {share:.1%}"
            return Airflow(_said(signals, words, Signal(time_s, shown, read.unit, BY_GPS)), share)
    if level < _LEAST_SPEED:
        raise SignalError(
            f"{signals.name}: the airspeed repeats one value, {level:.3g} m/s: its sensor is dead or not connected, and"
            " no GPS velocity with accelerometers and attitude can stand for it; have the vehicle log them"
        )
    change = float("inf") if by_motion is None else float(np.std(by_motion)) / level
    if change < _CONSTANT:
        return Airflow(_said(signals, "the accelerometers say that it hardly changed, and it is taken as it is"), 0.0)
    usual = vehicle.flight.airspeed
    if abs(level / usual - 1.0) > _NEAR_USUAL:
        raise SignalError(
            f"{signals.name}: the airspeed repeats one value, {level:.3g} m/s, though the flight's speed changed and"
            f" the vehicle file's airspeed is {usual:.3g} m/s: its sensor is dead; log GPS velocity too"
        )
    words = f"its sensor may be dead; it is taken to be right to {_BY_ITSELF_STD:.0%}"
    if by_motion is None:
        return Airflow(_said(signals, words), _BY_ITSELF_STD)
    with_changes = Signal(time_s, level + by_motion, read.unit, read.source)
    return Airflow(_said(signals, words + ", and to change as the accelerometers say", with_changes), _BY_ITSELF_STD)


def _said(signals: FlightSignals, words: str, airspeed: Signal | None = None) -> FlightSignals:
    kept = {**signals.signals, "airspeed": airspeed or signals.signals["airspeed"]}
    return replace(signals, signals=kept, warnings=(*signals.warnings, f"airspeed repeats one value: {words}"))


def _grid(signals: FlightSignals) -> Array:
    """Even times at which all is measured that says how the motion changes; none where something is missing."""
    spans = [found[0] for name in _NEEDED if (found := finite(signals, name))[0].size > 1]
    if len(spans) < len(_NEEDED):
        return np.empty(0)
    begin, end = max(one[0] for one in spans), min(one[-1] for one in spans)
    return np.arange(begin, end, _STEP_S) if end - begin > 1.0 / _CROSSING_HZ / 4.0 else np.empty(0)


def _at(signals: FlightSignals, name: str, time_s: Array, otherwise: float = 0.0) -> Array:
    stamps, values = finite(signals, name)
    if values.size < 2 or repeats(values):
        return np.full(time_s.size, otherwise)
    values = np.unwrap(values) if name in ("phi", "psi") else values
    return np.asarray(np.interp(time_s, stamps, values))


def _density(signals: FlightSignals, time_s: Array, vehicle: Vehicle) -> Array:
    return _at(signals, "air_density", time_s, vehicle.environment.air_density or SEA_LEVEL_DENSITY)


def _speed_changes(signals: FlightSignals, time_s: Array, vehicle: Vehicle) -> Array:
    """(N,) m/s, changes of airspeed faster than `_CROSSING_HZ` by what the accelerometers feel along the path."""
    ax, ay, az, phi, theta, alpha, beta = (_at(signals, name, time_s) for name in (*_NEEDED, "alpha", "beta"))
    g = vehicle.environment.gravity
    along = (ax - g * np.sin(theta)) * np.cos(alpha) * np.cos(beta)
    along += (ay + g * np.cos(theta) * np.sin(phi)) * np.sin(beta)
    along += (az + g * np.cos(theta) * np.cos(phi)) * np.sin(alpha) * np.cos(beta)
    speed = np.concatenate(([0.0], np.cumsum(0.5 * (along[1:] + along[:-1]) * _STEP_S)))
    # Without its line what a wrong zero adds up to is gone, and with it the ends' share in the filter.
    line = np.polynomial.Polynomial.fit(time_s, speed, 1)
    flat = speed - line(time_s)
    return np.asarray(flat - _slow(flat))


def _slow(values: Array) -> Array:
    from scipy.signal import butter, sosfiltfilt  # slow to import

    return np.asarray(sosfiltfilt(butter(1, _CROSSING_HZ * 2.0 * _STEP_S, output="sos"), values))


def _speed_by_gps(signals: FlightSignals, time_s: Array) -> tuple[Array, float] | None:
    """(N,) m/s, the airspeed's slow part by the velocity over ground less the wind, and its standard deviation, m/s."""
    if any(finite(signals, name)[0].size < 2 for name in ("vn", "ve", "psi")):
        return None
    north, east = (_at(signals, name, time_s) for name in ("vn", "ve"))
    theta, psi, beta = (_at(signals, name, time_s) for name in ("theta", "psi", "beta"))
    level, course = np.cos(theta), psi + beta
    dn, de = np.cos(course), np.sin(course)
    fast = np.hypot(north, east) > _LEAST_SPEED
    if not fast.any():
        return None
    # Across the direction of flight there is wind alone; what is known of it beforehand is how strong winds are.
    thin = np.flatnonzero(fast)[:: max(round(_APART_S / _STEP_S), 1)]
    astray = _ASTRAY * float(np.median(np.hypot(north, east)[fast]))
    across = np.column_stack((-de[thin], dn[thin])) / astray
    seen = (north[thin] * -de[thin] + east[thin] * dn[thin]) / astray
    information = across.T @ across + np.eye(2) / _USUAL_WIND**2
    covariance = inverse(information)
    wind = covariance @ (across.T @ seen)
    speed = ((north - wind[0]) * dn + (east - wind[1]) * de) / np.maximum(level, 0.5)
    ahead = np.column_stack((dn[fast], de[fast]))
    std = float(np.sqrt(np.mean(np.einsum("ni,ij,nj->n", ahead, covariance, ahead))))
    return _slow(speed), std
