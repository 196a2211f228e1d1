"""`gcs calibrate`: the curve of a sensor from bench points."""

import argparse
from pathlib import Path

NAME = "calibrate"
HELP = "fit the calibration curve of a sensor to bench points"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("points", metavar="POINTS.csv", type=Path, help="columns reference, reading, maybe direction")
    parser.add_argument("--form", required=True, help="linear, polynomial:N, spline or pitot")
    parser.add_argument("--unit", default="", help="of the references: Pa mmH2O N gf deg rad us V, or m/s for pitot")
    parser.add_argument("--json", action="store_true")


def run(args: argparse.Namespace) -> int:
    """Fit and print the curve."""
    from gcs.analysis.results import calibration_text
    from gcs.errors import SettingsError
    from gcs.text.jsontext import dumps
    from sysid.calibration import MAX_DEGREE, UNITS, calibrate, read_points

    forms = {"linear", "spline", "pitot", *(f"polynomial:{degree}" for degree in range(1, MAX_DEGREE + 1))}
    if args.form not in forms:
        raise SettingsError(f"--form {args.form}: use linear, polynomial:N (N = 1 to {MAX_DEGREE}), spline or pitot")
    if args.unit not in UNITS:
        raise SettingsError(f"--unit {args.unit}: known are {', '.join(name for name in UNITS if name)}")
    result = calibrate(read_points(args.points), args.form, args.unit).to_json()
    print(dumps(result, indent=2) if args.json else calibration_text(result))
    return 0
