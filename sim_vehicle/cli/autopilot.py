"""One run of `sim-vehicle sitl`: the physics of an ArduPilot or a PX4 that runs as a program."""

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
from sim_vehicle.sitl.px4_server import Px4Server
from sim_vehicle.sitl.server import SitlServer


def serve(given: argparse.Namespace) -> None:
    """Fly for the autopilot until Ctrl-C. Raises SimVehicleError, or UsageError for a wrong command line."""
    settings, steady = read_settings(given.settings), read_wind(given.wind)
    if settings.sensors or settings.manoeuvre:
        raise UsageError(
            "--set: sensors and manoeuvres are the autopilot's here; there are coefficients and flight.NAME"
        )
    if given.seed < 0:
        raise UsageError(f"--seed {given.seed}: give a whole number from 0")
    of_px4 = given.autopilot == "px4"
    if not of_px4 and (given.rate is not None or given.speed is not None):
        raise UsageError("--rate and --speed are of --autopilot px4; ArduPilot asks for each step by itself")
    rate, speed = (250.0 if given.rate is None else given.rate), (1.0 if given.speed is None else given.speed)
    if not (20.0 <= rate <= 1000.0 and 0.0 <= speed <= 100.0):
        raise UsageError("--rate is between 20 and 1000 Hz, --speed between 0 and 100")
    host, port = _address(given.listen or ("127.0.0.1:4560" if of_px4 else "127.0.0.1:9002"))
    vehicle = vehicle_of(given, settings)
    plant = Plant(vehicle, model_of(given, vehicle, settings))
    generator = np.random.default_rng(given.seed)
    flight = AutopilotFlight(plant, wind_of(plant, steady), math.radians(given.heading), generator)
    # What is compiled is compiled before anybody waits for an answer.
    flight.step((0,) * 16, 0.0025)
    flight.restart()
    where = "127.0.0.1" if host in ("127.0.0.1", "localhost") else "the address of this machine"
    server: SitlServer | Px4Server
    if of_px4:
        server = Px4Server(flight, (host, port), rate, speed, generator, _say)
        how = f"PX4_SIM_MODEL=gazebo-classic_plane PX4_SIM_HOSTNAME={where} ./build/px4_sitl_default/bin/px4"
    else:
        server = SitlServer(flight, host, port, _say)
        how = f"sim_vehicle.py -v ArduPlane --model JSON:{where}"
    place = f"{'TCP' if of_px4 else 'UDP'} {host}:{server.address[1]}"
    _say(f"serving on {place}: {vehicle.name} stands on its wheels; start the autopilot with")
    _say(f"  {how}")
    # A shell starts what runs in the background with Ctrl-C ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with suppress(KeyboardInterrupt):  # the way that it ends
            server.serve()
    finally:
        _say(str(server.counts))
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
