"""`gcs export-model`: a model in the form of another program."""

import argparse
import sys
from pathlib import Path

NAME = "export-model"
HELP = "write a model for JSBSim, FMI, Gazebo, DAVE-ML, MATLAB, python-control, a spreadsheet or a paper"
FORMS = ("jsbsim", "fmu", "gazebo", "daveml", "mat", "statespace", "csv", "latex")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.outputs import NEW, add_output

    parser.add_argument("model", metavar="MODEL.json", help="a model, a result, or the name of a built-in model")
    parser.add_argument("--vehicle", metavar="FILE", required=True, help="vehicle file or name of a built-in vehicle")
    parser.add_argument(
        "--to", choices=FORMS, required=True, help="jsbsim and gazebo write a folder, the others a file"
    )
    add_output(parser, "-o", "--output", metavar="PATH", kind=NEW, required=True, help="must not exist")
    parser.add_argument("--samples", metavar="N", type=int, default=0, help="more models, drawn from the errors")
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of the models drawn (default 0)")


def run(args: argparse.Namespace) -> int:
    """Write, and say what was left out."""
    from gcs.errors import SettingsError
    from gcs.exports import daveml, fmu, gazebo, jsbsim, matlab, state_space, tables
    from gcs.exports.exported import Exported, model_of, require_new
    from gcs.exports.samples import drawn
    from sim_vehicle.vehicle.vehicle_file import load_vehicle

    writers = {
        "jsbsim": jsbsim.write, "fmu": fmu.write, "gazebo": gazebo.write,
        "daveml": daveml.write, "mat": matlab.write,
        "statespace": state_space.write, "csv": tables.write_csv, "latex": tables.write_latex,
    }  # fmt: skip
    path: Path = args.output
    if args.samples < 0 or args.seed < 0:
        raise SettingsError("--samples and --seed are whole numbers from 0")
    besides = [path.with_name(f"{path.stem}-{number:04d}{path.suffix}") for number in range(1, args.samples + 1)]
    for place in (path, *besides):
        require_new(place)
    model = Exported(model_of(args.model), load_vehicle(args.vehicle))
    others = drawn(model, args.samples, args.seed) if args.samples else []
    for note in writers[args.to](model, path):
        print(f"left out: {note}", file=sys.stderr)
    if model.doubt:
        print(model.doubt, file=sys.stderr)
    print(path)
    for one, beside in zip(others, besides, strict=True):
        writers[args.to](one, beside)
        print(beside)
    return 0
