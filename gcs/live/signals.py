"""Signals of the table as they come: the same fields, units and preferences as after the flight.

What `gcs.flights.signals.extract` decides by looking at the whole flight is decided here by the last seconds: the first
source that comes fast enough now counts, else the fastest.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gcs.flights.signal_sources import SIGNALS, SURFACE_RATE_HZ, ZERO_MEANS_ABSENT, Row, Source
from gcs.flights.signals import (
    AIRSPEEDS,
    ESTIMATED_VANES,
    MESSAGES,
    airspeed_from_pressure,
    declared_source,
    load_calibration,
    values_of,
)
from gcs.flights.streams import MAV_AUTOPILOT_ARDUPILOT, Stream
from sim_vehicle.constants import GAS_CONSTANT, SEA_LEVEL_DENSITY
from sim_vehicle.vehicle.controls import signal_of
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array
from sysid.calibration import Calibration

_WINDOW_S = 2.0


@dataclass(frozen=True)
class Samples:
    """New samples of one signal: (N,) s on the vehicle's clock, ascending, and (N,) SI values without NaN."""

    time_s: Array
    values: Array


@dataclass
class _Source:
    """One source of a signal. rank: of preference. taken: newest stamp. recent: (time, samples) of the last seconds."""

    source: Source
    rank: int
    declared: bool
    taken: float = -np.inf
    recent: deque[tuple[float, int]] = field(default_factory=deque)
    held: int = 0

    def add(self, now: float, count: int) -> None:
        """So many samples have come."""
        self.recent.append((now, count))
        self.held += count

    def count(self, now: float) -> int:
        """How many have come in the last seconds."""
        while self.recent and self.recent[0][0] < now - _WINDOW_S:
            self.held -= self.recent.popleft()[1]
        return self.held


@dataclass
class _Wanted:
    """One signal: its sources, and the one that counts now."""

    row: Row
    sources: list[_Source]
    chosen: _Source | None = None
    begun: float = np.nan

    def choose(self, now: float) -> _Source | None:
        """The source that counts; looked at again when the chosen one is not fast enough."""
        needed = 0.9 * self.row.rate_hz * min(_WINDOW_S, max(now - self.begun, 0.0))
        if self.chosen is not None and self.chosen.rank == 0 and self.chosen.count(now) >= needed:
            return self.chosen
        alive = [source for source in self.sources if source.count(now)]
        steady = [source for source in alive if source.count(now) >= needed]
        best = steady[0] if steady else max(alive, key=lambda source: source.count(now), default=self.chosen)
        self.chosen = best
        return best


def _each_once(stream: Stream) -> Stream:
    """The first message of each time, in order of time. Several names may be sent at one time, each in its own."""
    if stream.time_s.size < 2 or np.all(np.diff(stream.time_s) > 0.0):
        return stream
    return stream.only(np.unique(stream.time_s, return_index=True)[1])


class SignalStream:
    """Takes a vehicle's messages, gives new samples of every signal.

    vehicle: its controls, calibrations and overrides; `Vehicle.unknown()` for none. ardupilot: says whether AOA_SSA
    would be a filter's estimate. Raises SignalMapError or CalibrationError for a vehicle file that cannot be used.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._calibrations: dict[str, tuple[str, Calibration]] = {
            name: (source.source, load_calibration(source)) for name, source in vehicle.calibration.items()
        }
        self._wanted: dict[str, _Wanted] = {}
        for name in dict.fromkeys([*SIGNALS, *vehicle.signals]):
            row = SIGNALS.get(name, Row("", SURFACE_RATE_HZ, ()))
            override = vehicle.signals.get(name)
            sources = row.sources if override is None else (declared_source(name, override),)
            chosen = [_Source(source, rank, override is not None) for rank, source in enumerate(sources)]
            self._wanted[name] = _Wanted(row, chosen)
        self._by_message: dict[str, list[tuple[str, _Source]]] = {}
        for name, wanted in self._wanted.items():
            for source in wanted.sources:
                self._by_message.setdefault(source.source.message, []).append((name, source))
        self.messages: Sequence[str] = (
            *MESSAGES,
            *(source.message for source in vehicle.signals.values()),
        )
        # What the user is to know of signals that come and are not taken.
        self.notes: tuple[str, ...] = ()
        self._temperature = np.nan
        self._density = vehicle.environment.air_density or np.nan

    def unit(self, name: str) -> str:
        """SI unit of a signal."""
        if name in ("de", "da", "dr"):
            return "rad"
        derived = {"throttle": "", "air_density": "kg/m^3"}
        return derived[name] if name in derived else self._wanted[name].row.unit

    def take(self, streams: Sequence[Stream], autopilot: int) -> dict[str, Samples]:
        """New samples by name, those of late and repeated messages left out."""
        found: dict[str, Samples] = {}
        for stream in sorted(streams, key=lambda stream: stream.component != 1):
            self._read(stream, autopilot, found)
        self._add_surfaces(found)
        self._add_calibrated(found)
        self._add_density(found)
        self._add_airspeed(found)
        return found

    def _read(self, stream: Stream, autopilot: int, found: dict[str, Samples]) -> None:
        named: dict[str, Stream] = {}
        for name, source in self._by_message.get(stream.message, ()):
            if stream.message == "AOA_SSA" and not source.declared and autopilot == MAV_AUTOPILOT_ARDUPILOT:
                self.notes = (ESTIMATED_VANES,)
                continue
            own = source.source.name
            if own not in named:
                named[own] = _each_once(stream.named(own) if own else stream)
            chosen = named[own]
            if not chosen.log_ns.size:
                continue
            samples = _fresh(name, source, chosen)
            if samples is None:
                continue
            wanted = self._wanted[name]
            now = float(samples.time_s[-1])
            if np.isnan(wanted.begun):
                wanted.begun = now
            source.add(now, samples.time_s.size)
            if wanted.choose(now) is source:
                found[name] = samples

    def _add_surfaces(self, found: dict[str, Samples]) -> None:
        for name, control in self._vehicle.controls.items():
            signal = signal_of(name)
            servos = [found.get(f"servo{number}") for number in control.servos]
            pulses = [servo for servo in servos if servo is not None]
            sizes = {servo.time_s.size for servo in pulses}
            # All outputs of a port come in one message.
            if signal in found or len(pulses) < len(servos) or len(sizes) != 1:  # nor where there are no servos
                continue
            deflection = control.deflection_from_pwm(*(servo.values for servo in pulses))
            found[signal] = Samples(pulses[0].time_s, deflection)

    def _add_calibrated(self, found: dict[str, Samples]) -> None:
        for name, (channel, calibration) in self._calibrations.items():
            raw = found.get(channel)
            if raw is None:
                # Without the channel the message's own stays, as it does after the flight.
                if self._wanted[channel].chosen is not None:
                    found.pop(name, None)
                continue
            values, _ = calibration.apply(raw.values)
            if name in AIRSPEEDS and calibration.si_unit == "Pa":
                values = airspeed_from_pressure(values)
            found[name] = Samples(raw.time_s, values)

    def _add_density(self, found: dict[str, Samples]) -> None:
        fixed, pressure = self._vehicle.environment.air_density, found.get("static_pressure")
        kelvin: Array | float = self._temperature
        if "temperature" in found:
            warmth = found["temperature"]
            self._temperature = float(warmth.values[-1])
            kelvin = self._temperature
            if pressure is not None:
                kelvin = np.interp(pressure.time_s, warmth.time_s, warmth.values)
        if fixed is not None and "az" in found:
            time_s = found["az"].time_s
            found["air_density"] = Samples(time_s, np.full(time_s.size, fixed))
        elif fixed is None and pressure is not None and np.isfinite(self._temperature):
            density = pressure.values / (GAS_CONSTANT * kelvin)
            self._density = float(density[-1])
            found["air_density"] = Samples(pressure.time_s, density)

    def _add_airspeed(self, found: dict[str, Samples]) -> None:
        calibrated = self._vehicle.calibration
        true = found.pop("true_airspeed", None)
        kept = self._vehicle.sensors.airspeed.kind == "true"
        if true is not None and (kept or "airspeed" not in found):
            ratio = 1.0 if kept or not np.isfinite(self._density) else np.sqrt(self._density / SEA_LEVEL_DENSITY)
            found["airspeed"] = Samples(true.time_s, true.values * ratio)
            return
        measured = "differential_pressure" in calibrated and "airspeed" not in calibrated
        pressure = found.get("differential_pressure")
        from_pressure = pressure is not None and (measured or self._wanted["airspeed"].chosen is None)
        if measured and pressure is None and self._wanted["differential_pressure"].chosen is not None:
            found.pop("airspeed", None)
        if pressure is not None and from_pressure and "airspeed" not in calibrated:
            found["airspeed"] = Samples(pressure.time_s, airspeed_from_pressure(pressure.values))
        if (
            self._vehicle.sensors.airspeed.kind == "true"
            and "airspeed" in found
            and (from_pressure or "airspeed" in calibrated)
        ):
            given = found["airspeed"]
            found["airspeed"] = Samples(given.time_s, given.values * np.sqrt(SEA_LEVEL_DENSITY / self._density))


def _fresh(name: str, source: _Source, stream: Stream) -> Samples | None:
    """Samples later than those taken; None where there are none, or the sender has no such sensor.

    stream: its stamps ascend.
    """
    try:
        stream, values = values_of(source.source, stream)
    except KeyError:
        return None
    time_s, known = stream.time_s, np.isfinite(values)
    if name in ZERO_MEANS_ABSENT and not np.isfinite(source.taken) and not values[known].any():
        return None
    if not known.all() or not time_s.size or time_s[0] <= source.taken:
        known &= time_s > source.taken
        time_s, values = time_s[known], values[known]
    if not time_s.size:
        return None
    source.taken = float(time_s[-1])
    return Samples(time_s, values)
