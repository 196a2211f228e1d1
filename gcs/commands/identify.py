"""`gcs identify`: the flight model from recordings."""

import argparse
from pathlib import Path

NAME = "identify"
HELP = "identify the flight model and the sensors' errors from recordings"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("files", metavar="FILE", type=Path, nargs="+", help="recordings, or anything that import reads")
    parser.add_argument("--vehicle", metavar="FILE", required=True, help="vehicle file or name of a built-in vehicle")
    parser.add_argument(
        "--validate", metavar="FILE", type=Path, action="append", default=[], help="judge on this flight"
    )
    parser.add_argument("-o", "--output", metavar="RESULT.json", type=Path)
    parser.add_argument("--write-model", metavar="MODEL.json", type=Path)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument("--structure", metavar="MODEL.json", type=Path, help="identify the coefficients of this model")
    parser.add_argument("--prior", metavar="MODEL.json", type=Path, help="start from this model's values and errors")
    parser.add_argument("--method", choices=("auto", "ee", "oe", "fe"), default="auto")
    parser.add_argument("--from", metavar="S", dest="start", type=float, help="seconds from the flight's first stamp")
    parser.add_argument("--to", metavar="S", dest="stop", type=float)
    parser.add_argument("--system", metavar="N", type=int, help="the vehicle among several")


def run(args: argparse.Namespace) -> int:
    """Identify, write what was asked for, print the result."""
    from gcs.analysis.postflight import identify
    from gcs.analysis.results import check_targets, identification_text, write_results
    from gcs.inspection.info import as_recordings
    from gcs.text.progress import Progress
    from sim_vehicle.vehicle import load_vehicle

    check_targets(args.output, args.write_model)
    vehicle = load_vehicle(args.vehicle).path
    with as_recordings([*args.files, *args.validate]) as paths, Progress() as progress:
        result = identify(
            paths[: len(args.files)],
            vehicle,
            validate=paths[len(args.files) :],
            structure=args.structure,
            prior=args.prior,
            method=args.method,
            start=args.start,
            stop=args.stop,
            system=args.system,
            progress=progress,
        )
    write_results(result, args.output, args.write_model, as_json=args.json, text=identification_text)
    return 0
