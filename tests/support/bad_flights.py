"""What goes wrong on real flights, done to the signals of a good one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sysid.signals.flight import FlightSignals, Signal

Array = NDArray[np.float64]
Change = Callable[[Signal], Signal]

MEASURED = ("ax", "ay", "az", "p", "q", "r", "phi", "theta", "psi", "airspeed", "alpha", "beta", "thrust")
GPS = ("lat", "lon", "vn", "ve", "vd")


def changed(signals: FlightSignals, change: Change, *names: str) -> FlightSignals:
    """The flight with `change` done to the signals named; to all where none is."""
    touched = {
        name: change(signals.signals[name]) for name in names or tuple(signals.signals) if name in signals.signals
    }
    return replace(signals, signals={**signals.signals, **touched})


def without(signals: FlightSignals, *names: str) -> FlightSignals:
    """The flight without these signals."""
    return replace(signals, signals={name: entry for name, entry in signals.signals.items() if name not in names})


def frozen(signal: Signal) -> Signal:
    """The sensor repeats its first reading."""
    return replace(signal, values=np.full_like(signal.values, signal.values[0]))


def empty(signal: Signal) -> Signal:
    """The sensor never has a value."""
    return replace(signal, values=np.full_like(signal.values, np.nan))


def lost_halfway(signal: Signal) -> Signal:
    """The sensor has no values in the second half."""
    return replace(
        signal, values=np.where(np.arange(signal.values.size) < signal.values.size // 2, signal.values, np.nan)
    )


def spiked(signal: Signal, height: float = 1e6) -> Signal:
    """One reading is far off."""
    values = signal.values.copy()
    values[values.size // 3] = height
    return replace(signal, values=values)


def no_clock(signal: Signal) -> Signal:
    """Every stamp is the same."""
    return replace(signal, time_s=np.full_like(signal.time_s, 3.0))


def stamped_twice(signal: Signal) -> Signal:
    """Every reading came twice."""
    return replace(signal, time_s=np.repeat(signal.time_s, 2), values=np.repeat(signal.values, 2))


def zero(signal: Signal) -> Signal:
    """The sensor reads nothing."""
    return replace(signal, values=np.zeros_like(signal.values))


def first(signals: FlightSignals, seconds: float) -> FlightSignals:
    """The first seconds of the flight."""
    return changed(
        signals,
        lambda entry: replace(
            entry, time_s=entry.time_s[entry.time_s < seconds], values=entry.values[entry.time_s < seconds]
        ),
    )


def cases(good: FlightSignals) -> dict[str, FlightSignals]:
    """Every bad flight that one good flight can be made into, by name."""
    dead = {f"{name} frozen": changed(good, frozen, name) for name in MEASURED}
    mute = {f"{name} without values": changed(good, empty, name) for name in MEASURED}
    peaks = {
        f"{name} with a spike": changed(good, spiked, name) for name in (*MEASURED, "vn", "air_density", "throttle")
    }
    return {
        **dead,
        **mute,
        **peaks,
        "all without values": changed(good, empty),
        "no clock": changed(good, no_clock),
        "stamped twice": changed(good, stamped_twice),
        "GPS lost": without(good, *GPS),
        "GPS lost halfway": changed(good, lost_halfway, *GPS),
        "airspeed reads zero": changed(good, zero, "airspeed"),
        "elevator frozen": changed(good, frozen, "de"),
        "rudder frozen": changed(good, frozen, "dr"),
        "no surfaces": without(good, "de", "da", "dr"),
        "no vanes": without(good, "alpha", "beta"),
        "ten seconds": first(good, 10.0),
    }
