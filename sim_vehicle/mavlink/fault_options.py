"""Faults on request: what `--fault KEY=VALUE[,KEY=VALUE...]` may say, and in which ranges."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from sim_vehicle.errors import SimVehicleError

LATE_S = 0.05  # s, the longest further delay of a late burst unless given


class FaultError(SimVehicleError):
    """A fault that does not exist, or a value outside its range."""


@dataclass(frozen=True)
class Faults:
    """Faults of a vehicle's link and clock; none by default.

    Shares are of 1: of frames for loss, duplicate, reorder and garbage, of bursts (what leaves at one instant)
    for late, of bits for corrupt. Times are s of flight. drift_ppm: how much too fast the vehicle's clock runs.
    """

    loss: float = 0.0
    delay: float = 0.0
    jitter: float = 0.0
    late: float = 0.0
    late_s: float = LATE_S
    duplicate: float = 0.0
    reorder: float = 0.0
    corrupt: float = 0.0
    garbage: float = 0.0
    drift_ppm: float = 0.0
    outages: tuple[tuple[float, float], ...] = ()
    resets: tuple[float, ...] = ()

    @property
    def on_link(self) -> bool:
        """Whether anything happens to frames on their way."""
        return replace(self, drift_ppm=0.0, resets=(), late_s=LATE_S) != Faults()

    def of_requests(self) -> Faults:
        """What happens on the way up: the same, but that nothing is damaged or put in another order."""
        return replace(self, reorder=0.0, corrupt=0.0, garbage=0.0)


# Largest values, and what they are in. A day is longer than any flight.
_LARGEST: dict[str, tuple[float, str]] = {
    "loss": (1.0, "a share of frames"),
    "delay": (60.0, "seconds"),
    "jitter": (10.0, "seconds"),
    "late": (1.0, "a share of bursts, or SHARE:SECONDS"),
    "duplicate": (1.0, "a share of frames"),
    "reorder": (1.0, "a share of frames"),
    "corrupt": (0.1, "a share of bits"),
    "garbage": (1.0, "a share of frames"),
}
_LARGEST_LATE_S = 60.0
_LARGEST_PPM = 10_000.0
NAMES = (*_LARGEST, "outage", "drift-ppm", "clock-reset")


def read_faults(texts: Sequence[str]) -> Faults:
    """Faults named in the texts. Raises FaultError, one line saying which values there are."""
    found = Faults()
    for item in (item for text in texts for item in text.split(",")):
        name, equals, value = item.partition("=")
        if name not in NAMES:
            raise FaultError(f"{item!r}: no such fault; there are {', '.join(NAMES)}")
        if not equals or not value:
            raise FaultError(f"{item}: give {name}=VALUE")
        found = _with(found, item, name, value)
    return found


def _with(found: Faults, item: str, name: str, value: str) -> Faults:
    if name == "outage":
        begin, colon, end = value.partition(":")
        span = (_number(item, begin), _number(item, end)) if colon else (0.0, 0.0)
        if not 0.0 <= span[0] < span[1]:
            raise FaultError(f"{item}: give outage=BEGIN:END, seconds of flight, END after BEGIN")
        return replace(found, outages=(*found.outages, span))
    if name == "clock-reset":
        when = _number(item, value)
        if when <= 0.0:
            raise FaultError(f"{item}: give clock-reset=SECONDS of flight, above 0")
        return replace(found, resets=tuple(sorted({*found.resets, when})))
    if name == "drift-ppm":
        drift = _number(item, value)
        if abs(drift) > _LARGEST_PPM:
            raise FaultError(f"{item}: give drift-ppm from {-_LARGEST_PPM:g} to {_LARGEST_PPM:g}")
        return replace(found, drift_ppm=drift)
    largest, unit = _LARGEST[name]
    share, colon, seconds = value.partition(":") if name == "late" else (value, "", "")
    number, late_s = _number(item, share), _number(item, seconds) if colon else found.late_s
    if not 0.0 <= number <= largest:
        raise FaultError(f"{item}: give {name}={unit}, from 0 to {largest:g}")
    if not 0.0 < late_s <= _LARGEST_LATE_S:
        raise FaultError(f"{item}: give late=SHARE:SECONDS, SECONDS above 0 and up to {_LARGEST_LATE_S:g}")
    values: dict[str, Any] = {"late_s": late_s, name: number}
    return replace(found, **values)


def _number(item: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FaultError(f"{item}: {text!r} is no number")
    return value
