"""One run of `sim-vehicle fly`: from the command line's words to a flown flight."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from sim_vehicle.effects import parse_effect
from sim_vehicle.errors import ModelFileError, PlanError, SimVehicleError, SinkError
from sim_vehicle.fly import fly, wind_of
from sim_vehicle.model import BUILT_IN, Model, read_model
from sim_vehicle.pacing import Pacer
from sim_vehicle.plan import Plan, plan_of, read_plan
from sim_vehicle.plant import Plant
from sim_vehicle.sensors import SensorSuite
from sim_vehicle.sinks import Sink, TcpSink, UdpSink, check_link, open_link, open_recording
from sim_vehicle.telemetry import Telemetry, Tick
from sim_vehicle.vehicle import Vehicle, load_vehicle
from sim_vehicle.vehicleclock import BOOT_S

_PROGRESS_S = 0.5
_FLIGHT_SETTINGS = ("airspeed", "altitude")


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
    unknown = [name for name in found.flight if name not in _FLIGHT_SETTINGS]
    if unknown:
        raise UsageError(f"--set flight.{unknown[0]}: there are {', '.join(_FLIGHT_SETTINGS)}")
    return found


def read_wind(text: str) -> tuple[float, float, float]:
    """N,E,D in m/s. Raises UsageError."""
    try:
        north, east, down = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"--wind {text}: give three numbers NORTH,EAST,DOWN in m/s") from None
    if not all(map(math.isfinite, (north, east, down))):
        raise UsageError(f"--wind {text}: give three finite numbers")
    return north, east, down


def _vehicle(given: argparse.Namespace, settings: Settings) -> Vehicle:
    vehicle = load_vehicle(given.vehicle)
    for warning in vehicle.warnings:
        print(f"sim-vehicle: warning: {vehicle.path}: {warning}", file=sys.stderr)
    return replace(vehicle, flight=replace(vehicle.flight, **settings.flight))


def _model(given: argparse.Namespace, vehicle: Vehicle, settings: Settings) -> Model:
    if given.model is None and not (BUILT_IN / f"{vehicle.name}.model.json").exists():
        raise UsageError(f"no model comes with the vehicle {vehicle.name!r}; give --model FILE")
    model = read_model(given.model or vehicle.name)
    try:
        for name, value in settings.coefficients.items():
            model = model.with_coefficient(name, value)
        for text in given.effect:
            effect, values = parse_effect(text)
            model = model.with_effect(effect, values)
    except SimVehicleError as error:
        raise UsageError(str(error)) from None
    if model.refused():
        names = model.refused()
        reason = model.coefficients[names[0]].refused
        demand = " ".join(f"--set {name}=VALUE" for name in names)
        raise ModelFileError(f"the model has no value for {', '.join(names)} ({reason}); give {demand}")
    return model


def _plan(given: argparse.Namespace, settings: Settings) -> Plan:
    if given.plan and given.manoeuvre:
        raise UsageError("give --plan or --manoeuvre, not both")
    written = read_plan(given.plan) if given.plan else None
    names = [name for text in given.manoeuvre for name in text.split(",") if name] or ["elevator-pulse"]
    try:
        plan = (written or plan_of(names)).with_settings(settings.manoeuvre)
        return plan if given.duration is None else plan.fitted(given.duration)
    except PlanError as error:
        raise UsageError(str(error)) from None


def run(given: argparse.Namespace) -> None:
    """Fly as the parsed command line says. Raises SimVehicleError, or UsageError for a wrong command line."""
    settings = read_settings(given.settings)
    steady = read_wind(given.wind)
    if not (math.isfinite(given.speed) and given.speed > 0.0):
        raise UsageError(f"--speed {given.speed:g}: give a number above 0")
    if given.seed < 0:
        raise UsageError(f"--seed {given.seed}: give a whole number from 0")
    if given.out:
        try:
            check_link(given.out)
        except SinkError as error:
            raise UsageError(f"--out {error}") from None
    vehicle = _vehicle(given, settings)
    plant = Plant(vehicle, _model(given, vehicle, settings))
    plan = _plan(given, settings)
    sensor_seed, gust_seed = np.random.SeedSequence(given.seed).spawn(2)
    generator = np.random.default_rng(sensor_seed)
    try:
        suite = SensorSuite(vehicle, noise=given.noise, generator=generator, changes=settings.sensors)
    except SimVehicleError as error:
        raise UsageError(str(error)) from None
    plant.trim()  # what cannot fly is told before a file is made or a ground station waited for
    _warm_up(plant, steady)
    sink = _open(given)
    try:
        pacer = Pacer(given.speed) if given.out else None
        sender = Sender(sink, pacer, plan.duration)
        flown = fly(
            plant,
            plan,
            suite=suite,
            generator=np.random.default_rng(gust_seed),
            wind=wind_of(plant, steady),
            taxi=given.taxi,
            on_tick=sender,
        )
        sender.finish()
    finally:
        sink.close()
    if given.truth:
        flown.write_truth(given.truth)


def _warm_up(plant: Plant, steady: tuple[float, float, float]) -> None:
    """Fly a moment to nowhere, so that compilation and imports do not hold up the first frames of the flight."""
    suite = SensorSuite(plant.vehicle, generator=np.random.default_rng(0))
    telemetry = Telemetry(epoch_us=0)

    def encode(tick: Tick) -> None:
        telemetry.frames(tick)

    fly(
        plant,
        plan_of(["cruise"]).fitted(0.1),
        suite=suite,
        generator=np.random.default_rng(0),
        wind=wind_of(plant, steady),
        on_tick=encode,
    )


def _open(given: argparse.Namespace) -> Sink:
    if given.record:
        return open_recording(Path(given.record))
    link = open_link(given.out)
    if isinstance(link, UdpSink | TcpSink):
        if given.out.startswith(("udpin:", "udp:", "tcpin:")):
            print(f"sim-vehicle: waiting for a ground station on {given.out}", file=sys.stderr, flush=True)
        link.wait_for_peer()
    return link


class Sender:
    """Sends each tick's frames at its time, and tells a terminal how far the flight is.

    pacer: None for a file, whose stamps then count from now. duration: s of the plan.
    """

    def __init__(
        self, sink: Sink, pacer: Pacer | None, duration: float, utc_ns: Callable[[], int] = time.time_ns
    ) -> None:
        self._sink, self._pacer, self._duration, self._utc_ns = sink, pacer, duration, utc_ns
        self._start_ns = utc_ns()
        self._telemetry: Telemetry | None = None
        self._frames = 0
        self._flown_s = 0.0
        self._shown = time.monotonic()
        self._terminal = sys.stderr.isatty()

    def __call__(self, tick: Tick) -> None:
        if self._telemetry is None:
            self._start_ns = self._utc_ns()
            epoch_us = self._start_ns // 1000 - round(BOOT_S * 1e6)
            self._telemetry = Telemetry(epoch_us=epoch_us)
        frames = self._telemetry.frames(tick)
        if self._pacer:
            self._pacer.wait_until(tick.time_s)
        sent_ns = self._start_ns + round(tick.time_s * 1e9)
        for frame in frames:
            self._sink.write(frame, sent_ns)
        self._frames += len(frames)
        self._flown_s = tick.time_s
        if self._terminal and time.monotonic() - self._shown > _PROGRESS_S:
            self._shown = time.monotonic()
            whole = max(self._duration, tick.time_s)
            print(f"\r{tick.time_s:7.1f} s of {whole:.1f} s flown", end="", file=sys.stderr, flush=True)

    def finish(self) -> None:
        """Say what was flown."""
        end = "\r" if self._terminal else ""
        print(f"{end}{self._flown_s:.1f} s flown, {self._frames} messages", file=sys.stderr)
