"""Sensors of a vehicle file: where each sits, how well it is known, where its signal and bench points come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from sim_vehicle.vehicle.second_sensors import SECOND_SENSORS
from sim_vehicle.vehicle.strict_toml import NOT_SAID, Known, Table

# Of a bench table, bytes.
_LARGEST_TABLE = 1_000_000


@dataclass(frozen=True)
class Sensor:
    """Where a sensor sits from the centre of gravity, m, its noise (1 sigma, SI) if known, and its kind.

    bias_std, scale_std: of its zero, SI, and of its gain, 1 sigma. position_error_std: of an airspeed, its change by
    angle of attack, 1/rad, 1 sigma. delay, lag: s, by which it reads late and slowly. None where none is given.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    noise: float | None = None
    kind: str = ""
    bias_std: float | None = None
    scale_std: float | None = None
    position_error_std: float | None = None
    delay: Known = NOT_SAID
    lag: Known = NOT_SAID


_KINDS = {"beta_vane": ("sideslip", "flank"), "airspeed": ("calibrated", "true")}


@dataclass(frozen=True)
class Sensors:
    """Every sensor; one that the file does not name sits at the centre of gravity with unknown noise.

    beta_vane.kind: "sideslip" (asin(v/V)) or "flank" (atan2(v, u)). airspeed.kind: "calibrated" or "true". second:
    those of SECOND_SENSORS that the file names, by key.
    """

    accelerometer: Sensor = Sensor()
    gyro: Sensor = Sensor()
    attitude: Sensor = Sensor()
    alpha_vane: Sensor = Sensor()
    beta_vane: Sensor = Sensor(kind="sideslip")
    airspeed: Sensor = Sensor(kind="calibrated")
    thrust: Sensor = Sensor()
    gps: Sensor = Sensor()
    second: Mapping[str, Sensor] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Sensor:
        sensor = self.second.get(name) or getattr(self, name, None) or self._not_named(name)
        if not isinstance(sensor, Sensor):
            raise KeyError(name)
        return sensor

    def _not_named(self, name: str) -> Sensor | None:
        first = next((one.first for one in SECOND_SENSORS.values() if one.key == name), None)
        return Sensor(kind=Sensors.kinds(first)[0]) if first is not None else None

    @staticmethod
    def firsts() -> tuple[str, ...]:
        """Keys of the first sensor of every kind."""
        return tuple(name for name in Sensors.__dataclass_fields__ if name != "second")

    @staticmethod
    def kinds(name: str) -> tuple[str, ...]:
        """Kinds that a sensor may be of, the usual one first."""
        return _KINDS.get(name, ("",))

    def named(self) -> dict[str, Sensor]:
        """Every first sensor, and the second ones that there are, by key."""
        return {**{name: self[name] for name in self.firsts()}, **self.second}


@dataclass(frozen=True)
class SignalSource:
    """Where a signal comes from instead of its usual message: value = scale * message.field + offset, SI.

    name: the `name` the message must carry (NAMED_VALUE_FLOAT), or "". field: "" means the usual one;
    "data[3]" is an element. scale: None means the usual one of that message and field, 1 where there is none.
    """

    message: str
    name: str = ""
    field: str = ""
    scale: float | None = None
    offset: float = 0.0


@dataclass(frozen=True)
class CalibrationSource:
    """Bench points that turn `source` (as "adc3") into a signal: a CSV, or (reference, reading) pairs."""

    source: str
    form: str
    points: Path | tuple[tuple[float, float], ...]
    unit: str


def read_sensors(table: Table) -> Sensors:
    second = {one.key: one.first for one in SECOND_SENSORS.values()}
    found: dict[str, Sensor] = {}
    for name in (*Sensors.firsts(), *second):
        if not table.optional(name):
            continue
        entry = table.table(name)
        first = second.get(name, name)
        kind = entry.text("kind", _KINDS[first][0], _KINDS[first]) if first in _KINDS else ""
        bias, scale = (entry.optional_number(f"{key}_std", low=0.0) for key in ("bias", "scale"))
        position = entry.optional_number("position_error_std", low=0.0) if first == "airspeed" else None
        if name in second and first == "airspeed" and kind != found.get(first, Sensors.airspeed).kind:
            raise entry.error("kind", f"two of a kind are compared: give it the kind of sensors.{first}")
        found[name] = Sensor(
            entry.vector("position"), entry.optional_number("noise", above=0.0), kind, bias, scale, position,
            entry.known("delay"), entry.known("lag"),
        )  # fmt: skip
        entry.close()
    table.close()
    beside = {name: found.pop(name) for name in second if name in found}
    return Sensors(**found, second=beside)


def read_timing(table: Table) -> dict[str, Known]:
    timing = {}
    for message in table:
        entry = table.table(message)
        timing[message] = Known(entry.number("offset", 0.0), entry.optional_number("std", low=0.0))
        entry.close()
    return timing


def read_signals(table: Table) -> dict[str, SignalSource]:
    sources = {}
    for name in table:
        if name == "as_recorded":
            continue
        entry = table.table(name)
        message = entry.text("message")
        label = entry.text("name", "") if "name" in entry else ""
        field = entry.text("field") if entry.optional("field") else ""
        sources[name] = SignalSource(message, label, field, entry.optional_number("scale"), entry.number("offset", 0.0))
        entry.optional("name")
        entry.close()
        if sources[name].scale == 0.0:
            raise entry.error("scale", "is 0; the signal would always read its offset")
    return sources


def read_calibration(table: Table, folder: Path | None) -> dict[str, CalibrationSource]:
    sources = {}
    for name in table:
        entry = table.table(name)
        points: Path | tuple[tuple[float, float], ...]
        if entry.is_text("points"):
            if folder is None:
                raise entry.error("points", "names a file; give the points themselves: [[reference, reading], ...]")
            points = folder / entry.text("points")
            if not points.is_file():
                raise entry.error("points", f"names {points}, which is no file")
            # It travels in every recording: nothing else of this computer may.
            if not points.resolve().is_relative_to(folder.resolve()):
                raise entry.error("points", f"names {points}, which is not in the vehicle file's folder; copy it there")
            if points.stat().st_size > _LARGEST_TABLE:
                raise entry.error("points", f"names {points}, which is larger than any bench table (1 MB)")
        else:
            rows = entry.rows("points")
            if any(len(row) != 2 for row in rows):
                raise entry.error("points", "must be a CSV file's name or pairs [reference, reading]")
            points = tuple((row[0], row[1]) for row in rows)
        sources[name] = CalibrationSource(entry.text("source"), entry.text("form"), points, entry.text("unit"))
        entry.close()
    return sources
