"""`gcs margins`: how much the autopilot's loops can bear."""

import argparse
from pathlib import Path

NAME = "margins"
HELP = "say how near the autopilot's loops are to oscillating, and by how much each gain may grow, with intervals"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.links import add_dialect_argument

    add = parser.add_argument
    add("result", metavar="RESULT.json", type=Path, help="what gcs identify -o wrote")
    add("--vehicle", metavar="FILE", help="vehicle file or name of a built-in vehicle (as the result has it)")
    add("--log", metavar="FLIGHT", type=Path, help="whose parameters count (those of the flight that was identified)")
    add("--system", metavar="N", type=int, help="the vehicle among several in it")
    add_dialect_argument(parser)
    add("--json", action="store_true")


def run(args: argparse.Namespace) -> int:
    """Print the sheet."""
    from gcs.errors import SettingsError
    from gcs.inspection.info import as_recordings
    from gcs.report.source import read_result
    from gcs.text.jsontext import dumps
    from gcs.text.progress import Progress
    from gcs.tuning.loops import NoGainsError
    from gcs.tuning.margins import margins, margins_text, parameters_in

    result, parameters = read_result(args.result), None
    if args.log is not None:
        with as_recordings([args.log], args.dialect, None) as paths:
            parameters = parameters_in(paths[0], args.system)
    with Progress() as progress:
        try:
            found = margins(result, args.vehicle, parameters, progress)
        except NoGainsError as error:
            raise SettingsError(
                f"{error}: give by --log the recording of a board that has sent its parameters"
            ) from error
    print(dumps(found, indent=2) if args.json else margins_text(found))
    return 0
