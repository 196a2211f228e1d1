"""From a recording to signals: the one place that maps MAVLink fields to what the estimators work with."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs.errors import SignalMapError
from gcs.flights.forward_flight import MESSAGES as OF_HOVER
from gcs.flights.signal_sources import (
    HIGHRES_BITS,
    SIGNALS,
    SURFACE_RATE_HZ,
    TABLE_NAMES,
    ZERO_MEANS_ABSENT,
    Row,
    Source,
    linear,
    usual_conversion,
    usual_source,
)
from gcs.flights.streams import MAV_AUTOPILOT_ARDUPILOT, ColumnSource, Stream, VehicleStreams, load_streams
from sim_vehicle.constants import GAS_CONSTANT, SEA_LEVEL_DENSITY
from sim_vehicle.vehicle.controls import output_name, signal_of
from sim_vehicle.vehicle.second_sensors import SECOND_SENSORS
from sim_vehicle.vehicle.sensors import CalibrationSource, SignalSource
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.calibration import Calibration, calibrate, points_from_pairs, read_points
from sysid.signals.flight import FlightSignals, Signal, repeats
from sysid.tables.flight_table import with_airspeed_of

Array = NDArray[np.float64]

UTC_MESSAGE = "SYSTEM_TIME"
IMPORT_WARNING = "warning "  # what the notes of an import begin with that every reader is to see
MESSAGES = tuple(dict.fromkeys(source.message for row in SIGNALS.values() for source in row.sources))
ESTIMATED_VANES = (
    "AOA_SSA comes from ArduPilot, whose filter estimates it: it counts as no vanes;"
    " if vanes measure it, say so under [signals] in the vehicle file"
)
#: Signals that a bench curve in Pa gives.
AIRSPEEDS = {"airspeed", *(name for name, one in SECOND_SENSORS.items() if one.of == "airspeed")}


@dataclass(frozen=True)
class Candidate:
    """One source of a signal that the recording does hold."""

    signal: Signal
    steady: bool


def extract(recording: ColumnSource, vehicle: Vehicle, system: int | None = None) -> FlightSignals:
    """Every signal that the vehicle's messages carry, in SI units on the vehicle's clock from its first stamp.

    recording: an open recording, or anything with its `path`, `metadata` and `columns`. system: MAVLink system
    number, needed where several vehicles are in it. Besides the table's signals: de, da, dr, throttle (rad; 0 to 1)
    from the servos through the vehicle's controls; air_density (kg/m^3); and whatever the vehicle file adds or
    calibrates. `airspeed` is calibrated airspeed unless the vehicle file says that its source gives true airspeed;
    Signal.source says which.
    Raises SignalMapError where there is no vehicle, no stamp, or a field that a vehicle file names does not exist.
    """
    return extract_from(recording, vehicle, streams_for(recording, vehicle, system))


def streams_for(recording: ColumnSource, vehicle: Vehicle, system: int | None = None) -> VehicleStreams:
    """The messages that `extract` goes by, on the flight's clock. Raises SignalMapError as `extract` does."""
    extra = [source.message for source in vehicle.signals.values()]
    return load_streams(recording, [*MESSAGES, *extra, UTC_MESSAGE, *OF_HOVER], system)


def extract_from(recording: ColumnSource, vehicle: Vehicle, streams: VehicleStreams) -> FlightSignals:
    """`extract` of streams that were loaded before. Raises SignalMapError."""
    flight = _Flight(vehicle, streams)
    for name in dict.fromkeys([*SIGNALS, *vehicle.signals]):
        flight.add_measured(name)
    for problem, names in flight.slow.items():
        flight.warn(f"{', '.join(names)}: {problem}")
    flight.add_surfaces()
    flight.add_calibrated()
    flight.add_air_density()
    flight.add_airspeed()
    flight.add_import_notes(recording.metadata().get("import", {}))
    if vehicle.environment.air_density is None and "airspeed" in flight.signals and "air_density" not in flight.signals:
        flight.warn("no static pressure and temperature: air density is unknown; give environment.air_density")
    return FlightSignals(recording.path.stem, flight.signals, tuple(dict.fromkeys(flight.warnings)))


class _Flight:
    """Signals as they are gathered."""

    def __init__(self, vehicle: Vehicle, streams: VehicleStreams) -> None:
        self.vehicle = vehicle
        self.streams = streams
        self.duration_s = streams.duration_s
        self.signals: dict[str, Signal] = {}
        self.warnings: list[str] = list(streams.warnings)
        self.slow: dict[str, list[str]] = {}
        self.named: dict[tuple[int, str], Stream] = {}

    def warn(self, text: str) -> None:
        self.warnings.append(text)

    def add_measured(self, name: str) -> None:
        """The first source that comes fast enough through the flight, else the fastest, with a warning.

        One that repeats a single value throughout (a field that nobody fills) gives way to one that does not.
        """
        row = SIGNALS.get(name, Row("", SURFACE_RATE_HZ, ()))
        override = self.vehicle.signals.get(name)
        if override is not None:
            found = list(self.candidates(name, row, (declared_source(name, override),), declared=True))
            if not found:
                self.warn(f"{name}: the recording has no {override.message} {override.name}".rstrip())
        else:
            found = list(self.candidates(name, row, row.sources, declared=False))
        if not found:
            return
        found = [entry for entry in found if not repeats(entry.signal.values)] or found
        best = next((entry for entry in found if entry.steady), None)
        if best is None:
            best = max(found, key=lambda entry: entry.signal.time_s.size)
            rate = best.signal.time_s.size / max(self.duration_s, 1e-9)
            self.slow.setdefault(_slow_words(best.signal.source.split(".")[0], rate, row.rate_hz), []).append(name)
        self.signals[name] = best.signal

    def candidates(self, name: str, row: Row, sources: tuple[Source, ...], *, declared: bool) -> Iterator[Candidate]:
        """Every source that holds at least one value, in order of preference; the autopilot's component first."""
        for source in sources:
            streams = self.streams.streams.get(source.message, [])
            if (
                source.message == "AOA_SSA"
                and not declared
                and self.streams.sender.autopilot == MAV_AUTOPILOT_ARDUPILOT
            ):
                if streams:
                    self.warn(ESTIMATED_VANES)
                continue
            for stream in streams:
                signal = self.read(row.unit, source, stream, declared=declared)
                absent = name in ZERO_MEANS_ABSENT and signal is not None and not np.any(np.nan_to_num(signal.values))
                if signal is not None and not absent:
                    yield Candidate(signal, is_steady(signal, row.rate_hz, self.duration_s))

    def read(self, unit: str, source: Source, stream: Stream, *, declared: bool) -> Signal | None:
        """The signal of one source in one stream; None where it has no value there."""
        if source.name:
            # Sixteen analogue channels ask for the same name.
            key = (id(stream), source.name)
            if key not in self.named:
                self.named[key] = stream.named(source.name)
            stream = self.named[key]
        try:
            stream, values = values_of(source, stream)
        except KeyError as error:
            if declared:
                raise SignalMapError(
                    f"{self.vehicle.path}: {source.message} has no field {error.args[0]};"
                    f" its fields are {', '.join(stream.records.dtype.names or ())}"
                ) from None
            return None
        if not np.any(np.isfinite(values)):
            return None
        if source.name in TABLE_NAMES:  # a row does not have every signal
            known = np.isfinite(values)
            stream, values = stream.only(known), values[known]
        order = np.argsort(stream.time_s, kind="stable")
        return Signal(stream.time_s[order], np.ascontiguousarray(values[order]), unit, source.label)

    def add_surfaces(self) -> None:
        """Deflections of all controls whose servos were recorded."""
        for name, control in self.vehicle.controls.items():
            signal = signal_of(name)
            servos = [self.signals.get(f"servo{number}") for number in control.servos]
            if signal in self.signals:
                continue
            if not servos:
                self.warn(f"{signal}: controls.{name} names no servo, and the recording has no {signal} itself")
                continue
            pulses = [servo for servo in servos if servo is not None]
            if len(pulses) < len(servos):
                missing = ", ".join(
                    f"servo{n}" if output_name(n) == str(n) else f"servo{n} ({output_name(n)})"
                    for n, s in zip(control.servos, servos, strict=True)
                    if s is None
                )
                self.warn(f"{signal}: the recording has no {missing}, so the {name} is unknown")
                continue
            # All outputs of a port come in one message, so they share their stamps.
            pwm = [servo.values for servo in pulses]
            outside = float(np.mean(control.is_outside(*pwm)))
            if outside > 0.0:
                self.warn(f"{signal}: {outside:.1%} of the pulses lie beyond the points of controls.{name}.pwm")
            source = f"{' '.join(servo.source for servo in pulses)} ({control.signal})"
            unit = "" if name == "throttle" else "rad"
            self.signals[signal] = Signal(pulses[0].time_s, control.deflection_from_pwm(*pwm), unit, source)

    def add_calibrated(self) -> None:
        """Signals that the vehicle file calibrates from a raw channel replace those of messages."""
        for name, source in self.vehicle.calibration.items():
            raw = self.signals.get(source.source)
            if raw is None:
                kept = f"; {self.signals[name].source} is used" if name in self.signals else ""
                self.warn(f"{name}: the recording has no {source.source} to calibrate{kept}")
                continue
            calibration = load_calibration(source)
            values, outside = calibration.apply(raw.values)
            if np.any(outside):
                self.warn(f"{name}: {np.mean(outside):.1%} of {source.source} lies beyond its bench points")
            unit = calibration.si_unit
            if unit == "Pa" and name in AIRSPEEDS:
                values, unit = airspeed_from_pressure(values), "m/s"
            row = SIGNALS.get(name)
            if row is not None and row.unit != unit:
                raise SignalMapError(
                    f"{self.vehicle.path}: calibration.{name}.unit is {source.unit!r}, which does not give {row.unit}"
                )
            if not calibration.error_known:
                self.warn(f"{name}: the bench points leave none to spare, so the curve's own error counts as 0")
            label = f"{source.source} calibrated ({source.form})"
            self.signals[name] = Signal(raw.time_s, values, unit, label, calibration)

    def add_airspeed(self) -> None:
        """Airspeed from differential pressure where that is calibrated or stands alone; which airspeed it is."""
        kind = self.vehicle.sensors.airspeed.kind
        calibrated = self.vehicle.calibration
        if "true_airspeed" in self.signals and not ("airspeed" in calibrated and "airspeed" in self.signals):
            gathered = FlightSignals("", self.signals)
            self.signals = with_airspeed_of(gathered, self.vehicle).signals
            return
        pressure = self.signals.get("differential_pressure")
        measured = "differential_pressure" in calibrated and "airspeed" not in calibrated
        if pressure is not None and (measured or "airspeed" not in self.signals):
            if not measured:
                self.warn("airspeed: taken from uncalibrated differential pressure; no message carries airspeed")
            values = airspeed_from_pressure(pressure.values)
            self.signals["airspeed"] = replace(
                pressure, values=values, unit="m/s", source=f"{pressure.source} (calibrated airspeed)"
            )
        elif "airspeed" in self.signals:
            given = self.signals["airspeed"]
            label = "calibrated" if "airspeed" in calibrated and "calibrated (" in given.source else kind
            self.signals["airspeed"] = replace(given, source=f"{given.source} ({label} airspeed)")
        if kind == "true" and "airspeed" in self.signals:
            self.make_airspeed_true(self.signals["airspeed"])

    def make_airspeed_true(self, given: Signal) -> None:
        """A pressure gives calibrated airspeed; where the vehicle file says true, the air's density makes it so."""
        if not given.source.endswith("(calibrated airspeed)"):
            return
        density = self.signals.get("air_density")
        if density is None:
            raise SignalMapError(
                f"{self.vehicle.path}: sensors.airspeed.kind is true, but {given.source} is calibrated airspeed and "
                "the air density is unknown; give environment.air_density, or leave kind out"
            )
        known = np.isfinite(density.values)
        rho = np.interp(given.time_s, density.time_s[known], density.values[known])
        source = given.source.replace("(calibrated airspeed)", "made true by density (true airspeed)")
        self.signals["airspeed"] = replace(given, values=given.values * np.sqrt(SEA_LEVEL_DENSITY / rho), source=source)

    def add_air_density(self) -> None:
        """Density by the vehicle file, else by the gas law on the stamps of static pressure."""
        fixed = self.vehicle.environment.air_density
        pressure, temperature = self.signals.get("static_pressure"), self.signals.get("temperature")
        if fixed is not None:
            ends = np.array([0.0, self.duration_s])
            self.signals["air_density"] = Signal(ends, np.full(2, fixed), "kg/m^3", "environment.air_density")
        elif "air_density" not in self.signals and pressure is not None and temperature is not None:
            known = np.isfinite(temperature.values)
            kelvin = np.interp(pressure.time_s, temperature.time_s[known], temperature.values[known])
            density = pressure.values / (GAS_CONSTANT * kelvin)
            source = f"{pressure.source}, {temperature.source}"
            self.signals["air_density"] = Signal(pressure.time_s, density, "kg/m^3", source)
            typical = float(np.nanmedian(density))
            if not 0.3 < typical < 1.6:
                self.warn(f"air_density: {typical:.3g} kg/m^3 from {source} is no air's; check their units")

    def add_import_notes(self, notes: Mapping[str, str]) -> None:
        """What an import says of signals that the log does not hold as they are used here."""
        fixed = self.vehicle.environment.air_density is not None
        for name in ("airspeed", "temperature"):
            if name in notes and name in self.signals and not (fixed and name == "temperature"):
                self.warn(f"{name}: {notes[name]}")
        for key, text in notes.items():
            if key.startswith(IMPORT_WARNING):
                self.warn(text)


def values_of(source: Source, stream: Stream) -> tuple[Stream, Array]:
    """The messages that do update a source's field, and its values in SI units; KeyError for a field that is not there.

    stream: of the source's message, and of its name where it has one.
    """
    if source.port is not None and stream.records.size:
        mine = np.asarray(stream.records["port"] == source.port)
        stream = stream if mine.all() else stream.only(mine)
    bit = HIGHRES_BITS.get(source.fields[0]) if stream.message == "HIGHRES_IMU" else None
    if bit is not None and np.any(stream.records["fields_updated"]):
        updated = np.asarray(stream.records["fields_updated"] >> bit & 1 == 1)
        stream = stream if updated.all() else stream.only(updated)
    return stream, source.convert(*[stream.values(name) for name in source.fields])


def _slow_words(message: str, rate_hz: float, wanted_hz: float) -> str:
    """What is wrong with the pace of a message, and what to do."""
    if rate_hz >= wanted_hz:
        return (
            f"{message} has gaps, though it comes at {rate_hz:.1f} Hz on average: {wanted_hz:g} Hz are wanted all"
            " through; check the link"
        )
    pace = f"{message} brings new values at {rate_hz:.1f} Hz, and {wanted_hz:g} Hz are wanted"
    return f"{pace}: have the vehicle send or log it more often"


def is_steady(signal: Signal, rate_hz: float, duration_s: float) -> bool:
    """Whether values come at `rate_hz` through the flight: nine in ten of its stretches hold nine in ten of them.

    A stretch is as long as ten samples, at least a second, so that jitter and single lost messages do not count.
    """
    stretch = max(1.0, 10.0 / rate_hz)
    count = max(1, int(duration_s / stretch))
    times = signal.time_s[np.isfinite(signal.values)]
    if duration_s < stretch:
        return times.size >= 0.9 * rate_hz * duration_s
    held = np.bincount(np.clip((times / stretch).astype(np.int64), 0, count), minlength=count + 1)[:count]
    return bool(np.mean(held >= 0.9 * rate_hz * stretch) >= 0.9)


def declared_source(name: str, override: SignalSource) -> Source:
    """The table's entry that a vehicle file's override stands for; the usual scale where it gives none."""
    usual = usual_source(name, override.message)
    if not override.field and override.scale is None and usual is not None:
        return Source(usual.message, usual.fields, usual.convert, override.name or usual.name)
    field = override.field.lower() or (usual.fields[0] if usual else "value")
    convert = usual_conversion(override.message, field) if override.scale is None else None
    if convert is None or override.offset:
        scale = 1.0 if override.scale is None else override.scale
        plain, offset = convert, override.offset
        convert = linear(scale, offset) if plain is None else lambda x: plain(x) + offset
    return Source(override.message, (field,), convert, override.name)


def load_calibration(source: CalibrationSource) -> Calibration:
    """Fit the curve that the vehicle file asks for; CalibrationError where the bench points cannot give it."""
    points = points_from_pairs(source.points) if isinstance(source.points, tuple) else read_points(source.points)
    return calibrate(points, source.form, source.unit)


def airspeed_from_pressure(pressure: Array) -> Array:
    """Calibrated airspeed, m/s, from differential pressure, Pa: q = rho0 V^2 / 2, odd in the pressure."""
    return np.asarray(np.sign(pressure) * np.sqrt(2.0 * np.abs(pressure) / SEA_LEVEL_DENSITY))
