"""`gcs coast`: a flight without GPS for a while, on its model."""

import argparse
from pathlib import Path

NAME = "coast"
HELP = "take GPS away for a while, fly on by the model, and show the drift beside that by inertia alone"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.links import add_dialect_argument
    from gcs.options.outputs import COAST, add_output

    add = parser.add_argument
    add("files", metavar="FLIGHT", type=Path, nargs=1, help="a recording, or anything that import reads")
    add("--model", metavar="MODEL.json", required=True, help="a model, a result, or the name of a built-in model")
    add("--vehicle", metavar="FILE", required=True, help="vehicle file or name of a built-in vehicle")
    add("--without", metavar="gps:SECONDS", required=True, help="how long there is no GPS, as gps:60")
    add("--at", metavar="S", type=float, help="when it begins, s from the flight's first stamp (at the flight's end)")
    add("--system", metavar="N", type=int, help="the vehicle among several")
    add("--columns", metavar="MAP.toml", type=Path, help="what the columns of tables are, and their units")
    add_dialect_argument(parser)
    add_output(parser, "-o", "--output", metavar="COAST.json", kind=COAST, help="for gcs report")
    parser.add_argument("--json", action="store_true")


def run(args: argparse.Namespace) -> int:
    """Print what came of it."""
    from gcs.analysis.coast import coast, coast_text, seconds_without
    from gcs.exports.exported import model_of
    from gcs.options.flights import open_flights
    from gcs.text.files import write_whole
    from gcs.text.jsontext import dumps

    seconds, model = seconds_without(args.without), model_of(args.model)
    with open_flights(args) as flights:
        found = coast(
            flights.recordings[0],
            flights.vehicle,
            model,
            seconds,
            start_s=args.at,
            system=args.system,
            progress=flights.progress,
        )
    if args.output is not None:
        write_whole(args.output, dumps(found, indent=2))
    print(dumps(found, indent=2) if args.json else coast_text(found))
    return 0
