"""Flights with one mistake in their signals: wrong unit, sign, axes, scale, or stamps that come late."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.signals.flight import FlightSignals, Signal

Array = NDArray[np.float64]
Change = Callable[[dict[str, Signal]], dict[str, Array]]

GROUPS = {
    "accelerometers": ("ax", "ay", "az"), "gyros": ("p", "q", "r"), "imu": ("ax", "ay", "az", "p", "q", "r"),
    "attitude": ("phi", "theta", "psi"), "vanes": ("alpha", "beta"), "air_data": ("airspeed",),
    "gps": ("vn", "ve", "vd"), "commands": ("de", "da", "dr", "throttle"),
}  # fmt: skip
UNITS = {
    "accelerometers": {"g": 1 / 9.80665, "milli-g": 1000 / 9.80665, "ft/s^2": 1 / 0.3048},
    "gyros": {"deg/s": 180 / np.pi, "mrad/s": 1000.0},
    "attitude": {"degrees": 180 / np.pi}, "vanes": {"degrees": 180 / np.pi},
    "air_data": {"km/h": 3.6, "knots": 3600 / 1852, "ft/s": 1 / 0.3048, "mph": 1 / 0.44704},
    "gps": {"cm/s": 100.0, "km/h": 3.6, "knots": 3600 / 1852},
}  # fmt: skip
DELAYS_S = (0.005, 0.02, 0.05, 0.2)
SCALES = (0.9, 1.1, 1.3)


@dataclass(frozen=True)
class Injection:
    """One mistake. signals: those that are wrong. kind: unit, sign, axis, scale or delay. label: size in words.

    change: signals -> the values that a recording would carry. delay_s: by how much their stamps are late.
    """

    signals: tuple[str, ...]
    kind: str
    label: str
    change: Change | None = None
    delay_s: float = 0.0

    @property
    def name(self) -> str:
        """Kind, signals and size as one word."""
        return f"{self.kind}:{'+'.join(self.signals)}:{self.label}"

    def apply(self, flight: FlightSignals) -> FlightSignals:
        """The flight as recorded with this mistake."""
        signals = dict(flight.signals)
        if self.change is not None:
            signals |= {name: replace(signals[name], values=v) for name, v in self.change(signals).items()}
        for name in self.signals if self.delay_s else ():
            if name in signals:
                signals[name] = replace(signals[name], time_s=signals[name].time_s + self.delay_s)
        return replace(flight, signals=signals)


def times(names: tuple[str, ...], factor: float) -> Change:
    """All of `names` multiplied."""
    return lambda signals: {name: factor * signals[name].values for name in names if name in signals}


def _exchanged(one: str, other: str) -> Change:
    return lambda signals: {one: signals[other].values, other: signals[one].values}


def _cycled(names: tuple[str, ...]) -> Change:
    return lambda signals: {a: signals[b].values for a, b in zip(names, (*names[1:], names[0]), strict=True)}


def _gravity(multiple: float) -> Change:
    """Accelerations with a multiple of gravity on top of specific force."""

    def change(signals: dict[str, Signal]) -> dict[str, Array]:
        time = signals["ax"].time_s
        phi, theta = (np.interp(time, signals[n].time_s, signals[n].values) for n in ("phi", "theta"))
        along = (-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi))
        return {n: signals[n].values + multiple * 9.80665 * g for n, g in zip(("ax", "ay", "az"), along, strict=True)}

    return change


def _east_north_up(signals: dict[str, Signal]) -> dict[str, Array]:
    return {"vn": signals["ve"].values, "ve": signals["vn"].values, "vd": -signals["vd"].values}


def injections() -> list[Injection]:
    """Every kind of mistake in every signal, in several sizes."""
    found: list[Injection] = []
    sensors = {name: names for name, names in GROUPS.items() if name not in ("imu", "commands")}
    for group, units in UNITS.items():
        for unit, factor in units.items():
            sets = {GROUPS[group], *((name,) for name in GROUPS[group])}
            found += [Injection(names, "unit", unit, times(names, factor)) for names in sorted(sets)]
    singles = [name for names in sensors.values() for name in names]
    found += [Injection((name,), "sign", "-1", times((name,), -1.0)) for name in singles if name != "airspeed"]
    for names in (("ax", "ay", "az"), ("q", "r"), ("ay", "az"), ("ay", "az", "q", "r")):
        found.append(Injection(names, "sign", "-1", times(names, -1.0)))
    pairs = [("ax", "ay"), ("ax", "az"), ("ay", "az"), ("p", "q"), ("p", "r"), ("q", "r"), ("phi", "theta")]
    for one, other in (*pairs, ("alpha", "beta"), ("vn", "ve")):
        found.append(Injection((one, other), "axis", "exchanged", _exchanged(one, other)))
    for group in ("accelerometers", "gyros"):
        found.append(Injection(GROUPS[group], "axis", "cycled", _cycled(GROUPS[group])))
    found.append(Injection(GROUPS["accelerometers"], "axis", "no gravity", _gravity(1.0)))
    found.append(Injection(GROUPS["accelerometers"], "axis", "gravity sign", _gravity(2.0)))
    found.append(Injection(GROUPS["gps"], "axis", "ENU", _east_north_up))
    for factor in SCALES:
        found += [Injection((name,), "scale", f"{factor:g}", times((name,), factor)) for name in singles]
    late = [*GROUPS.values(), *((name,) for name in singles if name not in ("airspeed", "vn", "ve", "vd"))]
    for delay in DELAYS_S:
        found += [Injection(names, "delay", f"{delay * 1e3:g} ms", None, delay) for names in late]
    return found
