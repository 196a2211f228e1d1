"""One run of `sim-vehicle sitl`: the physics of an ArduPilot that runs as a program."""

from __future__ import annotations

import argparse
import math
import signal
import sys
from contextlib import suppress

import numpy as np

from sim_vehicle.cli.options import UsageError, model_of, read_settings, read_wind, vehicle_of
from sim_vehicle.flight.flight_loop import wind_of
from sim_vehicle.flight.plant import Plant
from sim_vehicle.sitl.physics import AutopilotFlight
from sim_vehicle.sitl.server import SitlServer


def serve(given: argparse.Namespace) -> None:
    """Answer SITL until Ctrl-C. Raises SimVehicleError, or UsageError for a wrong command line."""
    settings, steady = read_settings(given.settings), read_wind(given.wind)
    if settings.sensors or settings.manoeuvre:
        raise UsageError(
            "--set: sensors and manoeuvres are the autopilot's here; there are coefficients and flight.NAME"
        )
    if given.seed < 0:
        raise UsageError(f"--seed {given.seed}: give a whole number from 0")
    host, port = _address(given.listen)
    vehicle = vehicle_of(given, settings)
    plant = Plant(vehicle, model_of(given, vehicle, settings))
    generator = np.random.default_rng(given.seed)
    flight = AutopilotFlight(plant, wind_of(plant, steady), math.radians(given.heading), generator)
    # What is compiled is compiled before anybody waits for an answer.
    flight.step((0,) * 16, 0.0025)
    flight.restart()
    server = SitlServer(flight, host, port, _say)
    _say(f"serving on UDP {host}:{server.address[1]}: {vehicle.name} stands on its wheels; start the autopilot with")
    where = "127.0.0.1" if host in ("127.0.0.1", "localhost") else "the address of this machine"
    _say(f"  sim_vehicle.py -v ArduPlane --model JSON:{where}")
    # A shell starts what runs in the background with Ctrl-C ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with suppress(KeyboardInterrupt):  # the way that it ends
            server.serve()
    finally:
        counts = server.counts
        _say(f"{counts.frames} steps, {counts.again} asked for again, {counts.lost} lost, {counts.restarts} restarts")
        server.close()


def _address(text: str) -> tuple[str, int]:
    host, _, number = text.rpartition(":")
    try:
        port = int(number)
    except ValueError:
        port = -1
    if not host or not 0 <= port <= 65535:
        raise UsageError(f"--listen {text}: give HOST:PORT, as 127.0.0.1:9002")
    return host, port


def _say(text: str) -> None:
    print(f"sim-vehicle: {text}", file=sys.stderr, flush=True)
