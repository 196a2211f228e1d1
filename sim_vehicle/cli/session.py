"""One run of `sim-vehicle fly`: from the command line's words to flown flights."""

from __future__ import annotations

import argparse
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

from sim_vehicle.cli.options import (
    Settings,
    UsageError,
    check_numbers,
    failures_of,
    flight_plan,
    model_of,
    read_settings,
    read_wind,
    vehicle_of,
)
from sim_vehicle.cli.writable import unwritable
from sim_vehicle.errors import SimVehicleError, SinkError
from sim_vehicle.flight.arming import Arming
from sim_vehicle.flight.failures import Failures
from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.flight.flight_loop import fly, wind_of
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.flight.tick import Tick
from sim_vehicle.manoeuvres.plan import Plan, plan_of
from sim_vehicle.mavlink.fault_options import FaultError, Faults, read_faults
from sim_vehicle.mavlink.frame_encoder import Voice, read_key
from sim_vehicle.mavlink.multi_vehicle import OnTick, fly_together
from sim_vehicle.mavlink.outputs import Link, Sink, TcpSink, UdpSink, open_link, open_recording
from sim_vehicle.mavlink.pacing import Pacer
from sim_vehicle.mavlink.receiver_thread import Uplink
from sim_vehicle.mavlink.telemetry import Telemetry
from sim_vehicle.mavlink.timeline import Timeline
from sim_vehicle.mavlink.vehicle_node import Channel, Craft

_PROGRESS_S = 0.5


class _Flight:
    """One vehicle of the run before it flies, and what it has flown afterwards."""

    def __init__(self, given: argparse.Namespace, settings: Settings, plan: Plan, number: int) -> None:
        self.system = given.system + number
        self.vehicle = vehicle_of(given, settings, quiet=number > 0)
        model, failing = model_of(given, self.vehicle, settings), failures_of(given)
        self._failures = Failures(failing)
        self.plant = Plant(self.vehicle, Failures.flyable(model) if failing else model)
        self.arming = Arming(wait=given.wait_arm)
        sensor_seed, gust_seed, self.link_seed = np.random.SeedSequence(given.seed + number).spawn(3)
        generator = np.random.default_rng(sensor_seed)
        try:
            self._suite = SensorSuite(
                self.vehicle, noise=given.noise, generator=generator, changes=settings.sensors, failures=self._failures
            )
        except SimVehicleError as error:
            raise UsageError(str(error)) from None
        self._gusts = np.random.default_rng(gust_seed)
        self.plan, self._taxi, self._steady = plan, given.taxi, read_wind(given.wind)
        self.flown: FlownFlight | None = None

    def fly(self, on_tick: OnTick) -> None:
        """Fly, and keep what was flown."""
        self.flown = fly(
            self.plant,
            self.plan,
            suite=self._suite,
            generator=self._gusts,
            wind=wind_of(self.plant, self._steady),
            taxi=self._taxi,
            on_tick=on_tick,
            arming=self.arming,
            failures=self._failures,
        )


def run(given: argparse.Namespace) -> None:
    """Fly as the parsed command line says. Raises SimVehicleError, or UsageError for a wrong command line."""
    settings = read_settings(given.settings)
    steady = read_wind(given.wind)
    check_numbers(given)
    try:
        faults = read_faults(given.fault)
    except FaultError as error:
        raise UsageError(f"--fault {error}") from None
    key = read_key(given.signing_key) if given.signing_key else None
    plan = flight_plan(given, settings)
    problem = unwritable(Path(given.truth)) if given.truth else None
    if problem:
        raise SinkError(f"--truth {given.truth} {problem}; give another file")
    flights = [_Flight(given, settings, plan, number) for number in range(given.vehicles)]
    flights[0].plant.trim()  # what cannot fly is reported before a file is made or a ground station waited for
    _warm_up(flights[0].plant, steady)
    voices = [Voice(flight.system, version=1 if given.mavlink1 else 2, key=key) for flight in flights]
    link = None if given.record else open_link(given.out)
    sink = link or open_recording(Path(given.record))
    try:
        if link:
            _wait_for_peer(given, link)
        _fly(given, flights, voices, faults, sink, link)
    finally:
        sink.close()
    if given.truth:
        _write_truth(flights, Path(given.truth))


def _fly(
    given: argparse.Namespace,
    flights: list[_Flight],
    voices: list[Voice],
    faults: Faults,
    sink: Sink,
    link: Link | None,
) -> None:
    pacer = Pacer(given.speed) if link else None
    timeline = Timeline(pacer)
    channel = Channel(sink, pacer, timeline)
    crafts = [
        Craft(flight.vehicle, channel, voice, flight.arming, faults, flight.link_seed)
        for flight, voice in zip(flights, voices, strict=True)
    ]
    progress = _Progress(flights[0].plan.duration)
    listeners: list[OnTick] = [partial(progress.after, crafts[0]), *crafts[1:]]
    uplink = Uplink(link, crafts) if link else None
    try:
        fly_together([flight.fly for flight in flights], listeners)
        for craft in crafts:
            craft.finish()
        timeline.finish()
    finally:
        if uplink:
            uplink.close()
        timeline.close()
    progress.finish(crafts)


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


def _wait_for_peer(given: argparse.Namespace, link: Link) -> None:
    if isinstance(link, UdpSink | TcpSink):
        if given.out.startswith(("udpin:", "udp:", "tcpin:")):
            print(f"sim-vehicle: waiting for a ground station on {given.out}", file=sys.stderr, flush=True)
        link.wait_for_peer()
    if given.wait_arm:
        print("sim-vehicle: standing until a ground station arms the vehicle", file=sys.stderr, flush=True)


def _write_truth(flights: list[_Flight], path: Path) -> None:
    """The truth of one vehicle to `path`, of several to one file each, named by their systems."""
    for flight in flights:
        if flight.flown:
            own = path if len(flights) == 1 else path.with_name(f"{path.stem}-{flight.system}{path.suffix}")
            flight.flown.write_truth(own)


class _Progress:
    """Shows on a terminal how far the flight is. duration: s of the plan."""

    def __init__(self, duration: float) -> None:
        self._duration = duration
        self._shown = time.monotonic()
        self._terminal = sys.stderr.isatty()

    def after(self, craft: Craft, tick: Tick) -> None:
        """Hand a tick on, and show it from time to time."""
        craft(tick)
        if self._terminal and time.monotonic() - self._shown > _PROGRESS_S:
            self._shown = time.monotonic()
            whole = max(self._duration, tick.time_s)
            print(f"\r{tick.time_s:7.1f} s of {whole:.1f} s flown", end="", file=sys.stderr, flush=True)

    def finish(self, crafts: list[Craft]) -> None:
        """Say what was flown."""
        end = "\r" if self._terminal else ""
        several = f" by {len(crafts)} vehicles" if len(crafts) > 1 else ""
        count = sum(craft.frames for craft in crafts)
        print(f"{end}{crafts[0].flown_s:.1f} s flown{several}, {count} messages", file=sys.stderr)
