"""`gcs discrepancy`: where a model and the flights part, and which effect explains it."""

import argparse
from collections.abc import Sequence
from pathlib import Path

NAME = "discrepancy"
HELP = "find where a model fails to explain recordings, and name the missing effect"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.flights import add_flight_arguments, add_part_arguments, add_result_arguments, add_signal_arguments
    from gcs.options.outputs import DISCREPANCY

    add_flight_arguments(parser)
    parser.add_argument("--model", metavar="MODEL.json", type=Path, required=True, help="the model to be judged")
    parser.add_argument(
        "--rule-out",
        metavar="EFFECT[,EFFECT]",
        action="append",
        default=[],
        help="effects that weighing or a test on the bench has shown not to be there",
    )
    parser.add_argument(
        "--method",
        choices=("auto", "map", "fe"),
        default="auto",
        help="map: for flights as the field gives them; fe: filter error, for those of the textbooks; auto sees which",
    )
    add_part_arguments(parser)
    add_signal_arguments(parser)
    add_result_arguments(parser, DISCREPANCY)


def run(args: argparse.Namespace) -> int:
    """Analyse, write what was asked for, print the result."""
    from gcs.analysis.postflight import discrepancy
    from gcs.analysis.results import discrepancy_text, write_results
    from gcs.options.flights import open_flights, require_part

    require_part(args)
    ruled_out = _effects(args.rule_out)
    with open_flights(args) as flights:
        result = discrepancy(
            flights.recordings,
            flights.vehicle,
            args.model,
            validate=flights.validate,
            ruled_out=ruled_out,
            method=args.method,
            start=args.start,
            stop=args.stop,
            system=args.system,
            as_recorded=args.as_recorded,
            progress=flights.progress,
        )
    write_results(result, args.output, args.write_model, as_json=args.json, text=discrepancy_text)
    return 0


def _effects(texts: Sequence[str]) -> list[str]:
    """Names of effects, with commas between in each text. Raises SettingsError for the name of none."""
    from gcs.errors import SettingsError
    from sim_vehicle.effects import effect_called
    from sim_vehicle.errors import ModelFileError

    try:
        return [effect_called(name.strip()).name for text in texts for name in text.split(",")]
    except ModelFileError as error:
        raise SettingsError(f"--rule-out: {error}") from error
