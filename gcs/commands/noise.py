"""`gcs noise`: the sensors' noise, estimated from a recording at rest."""

import argparse
from pathlib import Path

NAME = "noise"
HELP = "estimate the noise of each sensor from a recording at rest"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.links import add_dialect_argument

    parser.add_argument("file", metavar="FILE", type=Path, help="a recording at rest, or anything that import reads")
    parser.add_argument("--vehicle", metavar="FILE", help="vehicle file, for its calibrations and signals")
    parser.add_argument("--from", metavar="S", dest="start", type=float, help="seconds from the first stamp")
    parser.add_argument("--to", metavar="S", dest="stop", type=float)
    parser.add_argument("--system", metavar="N", type=int, help="the vehicle among several")
    add_dialect_argument(parser)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def run(args: argparse.Namespace) -> int:
    """Analyse and print."""
    from gcs.analysis.noise import noise_of_recording, noise_text
    from gcs.inspection.info import as_recordings
    from gcs.text.jsontext import dumps
    from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle

    vehicle = load_vehicle(args.vehicle) if args.vehicle else Vehicle.unknown()
    with as_recordings([args.file], args.dialect) as (path,):
        result = noise_of_recording(path, vehicle, start=args.start, stop=args.stop, system=args.system)
    print(dumps(result, indent=2) if args.json else noise_text(result))
    return 0
