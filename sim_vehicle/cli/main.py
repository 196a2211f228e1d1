"""The command `sim-vehicle`: flies a simulated vehicle into a link or a recording."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import NoReturn

from sim_vehicle.cli.completion import add_completion
from sim_vehicle.errors import SimVehicleError, VehicleFileError

INTERRUPTED = 130  # what shells say of a command that Ctrl-C ended


class _Parser(argparse.ArgumentParser):
    """Reports a wrong command line in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def build_parser() -> argparse.ArgumentParser:
    """The parser of the commands."""
    parser = _Parser(prog="sim-vehicle", description=__doc__)
    add_completion(parser)
    commands = parser.add_subparsers(dest="command", required=True)
    fly = commands.add_parser("fly", help="fly manoeuvres and send or record the telemetry")
    add = fly.add_argument
    _add_aircraft(fly)
    add("--manoeuvre", action="append", default=[], metavar="NAME[,NAME...]", help="manoeuvres, in order")
    add("--plan", metavar="PLAN.json", help="a plan file instead of --manoeuvre")
    add("--fail", action="append", default=[], metavar="NAME[=SIZE]@SECONDS",
        help="break a surface, a wing, a sensor in flight, as elevator=0.5@40; "
        "see docs/reference/simulator.md")  # fmt: skip
    add("--duration", type=float, metavar="S", help="repeat or cut the manoeuvres to this many seconds")
    add("--noise", choices=("table2", "none"), default="table2", help="sensor errors (default table2)")
    add("--taxi", action="store_true", help="begin and end standing on the ground")
    add("--truth", metavar="FILE.json", help="write the simulation's truth")
    add("--speed", type=float, default=1.0, metavar="X", help="of a link: times real time (default 1)")
    add("--system", type=int, default=1, metavar="N", help="MAVLink system id of the vehicle (default 1)")
    add("--vehicles", type=int, default=1, metavar="K",
        help="fly K vehicles at once, systems N to N+K-1, each with the next seed")  # fmt: skip
    add("--fault", action="append", default=[], metavar="KEY=VALUE[,...]",
        help="loss, delay, jitter, late, duplicate, reorder, corrupt, garbage, outage=BEGIN:END, "
        "drift-ppm, clock-reset=S; see docs/reference/simulator.md")  # fmt: skip
    add("--wait-arm", action="store_true", help="with --taxi: stand until a ground station arms the vehicle")
    add("--signing-key", metavar="FILE", help="sign frames and take only signed ones: 32 bytes, or 64 hex digits")
    add("--mavlink1", action="store_true", help="speak MAVLink 1, which has no AIRSPEED, AOA_SSA, DEBUG_FLOAT_ARRAY")
    where = fly.add_mutually_exclusive_group(required=True)
    where.add_argument("--out", metavar="URL", help="udpout:HOST:PORT, tcp:HOST:PORT, /dev/TTY,BAUD ...")
    where.add_argument("--record", metavar="FILE.mcap|FILE.tlog", help="record as fast as the machine goes")
    sitl = commands.add_parser("sitl", help="be the aircraft of an ArduPilot or a PX4 that runs as a program")
    _add_aircraft(sitl)
    sitl.add_argument("--autopilot", choices=("ardupilot", "px4"), default="ardupilot",
        help="ardupilot: JSON interface over UDP; px4: lockstep over TCP")  # fmt: skip
    sitl.add_argument("--listen", metavar="HOST:PORT", help="default 127.0.0.1:9002 (UDP), of px4 127.0.0.1:4560 (TCP)")
    sitl.add_argument("--rate", type=float, metavar="HZ", help="of px4's sensors (default 250)")
    sitl.add_argument("--speed", type=float, metavar="X",
        help="of px4: times real time, 0 as fast as it answers (default 1)")  # fmt: skip
    sitl.add_argument("--heading", type=float, default=0.0, metavar="DEG", help="of the runway (default 0, north)")
    return parser


def _add_aircraft(parser: argparse.ArgumentParser) -> None:
    """Which aircraft, with which model, in which air."""
    add = parser.add_argument
    add("--vehicle", default="iitb-mav", metavar="NAME|FILE", help="vehicle file, or one that comes with the package")
    add("--model", metavar="FILE", help="model file (default: the vehicle's own)")
    add("--effect", action="append", default=[], metavar="NAME[:KEY=VALUE...]", help="add an effect to the model")
    add("--set", action="append", default=[], metavar="NAME=VALUE", dest="settings",
        help="a coefficient (CL_alpha), manoeuvre.amplitude, sensors.accel_bias_x, flight.airspeed ...")  # fmt: skip
    add("--seed", type=int, default=0, metavar="N", help="seed of noise and gusts (default 0)")
    add("--wind", default="0,0,0", metavar="N,E,D", help="velocity of the air, m/s")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; exit code 0 done, 1 failed on its input, 2 wrong use."""
    parser = build_parser()
    try:
        given = parser.parse_args(arguments)
    except SystemExit as stop:
        return int(stop.code or 0)
    from sim_vehicle.cli.options import UsageError

    try:
        if given.command == "sitl":
            from sim_vehicle.cli.autopilot import serve

            serve(given)
        else:
            from sim_vehicle.cli.session import run

            run(given)
    except (UsageError, VehicleFileError) as error:
        print(f"sim-vehicle: {error}", file=sys.stderr)
        return 2
    except SimVehicleError as error:
        print(f"sim-vehicle: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("sim-vehicle: interrupted", file=sys.stderr)
        return INTERRUPTED
    return 0


if __name__ == "__main__":
    sys.exit(main())
