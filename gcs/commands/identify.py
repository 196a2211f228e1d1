"""`gcs identify`: the flight model from recordings."""

import argparse
from pathlib import Path

NAME = "identify"
HELP = "identify the flight model and the sensors' errors from recordings"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.flights import add_flight_arguments, add_part_arguments, add_result_arguments, add_signal_arguments
    from gcs.options.outputs import IDENTIFICATION

    add_flight_arguments(parser)
    add_result_arguments(parser, IDENTIFICATION)
    parser.add_argument("--structure", metavar="MODEL.json", type=Path, help="identify the coefficients of this model")
    parser.add_argument("--prior", metavar="MODEL.json", type=Path, help="start from this model's values and errors")
    parser.add_argument("--method", choices=("auto", "map", "ee", "oe", "fe"), default="auto")
    add_part_arguments(parser)
    add_signal_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Identify, write what was asked for, print the result: 1 where no coefficient could be identified."""
    from gcs.analysis.postflight import identify
    from gcs.analysis.results import write_identification
    from gcs.options.flights import open_flights, require_part

    require_part(args)
    with open_flights(args) as flights:
        result = identify(
            flights.recordings,
            flights.vehicle,
            validate=flights.validate,
            structure=args.structure,
            prior=args.prior,
            method=args.method,
            start=args.start,
            stop=args.stop,
            system=args.system,
            as_recorded=args.as_recorded,
            progress=flights.progress,
        )
    return write_identification(result, args.output, args.write_model, as_json=args.json, command=NAME)
