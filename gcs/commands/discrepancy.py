"""`gcs discrepancy`: where a model and the flights part, and which effect explains it."""

import argparse
from pathlib import Path

NAME = "discrepancy"
HELP = "find where a model fails to explain recordings, and name the missing effect"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("files", metavar="FILE", type=Path, nargs="+", help="recordings, or anything that import reads")
    parser.add_argument("--vehicle", metavar="FILE", required=True, help="vehicle file or name of a built-in vehicle")
    parser.add_argument("--model", metavar="MODEL.json", type=Path, required=True, help="the model to be judged")
    parser.add_argument(
        "--validate", metavar="FILE", type=Path, action="append", default=[], help="judge on this flight"
    )
    parser.add_argument("-o", "--output", metavar="RESULT.json", type=Path)
    parser.add_argument("--write-model", metavar="MODEL.json", type=Path)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def run(args: argparse.Namespace) -> int:
    """Analyse, write what was asked for, print the result."""
    from gcs.analysis.postflight import discrepancy
    from gcs.analysis.results import check_targets, discrepancy_text, write_results
    from gcs.inspection.info import as_recordings
    from gcs.text.progress import Progress
    from sim_vehicle.vehicle import load_vehicle

    check_targets(args.output, args.write_model)
    vehicle = load_vehicle(args.vehicle).path
    with as_recordings([*args.files, *args.validate]) as paths, Progress() as progress:
        result = discrepancy(
            paths[: len(args.files)],
            vehicle,
            args.model,
            validate=paths[len(args.files) :],
            progress=progress,
        )
    write_results(result, args.output, args.write_model, as_json=args.json, text=discrepancy_text)
    return 0
