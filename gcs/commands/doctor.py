"""`gcs doctor`: whether this machine is fit for the field."""

import argparse
from pathlib import Path

NAME = "doctor"
HELP = "look whether this machine can record and serve: rights, ports, disk, clock; says what to do"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        "--data", metavar="DIR", type=Path, default=Path("data"), help="folder of flights (default data)"
    )
    parser.add_argument("--port", type=int, default=8000, help="port of the page and REST (default 8000)")
    parser.add_argument("--udp", type=int, default=14550, help="port of telemetry (default 14550)")
    parser.add_argument("--json", action="store_true")


def run(args: argparse.Namespace) -> int:
    """Print what was found; 1 where something must be done first."""
    from dataclasses import asdict

    from gcs.errors import SettingsError
    from gcs.inspection.doctor import examine
    from gcs.text.jsontext import dumps

    for option, number in (("--port", args.port), ("--udp", args.udp)):
        if not 0 <= number <= 65535:
            raise SettingsError(f"{option} {number}: a port is a number from 0 to 65535")
    found = list(examine(args.data, args.port, args.udp))
    if args.json:
        print(dumps([asdict(one) for one in found], indent=2))
    else:
        signs = {"good": "ok  ", "care": "care", "bad": "BAD "}
        for one in found:
            print(f"{signs[one.level]}  {one.name}: {one.text}")
            if one.cure:
                print(f"      {one.cure}")
    return 1 if any(one.level == "bad" for one in found) else 0
