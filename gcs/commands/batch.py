"""`gcs batch`: identify hundreds of flights, here or on other machines, and what they say together."""

import argparse
from pathlib import Path

NAME = "batch"
HELP = "identify many flights, on this machine or a Dask cluster; their table and a report of the fleet"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add = parser.add_argument
    add("sources", metavar="FOLDER|PATTERN|URL", nargs="+", help="recordings and logs; folders of aircraft with a"
        " vehicle.toml each, patterns, or addresses as s3://bucket/flights")  # fmt: skip
    add("--vehicle", metavar="FILE", help="vehicle file or built-in name, for folders without a vehicle.toml")
    add("-o", "--output", metavar="DIR", type=Path, required=True, help="results, table and report; a run that was"
        " ended goes on there")  # fmt: skip
    add("--method", choices=("auto", "map", "ee", "oe", "fe"), default="auto")
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
    from gcs.fleet.page import change_line, fleet_page
    from gcs.fleet.rows import rows_of, write_table
    from gcs.fleet.together import together
    from gcs.text.files import write_whole
    from gcs.text.progress import Progress
    from sim_vehicle.vehicle.vehicle_file import load_vehicle

    if args.workers is not None and args.workers < 1:
        raise SettingsError(f"--workers {args.workers}: give how many processes work, 1 or more")
    # By its whole name: workers stand in other folders.
    vehicle = args.vehicle
    if vehicle is not None and "://" not in vehicle:
        load_vehicle(vehicle)
        vehicle = str(Path(vehicle).resolve()) if Path(vehicle).is_file() else vehicle
    found = orders(args.sources, vehicle, {"method": args.method})
    with places(args.workers, args.scheduler) as where, Progress() as progress:
        results = work(found, args.output / "results", where, progress)
    rows = rows_of(found, results)
    write_table(rows, args.output / "flights.parquet")
    write_table(rows, args.output / "flights.csv")
    fleet = together(rows)
    write_whole(args.output / "fleet.html", fleet_page(fleet, rows))
    begun = {str(row["source"]): int(row["start_ns"]) for row in rows}
    for aircraft, name, change in fleet.changes:
        print(change_line(aircraft, name, change, begun[change.flight]))
    for flight, why in fleet.failed:
        print(f"no result: {flight}: {why}")
    good = len(rows) - len(fleet.failed)
    print(f"{good} of {len(rows)} flights identified: {args.output / 'fleet.html'}, flights.parquet, flights.csv")
    return 0 if good else 1
