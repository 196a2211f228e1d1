"""Options of the commands that estimate from flights: which flights and vehicle, and where the result goes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.options.links import add_dialect_argument
from gcs.options.outputs import MODEL, FileKind, add_output

if TYPE_CHECKING:
    from gcs.text.progress import Progress


@dataclass(frozen=True)
class OpenFlights:
    """What the arguments name: recordings to estimate from and to judge on, and the vehicle's file."""

    recordings: list[Path]
    validate: list[Path]
    vehicle: Path
    progress: Progress


def add_flight_arguments(parser: argparse.ArgumentParser, validate: bool = True) -> None:
    """FILE, --vehicle, --validate (if asked for) and --dialect."""
    add = parser.add_argument
    add("files", metavar="FILE", type=Path, nargs="+", help="recordings, or anything that import reads")
    add("--vehicle", metavar="FILE", required=True, help="vehicle file or name of a built-in vehicle")
    if validate:
        add("--validate", metavar="FILE", type=Path, action="append", default=[], help="judge on this flight")
    add("--columns", metavar="MAP.toml", type=Path, help="what the columns of tables are, and their units")
    add_dialect_argument(parser)


def add_signal_arguments(parser: argparse.ArgumentParser) -> None:
    """--as-recorded and --system: how a flight's signals are read."""
    parser.add_argument(
        "--as-recorded", metavar="SIGNAL", action="append", default=[], help="take this signal as it was recorded"
    )
    parser.add_argument("--system", metavar="N", type=int, help="the vehicle among several")


def add_part_arguments(parser: argparse.ArgumentParser) -> None:
    """--from and --to: the part of the flights."""
    parser.add_argument("--from", metavar="S", dest="start", type=float, help="seconds from the flight's first stamp")
    parser.add_argument("--to", metavar="S", dest="stop", type=float)


def require_part(args: argparse.Namespace) -> None:
    """Raise SettingsError for a part of the flight that is none."""
    from gcs.analysis.flight_part import part_problem
    from gcs.errors import SettingsError

    if problem := part_problem(args.start, args.stop):
        raise SettingsError(f"--from, --to: {problem}")


def add_result_arguments(parser: argparse.ArgumentParser, kind: FileKind) -> None:
    """-o, --write-model, --force and --json."""
    add_output(parser, "-o", "--output", metavar="RESULT.json", kind=kind)
    add_output(parser, "--write-model", metavar="MODEL.json", kind=MODEL)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


@contextmanager
def open_flights(args: argparse.Namespace) -> Iterator[OpenFlights]:
    """The flights as recordings while the block lasts; logs of other formats are imported for that time.

    Raises VehicleFileError, ImportFileError, DialectError, RecordingError.
    """
    from gcs.inspection.info import as_recordings
    from gcs.text.progress import Progress
    from sim_vehicle.vehicle.vehicle_file import load_vehicle

    vehicle = load_vehicle(args.vehicle)
    for warning in (
        () if Progress.silent else vehicle.warnings
    ):  # before the job: it takes minutes, and a wrong unit makes them worthless
        print(f"gcs {args.command}: warning: {warning}", file=sys.stderr, flush=True)
    judges = getattr(args, "validate", [])
    with as_recordings([*args.files, *judges], args.dialect, args.columns) as paths, Progress() as progress:
        count = len(args.files)
        yield OpenFlights(paths[:count], paths[count:], vehicle.path, progress)
