"""`gcs design`: what a planned flight can identify, before it is flown."""

import argparse
from pathlib import Path

NAME = "design"
HELP = "plan a test flight and predict the error bars that it will give"

_DURATIONS = "20,60"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.outputs import PLAN, PULSES, SCRIPT, add_output

    add = parser.add_argument
    add("--vehicle", metavar="FILE", required=True, help="vehicle file or name of a built-in vehicle")
    add("--model", metavar="MODEL.json", required=True, help="prior model, or name of a built-in vehicle's model")
    add("--manoeuvre", metavar="NAME[,NAME...]", action="append", default=[],
        help="as of sim-vehicle fly (default: a multisine on all surfaces, tuned)")  # fmt: skip
    add("--tune", action="store_true", help="time the named manoeuvres to the model's modes and size them to --limit")
    add("--plan", metavar="PLAN.json", type=Path, help="predict for an existing plan instead")
    add("--spectrum", choices=("flat", "d-optimal"), default="flat", help="of a tuned multisine (default flat)")
    add("--limit", metavar="NAME=VALUE", action="append", default=[],
        help="alpha, beta, bank, pitch, surface (degrees from trim), airspeed (percent)")  # fmt: skip
    add("--duration", metavar="S", type=float, help="seconds; the manoeuvres are repeated or cut")
    add("--set", metavar="NAME=VALUE", action="append", default=[], dest="settings",
        help="a coefficient (CL_alpha), manoeuvre.amplitude, flight.airspeed ...")  # fmt: skip
    add("--rate", metavar="HZ", type=float, default=50.0, help="samples per second (default 50)")
    add("--gusts", metavar="SIGMA", type=float, default=0.0, help="turbulence to expect, m/s (default calm air)")
    add("--without", metavar="SENSOR", action="append", default=[], choices=("alpha", "beta", "thrust", "gps"),
        help="a sensor that the aircraft does not carry: alpha, beta, thrust, gps")  # fmt: skip
    add("--structure", metavar="MODEL.json", type=Path, help="estimate the coefficients of this model")
    add("--compare", metavar="S[,S...]", nargs="?", const=_DURATIONS,
        help=f"compare the usual manoeuvres, tuned, in these durations (default {_DURATIONS} s)")  # fmt: skip
    add_output(
        parser, "-o", "--output", kind=PLAN, metavar="PLAN.json", help="write the plan for sim-vehicle fly --plan"
    )
    add_output(parser, "--pwm", kind=PULSES, metavar="FILE.csv",
        help="write the plan as pulse widths of the servos on the prior's trim")  # fmt: skip
    add_output(parser, "--lua", kind=SCRIPT, metavar="FILE.lua",
        help="write the plan as a script that ArduPilot Plane flies")  # fmt: skip
    add("--json", action="store_true", help="print the result as JSON")


def run(args: argparse.Namespace) -> int:
    """Design, write what was asked for, print what the flight can identify."""
    from gcs.design.ardupilot import lua_script
    from gcs.design.prediction import Request, compare, design
    from gcs.design.pulses import pulse_schedule
    from gcs.design.text import comparison_text, design_text
    from gcs.errors import SettingsError
    from gcs.text.files import write_whole
    from gcs.text.jsontext import dumps
    from gcs.text.progress import Progress
    from sim_vehicle.model.model_file import read_model
    from sim_vehicle.vehicle.vehicle_file import load_vehicle

    if args.plan and (args.manoeuvre or args.tune):
        raise SettingsError("give --plan or --manoeuvre, not both; a plan is not tuned")
    vehicle, model = load_vehicle(args.vehicle), read_model(args.model)
    named = [name for text in args.manoeuvre for name in text.split(",") if name]
    request = Request(
        manoeuvres=named or ["multisine"],
        tune=args.tune or not named,
        plan=args.plan,
        spectrum=args.spectrum,
        duration=args.duration,
        settings=args.settings,
        limits=args.limit,
        rate_hz=args.rate,
        without=args.without,
        gusts=args.gusts,
        structure=None if args.structure is None else read_model(args.structure),
    )
    if args.compare is not None:
        with Progress(after_s=3.0) as progress:
            rows = compare(vehicle, model, request, durations_of(args.compare), progress)
        print(dumps(rows, indent=2) if args.json else comparison_text(rows))
        return 0
    with Progress(after_s=3.0) as progress:
        made = design(vehicle, model, request, progress)
    if args.output is not None:
        write_whole(args.output, dumps(made.plan_json(), indent=2) + "\n")
    if args.pwm is not None:
        pulse_schedule(made.vehicle, made.model, made.plan, args.rate).write_csv(args.pwm)
    if args.lua is not None:
        write_whole(args.lua, lua_script(made.vehicle, made.model, made.plan, args.rate))
    print(dumps(made.result, indent=2) if args.json else design_text(made.result))
    return 0


def durations_of(text: str) -> list[float]:
    """Seconds from S[,S...]. Raises SettingsError."""
    from gcs.errors import SettingsError

    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = [0.0]
    if not all(4.0 <= duration <= 3600.0 for duration in found):
        raise SettingsError(f"--compare {text}: give durations from 4 to 3600 s, as 20,60")
    return found
