"""What the command line of `sim-vehicle fly` says, checked: settings, vehicle, model, plan."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from sim_vehicle.effects import parse_effect
from sim_vehicle.errors import ModelFileError, PlanError, SimVehicleError, SinkError
from sim_vehicle.flight.failures import Failure, parse_failure
from sim_vehicle.manoeuvres.plan import Plan, plan_of, read_plan
from sim_vehicle.mavlink.outputs import check_link
from sim_vehicle.model.model_file import BUILT_IN, Model, read_model
from sim_vehicle.vehicle.packed_model import require_controls
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle

# Smallest and largest value of what a flight can be made with. A coefficient outside is a slip of the pen.
_FLIGHT_RANGES = {"airspeed": (1.0, 300.0), "altitude": (-400.0, 10_000.0)}  # m/s, m
_LARGEST_COEFFICIENT = 1000.0
_LARGEST_SENSOR_ERROR = 1e5
_LARGEST_WIND = 100.0  # m/s
LONGEST_FLIGHT_S = 14_400.0
_SPEEDS = (0.01, 1000.0)
_LARGEST_SYSTEM = 250  # ground stations take the numbers above
_MOST_VEHICLES = 20


class UsageError(SimVehicleError):
    """The command line itself is wrong: exit code 2."""


@dataclass
class Settings:
    """`--set NAME=VALUE` sorted by what they change."""

    coefficients: dict[str, float] = field(default_factory=dict)
    manoeuvre: dict[str, float] = field(default_factory=dict)
    sensors: dict[str, float] = field(default_factory=dict)
    flight: dict[str, float] = field(default_factory=dict)


def read_settings(texts: Sequence[str]) -> Settings:
    """Sort NAME=VALUE texts: manoeuvre.X, sensors.X, flight.X, and else a coefficient. Raises UsageError."""
    found = Settings()
    for text in texts:
        name, equals, number = text.partition("=")
        try:
            value = float(number)
        except ValueError:
            equals = ""
        if not equals or not math.isfinite(value):
            raise UsageError(f"--set {text}: give NAME=NUMBER")
        group, dot, rest = name.partition(".")
        if not dot:
            found.coefficients[name] = value
        elif group in ("manoeuvre", "sensors", "flight"):
            getattr(found, group)[rest] = value
        else:
            raise UsageError(f"--set {text}: there are coefficients, manoeuvre.NAME, sensors.NAME and flight.NAME")
    _check_ranges(found)
    return found


def _check_ranges(found: Settings) -> None:
    for name, value in found.flight.items():
        if name not in _FLIGHT_RANGES:
            raise UsageError(f"--set flight.{name}: there are {', '.join(_FLIGHT_RANGES)}")
        _in_range(f"--set flight.{name}", value, *_FLIGHT_RANGES[name])
    for name, value in found.coefficients.items():
        _in_range(f"--set {name}", value, -_LARGEST_COEFFICIENT, _LARGEST_COEFFICIENT)
    for name, value in found.sensors.items():
        signed = not name.endswith((".noise", ".quantum", ".lag"))
        _in_range(f"--set sensors.{name}", value, -_LARGEST_SENSOR_ERROR if signed else 0.0, _LARGEST_SENSOR_ERROR)


def _in_range(what: str, value: float, smallest: float, largest: float) -> None:
    if not smallest <= value <= largest:
        raise UsageError(f"{what} is {value:g}: give a number from {smallest:g} to {largest:g}")


def check_numbers(given: argparse.Namespace) -> None:
    """Check the plain numbers of the command line, and which options go together. Raises UsageError."""
    _in_range("--speed", given.speed, *_SPEEDS)
    if given.duration is not None and given.duration > LONGEST_FLIGHT_S:
        raise UsageError(f"--duration {given.duration:g}: a flight lasts {LONGEST_FLIGHT_S:g} s at most")
    if given.seed < 0:
        raise UsageError(f"--seed {given.seed}: give a whole number from 0")
    _in_range("--system", given.system, 1, _LARGEST_SYSTEM)
    _in_range("--vehicles", given.vehicles, 1, min(_MOST_VEHICLES, _LARGEST_SYSTEM + 1 - given.system))
    if given.wait_arm and not (given.taxi and given.out):
        raise UsageError("--wait-arm: only a vehicle that stands at a link can be armed; give --taxi and --out too")
    if given.mavlink1 and given.signing_key:
        raise UsageError("--mavlink1: MAVLink 1 has no signatures; leave out --signing-key")
    if given.out:
        try:
            check_link(given.out)
        except SinkError as error:
            raise UsageError(f"--out {error}") from None


def read_wind(text: str) -> tuple[float, float, float]:
    """N,E,D in m/s. Raises UsageError."""
    try:
        north, east, down = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"--wind {text}: give three numbers NORTH,EAST,DOWN in m/s") from None
    if not all(abs(part) <= _LARGEST_WIND for part in (north, east, down)):
        raise UsageError(f"--wind {text}: give three numbers from {-_LARGEST_WIND:g} to {_LARGEST_WIND:g}")
    return north, east, down


def vehicle_of(given: argparse.Namespace, settings: Settings, *, quiet: bool = False) -> Vehicle:
    """The vehicle to fly; doubts about it go to standard error unless `quiet`."""
    vehicle = load_vehicle(given.vehicle)
    for warning in () if quiet else vehicle.warnings:
        print(f"sim-vehicle: warning: {vehicle.path}: {warning}", file=sys.stderr)
    return replace(vehicle, flight=replace(vehicle.flight, **settings.flight))


def model_of(given: argparse.Namespace, vehicle: Vehicle, settings: Settings) -> Model:
    """The model to fly with its settings and effects. Raises UsageError, ModelFileError."""
    if given.model is None and not (BUILT_IN / f"{vehicle.name}.model.json").exists():
        raise UsageError(f"no model comes with the vehicle {vehicle.name!r}; give --model FILE")
    model = read_model(given.model or vehicle.name)
    try:
        for name, value in settings.coefficients.items():
            model = model.with_coefficient(name, value)
        require_controls(vehicle, model)
        for text in given.effect:
            effect, values = parse_effect(text)
            model = model.with_effect(effect, values)
    except SimVehicleError as error:
        raise UsageError(str(error)) from None
    if names := model.unknown():
        reason = model.coefficients[names[0]].refused
        demand = " ".join(f"--set {name}=VALUE" for name in names)
        raise ModelFileError(f"the model has no value for {', '.join(names)} ({reason}); give {demand}")
    return model


def failures_of(given: argparse.Namespace) -> list[Failure]:
    """What is to break in flight. Raises UsageError."""
    try:
        return [parse_failure(text) for text in given.fail]
    except SimVehicleError as error:
        raise UsageError(f"--fail {error}") from None


def flight_plan(given: argparse.Namespace, settings: Settings) -> Plan:
    """The manoeuvres to fly. Raises UsageError, PlanError."""
    if given.plan and given.manoeuvre:
        raise UsageError("give --plan or --manoeuvre, not both")
    written = read_plan(given.plan) if given.plan else None
    names = [name for text in given.manoeuvre for name in text.split(",") if name] or ["elevator-pulse"]
    try:
        plan = (written or plan_of(names)).with_settings(settings.manoeuvre)
        return plan if given.duration is None else plan.fitted(given.duration)
    except PlanError as error:
        raise UsageError(str(error)) from None
