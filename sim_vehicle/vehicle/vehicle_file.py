"""The vehicle file: what the user knows about the aircraft before the flight, read and checked."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from sim_vehicle.errors import VehicleFileError
from sim_vehicle.vehicle.controls import CONTROL_NAMES, MOTOR_MOMENTS, Control, read_controls, servo_pwm
from sim_vehicle.vehicle.mass_properties import MASS_KEYS, Geometry, MassProperties, read_geometry, read_mass
from sim_vehicle.vehicle.plausibility import extreme, impossible
from sim_vehicle.vehicle.propulsion import Propulsion, read_motors, read_propulsion, scaled, together
from sim_vehicle.vehicle.sensors import (
    CalibrationSource,
    Sensors,
    SignalSource,
    read_calibration,
    read_sensors,
    read_signals,
    read_timing,
)
from sim_vehicle.vehicle.strict_toml import Known, Table
from sim_vehicle.vehicle.toml_bounds import check_bounds

# Wing loading, N/m^2, of aircraft of up to that span, m: from indoor flyers to jets; a wrong unit is off by 10 or more.
_WING_LOADING, _SMALL_SPAN = (5.0, 500.0), 2.0
# kg; nothing of that mass is described here.
_HEAVY = 200.0
VEHICLES = Path(__file__).resolve().parent.parent / "vehicles"


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
    for mistakes may change. motors: by the control that is their throttle, where there are several; `propulsion` is
    then that of all together.
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
    motors: Mapping[str, Propulsion] = field(default_factory=dict)

    @property
    def named_inputs(self) -> tuple[str, ...]:
        """Inputs of a simulation beside de, da, dr and throttle: the controls of other names, and what several motors
        turn the aircraft by.
        """
        return (*self.named_controls, *(MOTOR_MOMENTS if self.motors else ()))

    @property
    def named_controls(self) -> tuple[str, ...]:
        """Names of the controls that are none of elevator, aileron, rudder and throttle, in the file's order."""
        return tuple(name for name in self.controls if name not in CONTROL_NAMES)

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
    check_bounds(text, str(path))
    try:
        data = tomllib.loads(text)
    except ValueError as error:  # a TOMLDecodeError, or an integer of thousands of digits
        raise VehicleFileError(f"{path}: is not a TOML file: {error}") from error
    return vehicle_from_tables(data, path, tables_in=tables_in)


def vehicle_from_tables(data: Mapping[str, Any], path: Path, *, tables_in: Path | None = None) -> Vehicle:
    """The vehicle of a file's tables, as TOML or JSON reads them; as `vehicle_from_text`."""
    top = Table(dict(data), str(path))
    if problem := extreme(data):
        raise top.error(*problem)
    return _read(top, path, tables_in)


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
    geometry = read_geometry(top.table("geometry", demanded=True))
    mass = read_mass(mass_table, geometry, warnings)
    controls = read_controls(top.table("controls"), warnings)
    propulsion, motors = _read_thrust(top, controls)
    sensors = read_sensors(top.table("sensors"))
    table = top.table("signals")
    as_recorded = table.texts("as_recorded") if table.optional("as_recorded") else ()
    signals = read_signals(table)
    calibration = read_calibration(top.table("calibration"), tables_in)
    table = top.table("environment")
    environment = Environment(
        table.optional_number("air_density", above=0.0), table.number("gravity", STANDARD_GRAVITY, above=0.0)
    )
    table.close()
    timing = read_timing(top.table("timing"))
    sizes = {
        key: value for key, value in {**vars(mass), **vars(geometry)}.items() if key in (*MASS_KEYS, "S", "b", "c")
    }
    sizes["gravity"] = environment.gravity
    if problem := impossible(sizes, _WING_LOADING, _SMALL_SPAN):
        raise top.error(*problem)
    flight = _read_flight(top.table("flight"), mass, geometry, environment)
    top.close()
    vehicle = Vehicle(
        name, mass, geometry, controls, propulsion, sensors, signals, calibration, environment, flight, path, (),
        timing, as_recorded, motors,
    )  # fmt: skip
    return Vehicle(**{**vehicle.__dict__, "warnings": (*warnings, *doubts(vehicle))})


def _read_thrust(top: Table, controls: Mapping[str, Control]) -> tuple[Propulsion | None, dict[str, Propulsion]]:
    """[propulsion], and the motors of [propulsion.NAME] where it is of several."""
    if not top.optional("propulsion"):
        return None, {}
    table = top.table("propulsion")
    motors = read_motors(table)
    if not motors:
        return read_propulsion(table), {}
    table.close()
    for name in motors:
        if name not in controls or name in CONTROL_NAMES:
            raise table.error(name, f"is a motor that no control moves: give [controls.{name}] its servo")
    if bare := [name for name, one in motors.items() if not one.line_known]:
        raise table.error(bare[0], "needs its line: a point that its thrust passes through, m, forward, right, down")
    alike = {(one.inclination, bool(one.CT)) for one in motors.values()}
    if len(alike) > 1:
        raise table.error(next(iter(motors)), "and the other motors need one inclination and one kind of law (CT or"
                          " max_thrust)")  # fmt: skip
    return together(motors), motors


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
    return [*lines, *_doubted_tail(geometry), *_doubted_equipment(vehicle, rest_on_mass=not (of_mass or of_area))]


def _doubted_tail(geometry: Geometry) -> list[str]:
    """Tail and fin against the wing: up to its area, at most two spans behind the centre of gravity."""
    areas = {"tail_area": geometry.tail_area, "fin_area": geometry.fin_area}
    arms = {"tail_arm": geometry.tail_arm, "fin_arm": geometry.fin_arm}
    return [
        *(
            f"geometry.{key}: {area:g} m^2 beside a wing of {geometry.S:g} m^2 is hardly possible: cm or dm?"
            for key, area in areas.items()
            if area is not None and not 0.005 < area / geometry.S < 1.0
        ),
        *(
            f"geometry.{key}: {arm:g} m on a span of {geometry.b:g} m is hardly possible: cm or mm?"
            for key, arm in arms.items()
            if arm is not None and not 0.05 < arm / geometry.b < 2.0
        ),
    ]


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
    unit = "grams" if filling >= 100.0 else "the span in cm" if mass < _HEAVY else "grams, and lengths in cm"
    return [f"mass.mass: {mass:g} kg on a span of {geometry.b:g} m is hardly possible: {unit}?"]


def _doubted_equipment(vehicle: Vehicle, *, rest_on_mass: bool) -> list[str]:
    """Sensors, propulsion, environment and speed. rest_on_mass: mass and area are sound enough to judge these by."""
    mass, geometry, lines = vehicle.mass, vehicle.geometry, []
    for key, sensor in vehicle.sensors.named().items():
        if max(map(abs, sensor.position)) > 3.0 * geometry.b:
            lines.append(f"sensors.{key}.position: farther out than three spans: cm or mm?")
    moving = vehicle.propulsion.moving_mass if vehicle.propulsion else 0.0
    if moving > 0.3 * mass.mass:
        lines.append(f"propulsion.moving_mass: {moving:g} kg on the thrust sensor of {mass.mass:g} kg in all: grams?")
    lift = mass.mass * vehicle.environment.gravity
    thrust = vehicle.propulsion.max_thrust if vehicle.propulsion else None
    if rest_on_mass and thrust is not None and not 0.02 < thrust / lift < 10.0:
        lines.append(f"propulsion.max_thrust: {thrust:g} N is {thrust / lift:.3g} times the weight: gram-force?")
    if not 9.7 < vehicle.environment.gravity < 9.9:
        lines.append(f"environment.gravity: {vehicle.environment.gravity:g} m/s^2 is not the Earth's")
    density = vehicle.environment.air_density
    if density is not None and not 0.1 < density < 1.7:
        lines.append(f"environment.air_density: {density:g} kg/m^3 is not the lower atmosphere's")
    CL = lift / (0.5 * (density or SEA_LEVEL_DENSITY) * vehicle.flight.airspeed**2 * geometry.S)
    if rest_on_mass and not 0.01 < CL < 4.0:
        lines.append(f"flight.airspeed: {vehicle.flight.airspeed:g} m/s needs a lift coefficient of {CL:.3g}: km/h?")
    return lines
