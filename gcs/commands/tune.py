"""`gcs tune`: what a flight says of the autopilot's parameters."""

import argparse
from pathlib import Path

NAME = "tune"
HELP = "propose parameters of the autopilot, each with interval and reason, as a file to compare and load"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.outputs import PARAMETERS, add_output
    from gcs.tuning.proposals import AUTOPILOTS

    parser.add_argument("result", metavar="RESULT.json", type=Path, help="what gcs identify -o wrote")
    parser.add_argument("--for", dest="autopilot", choices=AUTOPILOTS, required=True)
    add_output(parser, "-o", "--output", metavar="FILE.param", kind=PARAMETERS, help="for the ground station to load")
    parser.add_argument("--json", action="store_true")


def run(args: argparse.Namespace) -> int:
    """Print the sheet, and write the file."""
    from gcs.report.source import read_result
    from gcs.text.jsontext import dumps
    from gcs.text.progress import Progress
    from gcs.tuning.parameter_file import write_parameters
    from gcs.tuning.tune import tune, tuning_text

    with Progress() as progress:
        found = tune(read_result(args.result), args.autopilot, progress)
    print(dumps(found, indent=2) if args.json else tuning_text(found))
    if args.output is not None:
        write_parameters(found, args.output)
    return 0
