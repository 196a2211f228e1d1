"""`gcs check`: whether flights are good for identification."""

import argparse

NAME = "check"
HELP = "say whether recordings are good for identification, why not, and what to do better"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.flights import add_flight_arguments, add_signal_arguments

    add_flight_arguments(parser, validate=False)
    add_signal_arguments(parser)
    parser.add_argument("--json", action="store_true")


def run(args: argparse.Namespace) -> int:
    """Print the verdict: 0 for good or usable with care, 1 for too poor."""
    from gcs.analysis.check import check, check_text
    from gcs.options.flights import open_flights
    from gcs.text.jsontext import dumps

    with open_flights(args) as flights:
        found = check(
            flights.recordings,
            flights.vehicle,
            system=args.system,
            as_recorded=args.as_recorded,
            progress=flights.progress,
        )
    print(dumps(found, indent=2) if args.json else check_text(found))
    return 1 if found["quality"]["verdict"] == "poor" else 0
