"""`gcs performance`: polar, glide, climb and turn of an identified aircraft."""

import argparse

NAME = "performance"
HELP = "say how the aircraft of a model glides, climbs and turns, with intervals"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.outputs import PERFORMANCE, add_output

    parser.add_argument("model", metavar="MODEL.json", help="a model, a result, or the name of a built-in model")
    parser.add_argument("--vehicle", metavar="FILE", required=True, help="vehicle file or name of a built-in vehicle")
    parser.add_argument("--mass", metavar="KG", type=float, help="take-off mass (the vehicle file's)")
    parser.add_argument("--altitude", metavar="M", type=float, default=0.0, help="height in the standard atmosphere")
    parser.add_argument("--temperature", metavar="C", type=float, help="there, in degrees Celsius (the standard one)")
    parser.add_argument("--battery", metavar="WH", type=float, help="what the battery holds: how long and far it flies")
    add_output(parser, "-o", "--output", metavar="SHEET.json", kind=PERFORMANCE, help="for gcs report")
    parser.add_argument("--json", action="store_true")


def run(args: argparse.Namespace) -> int:
    """Print the sheet."""
    from gcs.exports.exported import Exported, battery_of, model_of
    from gcs.exports.performance import performance, performance_text
    from gcs.text.files import write_whole
    from gcs.text.jsontext import dumps
    from gcs.text.progress import Progress
    from sim_vehicle.vehicle.vehicle_file import load_vehicle

    model = Exported(model_of(args.model), load_vehicle(args.vehicle))
    with Progress() as progress:
        powered = battery_of(args.model)
        found = performance(model, args.mass, args.altitude, args.temperature, progress, powered, args.battery)
    if args.output is not None:
        write_whole(args.output, dumps(found, indent=2))
    print(dumps(found, indent=2) if args.json else performance_text(found))
    return 0
