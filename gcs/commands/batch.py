"""`gcs batch`: identify hundreds of flights, or hold a model against them, here or on other machines."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

NAME = "batch"
HELP = "identify many flights, or hold a model against them, on this machine or a Dask cluster; table and report"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add = parser.add_argument
    add("sources", metavar="FOLDER|PATTERN|URL", nargs="+", help="recordings and logs; folders of aircraft with a"
        " vehicle.toml each, patterns, or addresses as s3://bucket/flights")  # fmt: skip
    add("--vehicle", metavar="FILE", help="vehicle file or built-in name, for folders without a vehicle.toml")
    add("-o", "--output", metavar="DIR", type=Path, required=True, help="results, table and report; a run that was"
        " ended goes on there")  # fmt: skip
    add("--force", action="store_true", help="replace tables and pages of that folder that no batch wrote")
    add("--method", choices=("auto", "map", "ee", "oe", "fe"), default="auto")
    add("--discrepancy", metavar="MODEL", help="look for where the flights differ from this model file or built-in"
        " model instead, and for the effect that explains it")  # fmt: skip
    add("--campaigns", action="store_true", help="estimate the flights of each folder together, as one campaign")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", metavar="N", type=int, help="processes of this machine (default: one for each core)"
    )
    where.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="a Dask scheduler, whose workers do the work")


def run(args: argparse.Namespace) -> int:
    """Do what is left, write the table and the report, print changes; 1 where no flight has a result."""
    from gcs.errors import SettingsError
    from gcs.fleet.batch import places
    from gcs.fleet.batch import run as work
    from gcs.fleet.orders import orders
    from gcs.fleet.rows import finding_lines, findings_of, rows_of, write_table
    from gcs.formats.arrow import has_arrow
    from gcs.jobs.runner import COMPARED_BY
    from gcs.options.outputs import FLEET_TABLE, HTML, require_replaceable
    from gcs.text.progress import Progress
    from sim_vehicle.model.model_file import read_model
    from sim_vehicle.vehicle.vehicle_file import load_vehicle

    if args.workers is not None and args.workers < 1:
        raise SettingsError(f"--workers {args.workers}: give how many processes work, 1 or more")
    # By its whole name: workers stand in other folders.
    vehicle = args.vehicle
    if vehicle is not None and "://" not in vehicle:
        load_vehicle(vehicle)
        vehicle = str(Path(vehicle).resolve()) if Path(vehicle).is_file() else vehicle
    if args.discrepancy is not None and args.method not in COMPARED_BY:
        raise SettingsError(f"--method {args.method}: flights are held against a model by {', '.join(COMPARED_BY)}")
    options: dict[str, Any] = {"method": args.method}
    if args.discrepancy is not None:
        options["model"] = read_model(args.discrepancy).to_json()
    table = "findings" if args.discrepancy else "flights"
    tables = [f"{table}.{ending}" for ending in ("parquet", "csv") if ending == "csv" or has_arrow()]
    for name, kind in (*((name, FLEET_TABLE) for name in tables), ("fleet.html", HTML)):
        require_replaceable(args.output / name, kind, force=args.force)
    found = orders(args.sources, vehicle, options, args.campaigns)
    with places(args.workers, args.scheduler) as where, Progress() as progress:
        results = work(found, args.output / "results", where, progress)
    what = "campaigns" if args.campaigns else "flights"
    rows = findings_of(found, results) if args.discrepancy else rows_of(found, results)
    for name in tables:
        write_table(rows, args.output / name)
    lines = finding_lines(rows, what) if args.discrepancy else _reported(rows, args.output / "fleet.html", what)
    failed = [row for row in rows if row["error"]]
    short = [row for row in rows if row["left_out"]]
    lines += [f"left out of {row['flight']}: {row['left_out']}" for row in short]
    for line in (*lines, *(f"no result: {row['flight']}: {row['error']}" for row in failed)):
        print(line)
    good, done = len(rows) - len(failed), "compared" if args.discrepancy else "identified"
    files = tables if args.discrepancy else ["fleet.html", *tables]
    without = "" if has_arrow() else " (no Parquet: pip install 'flight-model-ground-station[parquet]')"
    print(f"{good} of {len(rows)} {what} {done}: {args.output / files[0]}, {', '.join(files[1:])}{without}")
    return 0 if good else 1


def _reported(rows: Sequence[Mapping[str, Any]], path: Path, what: str) -> list[str]:
    """Write the report of a fleet; its changes, one line each."""
    from gcs.fleet.page import change_line, fleet_page
    from gcs.fleet.together import together
    from gcs.text.files import write_whole

    fleet = together(rows)
    write_whole(path, fleet_page(fleet, rows, what))
    begun = {str(row["source"]): int(row["start_ns"]) for row in rows}
    return [change_line(aircraft, name, change, begun[change.flight]) for aircraft, name, change in fleet.changes]
