"""The vehicle file: what the user knows about the aircraft before the flight, read and checked."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from sim_vehicle.errors import VehicleFileError
from sim_vehicle.vehicle.controls import Array, Control, mixing_matrix, read_controls, servo_pwm
from sim_vehicle.vehicle.plausibility import impossible
from sim_vehicle.vehicle.propulsion import Propulsion, read_propulsion, scaled
from sim_vehicle.vehicle.second_sensors import SECOND_SENSORS
from sim_vehicle.vehicle.strict_toml import NOT_SAID, Known, Table

# Of the moments of inertia: by how much the sum of two may fall short of the third, without and with a warning.
_SWING_TEST_ERROR, _LARGEST_SWING_ERROR = 0.02, 0.10
_MASS_KEYS = ("mass", "Ixx", "Iyy", "Izz", "Ixz")
# Moments of inertia over mass and span squared, the geometric mean of three small aircraft that were swung (Ultra Stick
# 25e; Aerosonde and Zagi in Beard & McLain, Small Unmanned Aircraft, app. E), and how far one of them may be off.
_USUAL_INERTIA = {"Ixx": 0.019, "Iyy": 0.020, "Izz": 0.035}
_USUAL_INERTIA_STD = 0.7
# The product of inertia over the root of Ixx Izz: 0.13, 0.10 and 0.01 for the same three; its sign goes with the tail.
_USUAL_PRODUCT_STD = 0.1
# Wing loading, N/m^2, of aircraft of up to that span, m: from indoor flyers to jets; a wrong unit is off by 10 or more.
_WING_LOADING, _SMALL_SPAN = (5.0, 500.0), 2.0
# Of a bench table, bytes.
_LARGEST_TABLE = 1_000_000
VEHICLES = Path(__file__).resolve().parent.parent / "vehicles"


@dataclass(frozen=True)
class MassProperties:
    """Mass, kg, and moments of inertia about the centre of gravity, kg m^2; Ixz is + integral of x z dm.

    *_std: how well each is known, 1 sigma; None where none is given. estimated: whether the moments of inertia are
    those usual for mass and span.
    """

    mass: float
    Ixx: float
    Iyy: float
    Izz: float
    Ixz: float = 0.0
    mass_std: float | None = None
    Ixx_std: float | None = None
    Iyy_std: float | None = None
    Izz_std: float | None = None
    Ixz_std: float | None = None
    estimated: bool = field(default=False, kw_only=True)

    @property
    def doubted(self) -> bool:
        """Whether anything is given on how well the mass or a moment of inertia is known."""
        return any(getattr(self, f"{key}_std") for key in _MASS_KEYS)


@dataclass(frozen=True)
class Geometry:
    """Reference area S, m^2, span b, m, and mean chord c, m."""

    S: float
    b: float
    c: float


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


@dataclass(frozen=True)
class Environment:
    """Air density, kg/m^3, None meaning from static pressure and temperature; gravity, m/s^2."""

    air_density: float | None = None
    gravity: float = STANDARD_GRAVITY


@dataclass(frozen=True)
class Flight:
    """Speed, m/s, and height above the ground, m, at which the vehicle is flown in trim."""

    airspeed: float
    altitude: float = 100.0


@dataclass(frozen=True)
class Vehicle:
    """Everything a vehicle file says. `warnings` are doubts about it, one line each.

    timing: message -> how much later than the moment measured its stamps are, s. as_recorded: signals that no search
    for mistakes may change.
    """

    name: str
    mass: MassProperties
    geometry: Geometry
    controls: dict[str, Control]
    propulsion: Propulsion | None
    sensors: Sensors
    signals: dict[str, SignalSource]
    calibration: dict[str, CalibrationSource]
    environment: Environment
    flight: Flight
    path: Path
    warnings: tuple[str, ...] = ()
    timing: Mapping[str, Known] = field(default_factory=dict)
    as_recorded: tuple[str, ...] = ()

    @classmethod
    def unknown(cls) -> Vehicle:
        """A vehicle of which nothing is known but what its messages say: no controls, no calibration, no numbers."""
        nan = math.nan
        return cls(
            name="",
            mass=MassProperties(nan, nan, nan, nan, nan),
            geometry=Geometry(nan, nan, nan),
            controls={},
            propulsion=None,
            sensors=Sensors(),
            signals={},
            calibration={},
            environment=Environment(),
            flight=Flight(nan),
            path=Path(),
        )

    @cached_property
    def servo_mixing(self) -> tuple[tuple[int, ...], Array]:
        """Servo numbers (n,), and the (n, m) matrix from the controls' deflections to the servos' own."""
        return mixing_matrix(self.controls)

    def servo_pwm(self, deflections: dict[str, float]) -> dict[int, float]:
        """Pulse width in us of every servo for the deflections (rad, throttle 0 to 1) of all controls."""
        return servo_pwm(self.controls, deflections)


def stronger(vehicle: Vehicle, gain: float) -> Vehicle:
    """The vehicle with that many times the thrust."""
    motor = vehicle.propulsion
    if motor is None:
        return vehicle
    most = None if motor.max_thrust is None else gain * motor.max_thrust
    return replace(vehicle, propulsion=replace(motor, max_thrust=most, CT=scaled(motor.CT, gain)))


def load_vehicle(name_or_path: str | Path) -> Vehicle:
    """Read a vehicle file, or one that comes with the package by its bare name.

    Raises VehicleFileError, one line naming the key: missing file, unknown key, impossible value.
    """
    path = _find(name_or_path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise VehicleFileError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise VehicleFileError(f"{path}: is not a TOML file: it holds bytes that are no text") from error
    return vehicle_from_text(text, path, tables_in=path.parent)


def vehicle_from_text(text: str, path: Path, *, tables_in: Path | None = None) -> Vehicle:
    """Read the text of a vehicle file. path: its name, for errors, and what it is called if it does not say.

    tables_in: the folder of the bench tables that it names; None where it may name none, as in a text from elsewhere.
    Raises VehicleFileError, one line naming the key.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise VehicleFileError(f"{path}: is not a TOML file: {error}") from error
    except RecursionError as error:
        raise VehicleFileError(f"{path}: is not a vehicle file: its lists are nested too deep") from error
    return _read(Table(data, str(path)), path, tables_in)


def _find(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    if path.exists():
        return path
    known = sorted(file.stem for file in VEHICLES.glob("*.toml"))
    if isinstance(name_or_path, str) and name_or_path in known:
        return VEHICLES / f"{name_or_path}.toml"
    raise VehicleFileError(f"{name_or_path}: no such vehicle file; vehicles that come with it: {', '.join(known)}")


def _read(top: Table, path: Path, tables_in: Path | None) -> Vehicle:
    warnings: list[str] = []
    name = top.text("name", path.stem)
    mass_table = top.table("mass", demanded=True)
    geometry = _read_geometry(top.table("geometry", demanded=True))
    mass = _read_mass(mass_table, geometry, warnings)
    controls = read_controls(top.table("controls"), warnings)
    propulsion = read_propulsion(top.table("propulsion")) if top.optional("propulsion") else None
    sensors = _read_sensors(top.table("sensors"))
    table = top.table("signals")
    as_recorded = table.texts("as_recorded") if table.optional("as_recorded") else ()
    signals = _read_signals(table)
    calibration = _read_calibration(top.table("calibration"), tables_in)
    table = top.table("environment")
    environment = Environment(
        table.optional_number("air_density", above=0.0), table.number("gravity", STANDARD_GRAVITY, above=0.0)
    )
    table.close()
    timing = _read_timing(top.table("timing"))
    sizes = {
        key: value for key, value in {**vars(mass), **vars(geometry)}.items() if key in (*_MASS_KEYS, "S", "b", "c")
    }
    sizes["gravity"] = environment.gravity
    if problem := impossible(sizes, _WING_LOADING, _SMALL_SPAN):
        raise top.error(*problem)
    flight = _read_flight(top.table("flight"), mass, geometry, environment)
    top.close()
    vehicle = Vehicle(
        name, mass, geometry, controls, propulsion, sensors, signals, calibration, environment, flight, path, (),
        timing, as_recorded,
    )  # fmt: skip
    return Vehicle(**{**vehicle.__dict__, "warnings": (*warnings, *doubts(vehicle))})


def _read_mass(table: Table, geometry: Geometry, warnings: list[str]) -> MassProperties:
    mass = table.number("mass", above=0.0)
    if not any(table.optional(key) for key in _MASS_KEYS if key.startswith("I")):
        mass_std = table.optional_number("mass_std", low=0.0)
        table.close()
        found = usual_inertia(mass, geometry.b)
        usual = {key: value for key, (value, _) in found.items()}
        shown = [f"{usual[key]:.2g}" for key in _USUAL_INERTIA]
        doubt = {f"{key}_std": std for key, (_, std) in found.items()}
        warnings.append(
            f"{table.path('Ixx')}, Iyy, Izz: not given; what is usual for mass and span is taken"
            f" ({', '.join(shown)} kg m^2, to {_USUAL_INERTIA_STD:.0%}), so that"
            " moment coefficients are known no better; swing the aircraft as a pendulum"
        )
        return MassProperties(mass, **usual, mass_std=mass_std, **doubt, estimated=True)
    Ixx, Iyy, Izz = (table.number(key, above=0.0) for key in ("Ixx", "Iyy", "Izz"))
    Ixz = table.number("Ixz", 0.0)
    doubts = [table.optional_number(f"{key}_std", low=0.0) for key in _MASS_KEYS]
    table.close()
    if Ixz * Ixz >= Ixx * Izz:
        raise table.error("Ixz", f"is {Ixz:g}; its square must be below Ixx Izz = {Ixx * Izz:g}")
    smallest, middle, largest = np.linalg.eigvalsh(np.array([[Ixx, 0, -Ixz], [0, Iyy, 0], [-Ixz, 0, Izz]]))
    beyond = largest / (smallest + middle) - 1.0
    if beyond > _SWING_TEST_ERROR:
        key = ("Ixx", "Iyy", "Izz")[int(np.argmax([Ixx, Iyy, Izz]))]
        problem = f"is too large: a principal moment of inertia ({largest:g}) exceeds the sum of the other two"
        if beyond > _LARGEST_SWING_ERROR:
            raise table.error(key, problem)
        warnings.append(f"{table.path(key)}: {problem} by {beyond:.0%}, which no body does: a swing test repeated?")
    return MassProperties(mass, Ixx, Iyy, Izz, Ixz, *doubts)


def usual_inertia(mass: float, span: float) -> dict[str, tuple[float, float]]:
    """Moments of inertia that are usual for a mass, kg, and a span, m.

    By name: value and standard deviation, kg m^2.
    """
    values = {key: share * mass * span**2 for key, share in _USUAL_INERTIA.items()}
    product = _USUAL_PRODUCT_STD * math.sqrt(values["Ixx"] * values["Izz"])
    return {**{key: (value, _USUAL_INERTIA_STD * value) for key, value in values.items()}, "Ixz": (0.0, product)}


def _read_geometry(table: Table) -> Geometry:
    geometry = Geometry(*(table.number(key, above=0.0) for key in ("S", "b", "c")))
    table.close()
    return geometry


def _read_sensors(table: Table) -> Sensors:
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


def _read_timing(table: Table) -> dict[str, Known]:
    timing = {}
    for message in table:
        entry = table.table(message)
        timing[message] = Known(entry.number("offset", 0.0), entry.optional_number("std", low=0.0))
        entry.close()
    return timing


def _read_signals(table: Table) -> dict[str, SignalSource]:
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


def _read_calibration(table: Table, folder: Path | None) -> dict[str, CalibrationSource]:
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


def _read_flight(table: Table, mass: MassProperties, geometry: Geometry, environment: Environment) -> Flight:
    density = environment.air_density or SEA_LEVEL_DENSITY
    # Without a speed the simulator starts at a lift coefficient of 0.5, in the middle of any wing's range.
    middle = float(np.sqrt(2.0 * mass.mass * environment.gravity / (density * geometry.S * 0.5)))
    flight = Flight(table.number("airspeed", middle, above=0.0), table.number("altitude", 100.0))
    table.close()
    return flight


def doubts(vehicle: Vehicle) -> list[str]:
    """What is possible but hardly meant: a factor of 10 to 1000 that a wrong unit makes. One line each.

    What rests on a mass or an area that is doubted itself is left alone: it would blame the wrong key.
    """
    mass, geometry = vehicle.mass, vehicle.geometry
    of_mass, of_area = _doubted_mass(vehicle), []
    if not 0.3 < geometry.b**2 / geometry.S < 60.0:
        low, high = geometry.b**2 / 60.0, geometry.b**2 / 0.3
        of_area.append(
            f"geometry.S: {geometry.S:g} m^2 on a span of {geometry.b:g} m is hardly possible, {low:.2g} to {high:.2g}"
            " m^2 are expected: cm or dm?"
        )
    elif not 0.3 < geometry.b * geometry.c / geometry.S < 3.0:
        mean = geometry.S / geometry.b
        of_area.append(
            f"geometry.c: a chord of {geometry.c:g} m is hardly possible, S over the span is {mean:.3g} m: cm or mm?"
        )
    # The mass of small aircraft is judged by their area.
    lines = [*(of_area or of_mass)] if geometry.b <= _SMALL_SPAN else [*of_mass, *of_area]
    for key, value in () if of_mass else (("Ixx", mass.Ixx), ("Iyy", mass.Iyy), ("Izz", mass.Izz)):
        ratio = (value / mass.mass) ** 0.5 / geometry.b
        if not 0.02 < ratio < 1.5:
            low, high = (mass.mass * (share * geometry.b) ** 2 for share in (0.02, 1.5))
            lines.append(
                f"mass.{key}: {value:g} kg m^2 is a radius of gyration of {ratio:.3g} spans, {low:.2g} to {high:.2g}"
                f" kg m^2 are expected: {key} in g m^2 or kg cm^2?"
            )
    return [*lines, *_doubted_equipment(vehicle, rest_on_mass=not (of_mass or of_area))]


def _doubted_mass(vehicle: Vehicle) -> list[str]:
    """The mass against span and, of small aircraft, wing area."""
    mass, geometry, gravity = vehicle.mass.mass, vehicle.geometry, vehicle.environment.gravity
    if geometry.b <= _SMALL_SPAN:
        loading = mass * gravity / geometry.S
        low, high = _WING_LOADING
        if low <= loading <= high:
            return []
        few, many = (limit * geometry.S / gravity for limit in _WING_LOADING)
        unit = "grams" if loading > high else "a slipped decimal point"
        return [
            f"mass.mass: {mass:g} kg on a wing of {geometry.S:g} m^2 ({loading:.3g} N/m^2) is hardly possible,"
            f" {few:.2g} to {many:.2g} kg are expected: {unit}?"
        ]
    filling = mass / geometry.b**3  # 1 for a MAV, 2 for an airliner, 12 for a fighter, 0.005 for a solar glider
    if 1e-3 < filling < 100.0:
        return []
    unit = "grams" if filling >= 100.0 else "the span in cm"
    return [f"mass.mass: {mass:g} kg on a span of {geometry.b:g} m is hardly possible: {unit}?"]


def _doubted_equipment(vehicle: Vehicle, *, rest_on_mass: bool) -> list[str]:
    """Sensors, propulsion, environment and speed. rest_on_mass: mass and area are sound enough to judge these by."""
    mass, geometry, lines = vehicle.mass, vehicle.geometry, []
    for key, sensor in vehicle.sensors.named().items():
        if max(map(abs, sensor.position)) > 3.0 * geometry.b:
            lines.append(f"sensors.{key}.position: farther out than three spans: cm or mm?")
    lift = mass.mass * vehicle.environment.gravity
    thrust = vehicle.propulsion.max_thrust if vehicle.propulsion else None
    if rest_on_mass and thrust is not None and not 0.02 < thrust / lift < 10.0:
        lines.append(f"propulsion.max_thrust: {thrust:g} N is {thrust / lift:.3g} times the weight: gram-force?")
    if not 9.7 < vehicle.environment.gravity < 9.9:
        lines.append(f"environment.gravity: {vehicle.environment.gravity:g} m/s^2 is not the Earth's")
    density = vehicle.environment.air_density
    if density is not None and not 0.1 < density < 1.7:
        lines.append(f"environment.air_density: {density:g} kg/m^3 is not the lower atmosphere's")
    # Divided by nothing, a speed as good as 0 needs a coefficient beyond all bounds.
    CL = lift / max(0.5 * (density or SEA_LEVEL_DENSITY) * vehicle.flight.airspeed**2 * geometry.S, 1e-300)
    if rest_on_mass and not 0.01 < CL < 4.0:
        lines.append(f"flight.airspeed: {vehicle.flight.airspeed:g} m/s needs a lift coefficient of {CL:.3g}: km/h?")
    return lines
