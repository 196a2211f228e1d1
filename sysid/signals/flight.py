"""What a flight is to the estimators: signals on their own time stamps, and the same on one time base."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from sysid.arrays import Array
from sysid.errors import SignalError

if TYPE_CHECKING:
    from sysid.signals.calibration import Calibration


# Source of a rate that no gyro measured.
BY_ATTITUDE = "the attitude's rate of change"


def repeats(values: Array) -> bool:
    """Whether a signal is one value throughout: its sensor is dead or not connected, or nobody fills its field.

    Parameters
    ----------
    values : Array, shape (N,)
        Samples in any unit; those that are not finite are left out.

    Returns
    -------
    bool
        True for at least two finite samples that are all equal.
    """
    known = values[np.isfinite(values)]
    return known.size > 1 and float(np.ptp(known)) == 0.0


# Range of a control of its own name, rad or a share of its travel, below which it has not moved.
_LEAST_RANGE = 0.01


def moved_controls(named: Sequence[str], flights: Iterable[Mapping[str, Array]]) -> list[str]:
    """Those controls of other names than de, da, dr and throttle that have moved: what the others do nobody can see.

    Parameters
    ----------
    named : sequence of str
        The vehicle's controls of other names.
    flights : iterable of Mapping of str to Array, shape (N,) each
        Control -> its deflection, rad or a share of its travel, of each flight.

    Returns
    -------
    list of str
        Names in the order given. One that stands elsewhere in each flight has moved.
    """
    seen: dict[str, list[float]] = {}
    for flight in flights:
        for name in named:
            values = flight.get(name, np.zeros(0))
            seen.setdefault(name, []).extend(values[np.isfinite(values)])
    return [name for name in named if seen.get(name) and float(np.ptp(seen[name])) > _LEAST_RANGE]


def standing_controls(named: Sequence[str], flights: Iterable[Mapping[str, Array]]) -> list[str]:
    """A line for each control of another name that stood somewhere else than at 0 throughout: what it did is in the
    constants.

    Parameters
    ----------
    named : sequence of str
        The vehicle's controls of other names.
    flights : iterable of Mapping of str to Array, shape (N,) each
        As for `moved_controls`.

    Returns
    -------
    list of str
        One line each.
    """
    flights = list(flights)
    moved = moved_controls(named, flights)
    lines = []
    for name in (one for one in named if one not in moved):
        values = np.concatenate([np.zeros(0), *(one[name] for one in flights if name in one)])
        at = float(np.nanmedian(values)) if np.isfinite(values).any() else 0.0
        if abs(at) > _LEAST_RANGE:
            lines.append(
                f"{name} stood at {at:.2g} throughout: what it does is in CL_0, CD_0, Cm_0 and their like; the model"
                " holds for that setting"
            )
    return lines


# Nobody flies test inputs in so many seconds.
_NO_FLIGHT_S = 10.0


@dataclass(frozen=True)
class Signal:
    """One measured quantity on the stamps of the messages that carried it.

    time_s: (N,) seconds from the flight's first stamp, vehicle's clock, non-decreasing.
    values: (N,) SI units, radians; NaN where the sensor reported no value.
    unit: unit of `values`, as "rad/s".
    source: where it came from, as "HIGHRES_IMU.xgyro".
    calibration: the bench curve it went through, if any.
    """

    time_s: Array
    values: Array
    unit: str
    source: str
    calibration: Calibration | None = None

    @property
    def rate_hz(self) -> float:
        """Mean sample rate, 0 for fewer than two samples."""
        if self.time_s.size < 2 or self.time_s[-1] <= self.time_s[0]:
            return 0.0
        return float((self.time_s.size - 1) / (self.time_s[-1] - self.time_s[0]))


@dataclass(frozen=True)
class FlightSignals:
    """Every signal of one flight, by the names of the signal table (ax, alpha, servo2, de, ...), before resampling.

    sender: what the recording says of who flew (system, type, mav_type, autopilot); empty where it says nothing.
    """

    name: str
    signals: dict[str, Signal]
    warnings: tuple[str, ...] = ()
    sender: Mapping[str, object] = field(default_factory=dict)

    def require(self, *names: str) -> None:
        """Raise SignalError naming every signal of `names` that the flight does not have."""
        missing = [name for name in names if name not in self.signals]
        if missing:
            there = ", ".join(self.signals)
            span = [signal.time_s[[0, -1]] for signal in self.signals.values() if signal.time_s.size]
            lasts = max(one[1] for one in span) - min(one[0] for one in span) if span else 0.0
            short = f"the recording lasts {lasts:.1f} s only, and has" if lasts < _NO_FLIGHT_S else "the recording has"
            raise SignalError(
                f"{self.name}: no signal {', '.join(missing)}: have the vehicle send or log it; {short} {there}"
            )


def finite(signals: FlightSignals, name: str, begin: float = -np.inf, end: float = np.inf) -> tuple[Array, Array]:
    """Samples of a signal that carry a number, in the order of their stamps.

    Parameters
    ----------
    signals : FlightSignals
        A flight.
    name : str
        The signal.
    begin, end : float
        From where to where, s.

    Returns
    -------
    time_s : Array, shape (N,)
        Stamps, s, each later than the one before; empty where the flight has no such signal.
    values : Array, shape (N,)
        In the signal's unit.
    """
    if name not in signals.signals:
        return np.zeros(0), np.zeros(0)
    one = signals.signals[name]
    good = np.isfinite(one.time_s) & np.isfinite(one.values) & (one.time_s >= begin) & (one.time_s <= end)
    time_s, values = one.time_s[good], one.values[good]
    later = np.concatenate(([True], np.diff(np.maximum.accumulate(time_s)) > 0.0)) if time_s.size else good[:0]
    return time_s[later], values[later]


@dataclass(frozen=True)
class FlightData:
    """One flight on one uniform time base.

    time_s: (N,) uniform, step `interval_s`.
    columns: name -> (N,) values; NaN where no sample is near enough to be trusted.
    """

    name: str
    interval_s: float
    time_s: Array
    columns: dict[str, Array]
    warnings: tuple[str, ...] = ()
    notes: dict[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def window(self, start: int, stop: int) -> FlightData:
        """The samples start..stop-1 as a flight of its own (views, nothing copied)."""
        columns = {name: values[start:stop] for name, values in self.columns.items()}
        return FlightData(self.name, self.interval_s, self.time_s[start:stop], columns, self.warnings, self.notes)
