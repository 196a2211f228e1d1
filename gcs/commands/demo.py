"""`gcs demo`: the whole thread, real at every joint, on one machine."""

import argparse
from pathlib import Path

NAME = "demo"
HELP = "fly the simulator over UDP, record, identify, find a hidden effect, and ask the REST service for it all"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        "--data", metavar="DIR", type=Path, default=Path("demo-output"), help="folder for recordings and results"
    )
    parser.add_argument("--force", action="store_true", help="use a folder that no demonstration made")
    parser.add_argument("--speed", metavar="X", type=float, default=10.0, help="flight time over wall time (10)")
    parser.add_argument("--seed", type=int, default=1, help="of all noise (1)")
    parser.add_argument(
        "--hidden", metavar="EFFECT", default="stall:alpha_stall=0.2", help="effect that the second aircraft hides"
    )


def run(args: argparse.Namespace) -> int:
    """Run the demonstration."""
    from gcs.demo.run import SERVICE_LOG, Demo
    from gcs.errors import SettingsError
    from sim_vehicle.effects import parse_effect

    if not args.speed > 0.0:
        raise SettingsError(f"--speed {args.speed:g}: give a speed above 0")
    parse_effect(args.hidden)
    if args.data.is_dir() and any(args.data.iterdir()) and not (args.data / SERVICE_LOG).is_file() and not args.force:
        raise SettingsError(
            f"{args.data} holds files that no demonstration wrote; give another folder, or --force to write into it"
        )
    Demo(args.data, args.speed, args.seed, args.hidden).run()
    return 0
