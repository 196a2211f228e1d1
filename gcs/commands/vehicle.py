"""`gcs vehicle`: describe an aircraft by what one measures, and look at what a vehicle file says."""

import argparse
from pathlib import Path

NAME = "vehicle"
HELP = "make, check or show a vehicle file, or estimate moments of inertia"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.outputs import SKETCH, add_output
    from gcs.options.vehicle import add_estimate_arguments, add_new_arguments

    doing = parser.add_subparsers(dest="doing", required=True, metavar="new|check|show|estimate")

    new = doing.add_parser("new", help="make a vehicle file; asks for what is not given")
    add_new_arguments(new)

    check = doing.add_parser("check", help="say what is doubtful in a vehicle file; with --flight, against one")
    check.add_argument("file", metavar="FILE", help="vehicle file or name of a built-in vehicle")
    check.add_argument("--flight", metavar="LOG", type=Path, help="a recording, or anything that import reads")
    check.add_argument("--system", metavar="N", type=int, help="the vehicle among several")

    show = doing.add_parser("show", help="print what follows from a vehicle file; -o draws the aircraft")
    show.add_argument("file", metavar="FILE", help="vehicle file or name of a built-in vehicle")
    add_output(show, "-o", "--output", metavar="SKETCH.svg", kind=SKETCH)
    show.add_argument("--json", action="store_true")

    add_estimate_arguments(doing.add_parser("estimate", help="a moment of inertia from swings, or from span and mass"))


def run(args: argparse.Namespace) -> int:
    """Do what was asked."""
    return {"new": _new, "check": _check, "show": _show, "estimate": _estimate}[args.doing](args)


def _new(args: argparse.Namespace) -> int:
    from gcs.options.vehicle import answers_from
    from gcs.text.files import write_whole
    from gcs.vehicles.document import with_answers
    from gcs.vehicles.shelf import read_text
    from gcs.vehicles.words import vehicle_lines

    text = with_answers("", answers_from(args))
    vehicle = read_text(text)
    write_whole(args.output, text)
    warnings = list(vehicle.warnings)
    if not vehicle.controls:
        warnings.append(
            "no control surface is known: no model can be estimated without; give each as --control"
            " elevator=2:1100,1500,1900:-20,0,22, or --log FILE of an autopilot that has their parameters"
        )
    if vehicle.propulsion is not None and not vehicle.propulsion.moving_mass_known:
        warnings.append(
            "where a sensor measures thrust, drag needs the mass that hangs on it: weigh motor and propeller, and give"
            " --moving-mass (0 where nothing does)"
        )
    if vehicle.propulsion is None:
        warnings.append("no thrust is known: drag will be refused; give --thrust, the largest static one in N")
    print("\n".join([*vehicle_lines(vehicle), *(f"warning: {one}" for one in warnings)]))
    print(f"written: {args.output}; draw it with: gcs vehicle show {args.output} -o sketch.svg")
    return 0


def _check(args: argparse.Namespace) -> int:
    from gcs.analysis.check import check, check_text
    from gcs.inspection.info import as_recordings
    from gcs.text.progress import Progress
    from gcs.vehicles.words import vehicle_lines
    from sim_vehicle.vehicle.vehicle_file import load_vehicle

    vehicle = load_vehicle(args.file)
    print("\n".join([*vehicle_lines(vehicle), *(f"warning: {one}" for one in vehicle.warnings)]))
    if args.flight is None:
        return 0
    with as_recordings([args.flight], "ardupilotmega") as paths, Progress() as progress:
        found = check(paths, vehicle.path, system=args.system, progress=progress)
    found["warnings"] = [one for one in found["warnings"] if one not in vehicle.warnings]
    print()
    print(check_text(found))
    return 1 if found["quality"]["verdict"] == "poor" else 0


def _show(args: argparse.Namespace) -> int:
    from gcs.text.files import write_whole
    from gcs.text.jsontext import dumps
    from gcs.vehicles.figures import figures
    from gcs.vehicles.sketch import sketch
    from gcs.vehicles.words import vehicle_lines
    from sim_vehicle.vehicle.vehicle_file import load_vehicle

    vehicle = load_vehicle(args.file)
    if args.json:
        found = [{**vars(one), "is_usual": one.is_usual} for one in figures(vehicle)]
        print(dumps({"name": vehicle.name, "figures": found, "warnings": list(vehicle.warnings)}, indent=2))
    else:
        print("\n".join(vehicle_lines(vehicle)))
    if args.output is not None:
        write_whole(args.output, sketch(vehicle))
    return 0


def _estimate(args: argparse.Namespace) -> int:
    from gcs.options.vehicle import estimated
    from gcs.text.jsontext import dumps

    found = estimated(args)
    if args.json:
        print(dumps({name: {"value": one.value, "std": one.std, "unit": "kg m^2"} for name, one in found.items()}))
    else:
        print("[mass]  # kg m^2, for the vehicle file")
        for name, one in found.items():
            print(f"{name} = {one.value:.4g}\n{name}_std = {one.std:.2g}")
    return 0
