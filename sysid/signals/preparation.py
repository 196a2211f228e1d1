"""From a flight's signals to the stretches that are estimated from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.errors import SegmentError, SignalError
from sysid.signals.calibration import Calibration
from sysid.signals.flight import FlightData, FlightSignals, repeats
from sysid.signals.record import SURFACES, Record, make_records, positions_of
from sysid.signals.redundant_sensors import combined_sensors
from sysid.signals.resampling import resample
from sysid.signals.segments import FlightSegment, find_segments
from sysid.signals.sensor_mounting import SensorMounting, sensor_mounting
from sysid.signals.thrust.source import BATTERY, ThrustSource, dead_thrust, with_motors

NEEDED = ("ax", "ay", "az", "p", "q", "r", "phi", "theta", "airspeed")
# Longest stretch taken as one; more than that per flight is cut up, not left out.
MAX_STRETCH_S = 60.0
# Of a longer flight those stretches are taken in which the surfaces move most, s: what a structure does not hold, which
# no time averages, is the larger part of every standard error by then.
MOST_S = 600.0
# Travel of a surface, rad, after which the aircraft must have moved.
_MOVED = 0.02
# What each surface moves, directly or through the motion it excites.
_MOVED_BY = {
    "de": ("q", "az", "theta", "ax", "alpha"),
    "da": ("p", "phi", "ay", "beta", "psi"),
    "dr": ("r", "ay", "beta", "psi"),
}


@dataclass(frozen=True)
class Stretch:
    """One excited stretch of one flight: its samples as measured, and as a record for simulation."""

    segment: FlightSegment
    data: FlightData
    record: Record


@dataclass(frozen=True)
class Prepared:
    """A flight on one time base with the stretches found in it.

    layout: sensor positions. calibrations: signal -> the bench curve it went through. shares: of two vanes of a kind,
    how much each counts.
    """

    data: FlightData
    stretches: tuple[Stretch, ...]
    layout: SensorMounting
    calibrations: Mapping[str, Calibration]
    shares: Mapping[str, float]

    @property
    def thrust_source(self) -> ThrustSource:
        """Where thrust comes from, the same for all stretches."""
        return self.stretches[0].record.thrust_source

    @property
    def warnings(self) -> tuple[str, ...]:
        return self.data.warnings


def _requested(data: FlightData, start_s: float | None, stop_s: float | None) -> FlightSegment:
    """The part a user asked for. Raises SegmentError where it holds no data."""
    begin = 0 if start_s is None else int(np.searchsorted(data.time_s, start_s))
    end = data.time_s.size if stop_s is None else int(np.searchsorted(data.time_s, stop_s))
    good = np.all([np.isfinite(data[name][begin:end]) for name in NEEDED if name in data], axis=0)
    if end - begin < 2.0 / data.interval_s or good.mean() < 0.5:
        raise SegmentError(
            f"{data.name}: from {start_s or 0.0:g} s to {data.time_s[-1] if stop_s is None else stop_s:g} s there are "
            f"fewer than 2 s of usable samples; the flight lasts {data.time_s[-1]:.1f} s"
        )
    bad = np.nonzero(~good)[0]
    if bad.size:
        edges = np.concatenate(([-1], bad, [good.size]))
        longest = int(np.argmax(np.diff(edges)))
        begin, end = begin + int(edges[longest]) + 1, begin + int(edges[longest + 1])
    return FlightSegment(float(data.time_s[begin]), float(data.time_s[end - 1]), "given", "asked for", begin, end)


def _with_values(signals: FlightSignals) -> FlightSignals:
    """The flight without those signals it can do without that never carry a value, with a warning for each."""
    empty = [
        name for name, signal in signals.signals.items() if not (name in NEEDED or np.isfinite(signal.values).any())
    ]
    if not empty:
        return signals
    kept = {name: signal for name, signal in signals.signals.items() if name not in empty}
    dropped = tuple(f"{name}: the signal carries no value at all; it is left out" for name in empty)
    return FlightSignals(signals.name, kept, (*signals.warnings, *dropped))


def _check_alive(data: FlightData) -> None:
    """Raise SignalError for a sensor that repeats one value while the aircraft moves."""
    for name, surface in _dead(data):
        if name in NEEDED:
            raise SignalError(f"{data.name}: {name} repeats one value while {surface} moves: the sensor is dead")


def _dead(data: FlightData) -> list[tuple[str, str]]:
    """Signals that repeat one value in these samples, each with a surface that moves there and would move them."""
    moving = [s for s in _MOVED_BY if s in data and np.ptp(np.nan_to_num(data[s])) > _MOVED]
    pairs = {name: surface for surface in moving for name in _MOVED_BY[surface] if name in data}
    return [(name, surface) for name, surface in pairs.items() if repeats(data[name])]


def _without_dead(data: FlightData, segments: Sequence[FlightSegment]) -> FlightData:
    """The flight without those signals it can do without that are dead in all its segments, with a warning for each."""
    dead = [dict(_dead(data.window(segment.start, segment.stop))) for segment in segments]
    names = [name for name in dead[0] if name not in NEEDED and all(name in others for others in dead)] if dead else []
    if not names:
        return data
    dropped = tuple(
        f"{n}: repeats one value while {dead[0][n]} moves: the sensor is dead; it is left out" for n in names
    )
    columns = {name: values for name, values in data.columns.items() if name not in names}
    return replace(data, columns=columns, warnings=(*data.warnings, *dropped))


def prepare(
    signals: FlightSignals, vehicle: Vehicle, start_s: float | None = None, stop_s: float | None = None
) -> Prepared:
    """Put a flight on one time base and find its stretches (or take the part from start_s to stop_s).

    Raises SignalError for missing signals, SegmentError where nothing airborne and excited is found.
    """
    signals = _with_values(signals)
    signals.require(*NEEDED)
    data = resample(signals, moving=positions_of(vehicle), named=vehicle.named_controls)
    given = start_s is not None or stop_s is not None
    segments = [_requested(data, start_s, stop_s)] if given else find_segments(data)
    data, shares = combined_sensors(_without_dead(data, segments), vehicle)
    data = with_motors(data, vehicle)
    if "thrust" in data and repeats(data["thrust"]):
        columns, consequence = dict(data.columns), "if that sensor is dead, lift and drag coefficients are wrong"
        if dead_thrust(data["thrust"], data.columns.get("throttle", np.zeros(0))):
            consequence = "though the throttle moves: the sensor is dead; it is left out"
            del columns["thrust"]
        data = replace(
            data, columns=columns, warnings=(*data.warnings, f"thrust: repeats one value throughout; {consequence}")
        )
    spans: list[tuple[FlightSegment, int, int]] = []
    for segment in segments:
        count = max(1, math.ceil((segment.stop - segment.start) * data.interval_s / MAX_STRETCH_S))
        edges = np.linspace(segment.start, segment.stop, count + 1).astype(int).tolist()
        spans += [(segment, a, b) for a, b in pairwise(edges)]
    if not given:
        every = spans
        spans = _most_moved(data, spans)
        if len(spans) < len(every):
            found, used = (sum(b - a for _, a, b in those) * data.interval_s / 60.0 for those in (every, spans))
            limited = (
                f"of {found:.0f} min of excited flight the {used:.0f} min are used in which the surfaces move most"
            )
            data = replace(data, warnings=(*data.warnings, f"{limited}; --from and --to take others"))
    windows = [data.window(a, b) for _, a, b in spans]
    for window in windows:
        _check_alive(window)
    records = make_records(data, vehicle, [(a, b) for _, a, b in spans])
    stretches = [
        Stretch(segment, window, record)
        for (segment, _, _), window, record in zip(spans, windows, records, strict=True)
    ]
    rho = float(np.mean(np.concatenate([stretch.record.rho for stretch in stretches])))
    curves = {name: one.calibration for name, one in signals.signals.items() if one.calibration is not None}
    return Prepared(data, tuple(stretches), sensor_mounting(vehicle, rho), curves, shares)


def _most_moved(data: FlightData, spans: list[tuple[FlightSegment, int, int]]) -> list[tuple[FlightSegment, int, int]]:
    """Spans of samples, MOST_S of them at most: those in which each surface in turn moves most, in order of time."""
    order = [
        sorted(spans, key=lambda span: float(np.nanstd(data[name][span[1] : span[2]])), reverse=True)
        for name in SURFACES
        if name in data
    ]
    kept: list[tuple[FlightSegment, int, int]] = []
    length = 0.0
    for span in (one for turn in zip(*order, strict=True) for one in turn):
        more = (span[2] - span[1]) * data.interval_s
        if span not in kept and length + more <= MOST_S:
            kept.append(span)
            length += more
    return sorted(kept, key=lambda span: span[1]) if order else spans


def unmeasured_thrust(prepared: Sequence[Prepared], known_by_rpm: float | None = None) -> list[str]:
    """What follows where thrust is not measured, one line for each source of it.

    known_by_rpm: share to which thrust by the propeller's speed was known, where its error is estimated, as is that of
    thrust by the battery's power.
    """
    sources = dict.fromkeys(
        flight.thrust_source for flight in prepared if flight.thrust_source.signal and not flight.thrust_source.measured
    )
    known = {"rpm": known_by_rpm or 0.0}
    estimated = "one gain for all of it is estimated, known to {:.0%} before"
    return [
        f"thrust {source}, not measured: its errors become errors of drag, and of lift by the sine of alpha; "
        + (
            estimated.format(known.get(source.signal, source.std))
            if known_by_rpm and source.signal in ("rpm", BATTERY)
            else f"the bars hold an error of {source.std:.0%} of it ({source.doubt})"
        )
        for source in sources
    ]


def require_thrust(prepared: Sequence[Prepared]) -> None:
    """Raise SignalError where a flight does not determine its thrust."""
    for flight in prepared:
        if flight.thrust_source.missing:
            raise SignalError(f"{flight.data.name}: thrust is unknown: {flight.thrust_source.missing}")


def airspeed_gain(record: Record, layout: SensorMounting) -> Array:
    """Factor by which an indicated airspeed grows when it is expressed as in the air of `layout.airspeed_factor`.

    True over indicated airspeed is sqrt(1.225 / rho) at each sample; the kinematic equations know one factor only.

    Parameters
    ----------
    record : Record
        Stretch of a flight with N output samples, whose air density, kg/m3, is used.
    layout : SensorMounting
        What the airspeed sensor reads, and the one factor, dimensionless, of the kinematic equations.

    Returns
    -------
    Array, shape (N,)
        Factor, dimensionless; 1 where the sensor reads true airspeed.
    """
    if layout.airspeed_is_true:
        return np.ones(record.length)
    rho = record.rho[record.start : record.start + record.length]
    return np.asarray(np.sqrt(SEA_LEVEL_DENSITY / rho) / layout.airspeed_factor)


def in_even_air(prepared: Sequence[Prepared]) -> list[FlightData]:
    """All stretches, airspeed expressed as in air of the first flight's density, whatever height it was measured at."""
    layout = prepared[0].layout
    parts = []
    for stretch in (stretch for flight in prepared for stretch in flight.stretches):
        airspeed = stretch.data["airspeed"] * airspeed_gain(stretch.record, layout)
        parts.append(replace(stretch.data, columns={**stretch.data.columns, "airspeed": airspeed}))
    return parts
