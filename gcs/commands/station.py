"""`gcs station`: ask a station that runs elsewhere, over its REST interface."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcs.api.schemas.jobs import JobView
    from gcs.client.station import Station

NAME = "station"
HELP = "ask a running station: list flights and models, upload a log, identify a flight there"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.flights import add_part_arguments, add_result_arguments
    from gcs.options.outputs import IDENTIFICATION

    parser.add_argument("url", metavar="URL", help="address of the station, as http://192.168.1.10:8000")
    _add_connection_arguments(parser)
    parser.set_defaults(token_file=None, timeout=30.0)
    doing = parser.add_subparsers(dest="doing", required=True, metavar="flights|upload|identify|job|models")

    flights = doing.add_parser("flights", help="list flights, the newest first")
    flights.add_argument("--search", metavar="WORDS", default="", help="those with these words in id, name or start")
    flights.add_argument("--limit", metavar="N", type=int, default=50, help="so many at most (default 50)")

    upload = doing.add_parser("upload", help="hand a log, table or bag in; prints the id of its flight")
    upload.add_argument("file", metavar="FILE", type=Path)
    upload.add_argument("--name", help="what it is called there, with its ending; else the file's name")
    upload.add_argument("--columns", metavar="MAP.toml", type=Path, help="what the columns of a table are")

    identify = doing.add_parser("identify", help="identify a flight there, wait, and print the result")
    identify.add_argument("flight", metavar="FLIGHT_ID")
    identify.add_argument("--validate", metavar="FLIGHT_ID", action="append", default=[], help="judge on this flight")
    identify.add_argument("--vehicle", metavar="ID", help="an aircraft of the station; without it the flight's own")
    identify.add_argument("--method", choices=("auto", "map", "ee", "oe", "fe"), default="auto")
    add_part_arguments(identify)
    identify.add_argument("--no-wait", action="store_true", help="print the queued job and do not wait for its end")
    add_result_arguments(identify, IDENTIFICATION)

    job = doing.add_parser("job", help="show a job's state and log")
    job.add_argument("job", metavar="JOB_ID")
    job.add_argument("--wait", action="store_true", help="until it is over")

    models = doing.add_parser("models", help="list identified models, the newest first")

    for one in (flights, upload, identify, job, models):
        _add_connection_arguments(one)
        one.add_argument("--quiet", action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
        if one is not identify:
            one.add_argument("--json", action="store_true")


def _add_connection_arguments(parser: argparse.ArgumentParser) -> None:
    """Before and behind what is to be done alike."""
    add, unset = parser.add_argument, argparse.SUPPRESS
    add("--token-file", metavar="FILE", type=Path, default=unset, help="file with the token, else GCS_TOKEN")
    add("--timeout", metavar="S", type=float, default=unset, help="how long the station may be silent (default 30)")


def run(args: argparse.Namespace) -> int:
    """Ask what was asked for."""
    from gcs.client.station import Station
    from gcs.settings import read_token

    doing: dict[str, Callable[[Station, argparse.Namespace], int]] = {
        "flights": _flights,
        "upload": _upload,
        "identify": _identify,
        "job": _job,
        "models": _models,
    }
    token = read_token("localhost", args.token_file) or ""
    with Station(args.url, token, args.timeout) as station:
        return doing[args.doing](station, args)


def _flights(station: Station, args: argparse.Namespace) -> int:
    from gcs.client.listing import flight_lines
    from gcs.errors import SettingsError
    from gcs.text.jsontext import dumps

    if args.limit < 1:
        raise SettingsError(f"--limit {args.limit}: give a number above 0")
    found = station.flights(args.limit, search=args.search)
    print(dumps([one.model_dump() for one in found], indent=2) if args.json else "\n".join(flight_lines(found)))
    return 0


def _models(station: Station, args: argparse.Namespace) -> int:
    from gcs.client.listing import model_lines
    from gcs.text.jsontext import dumps

    found = station.models()
    print(dumps([one.model_dump() for one in found], indent=2) if args.json else "\n".join(model_lines(found)))
    return 0


def _upload(station: Station, args: argparse.Namespace) -> int:
    from gcs.text.jsontext import dumps
    from gcs.text.one_line import one_line
    from gcs.text.progress import Progress

    columns = "" if args.columns is None else _mapping(args.columns)
    with Progress() as progress:
        made = station.upload(args.file, args.name, columns=columns, on_progress=progress)
    if made.note and not args.json and not Progress.silent:
        print(f"gcs station: {one_line(made.note)}", file=sys.stderr)
    print(dumps(made.model_dump(), indent=2) if args.json else one_line(made.id))
    return 0


def _mapping(path: Path) -> str:
    from gcs.errors import SettingsError

    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise SettingsError(f"--columns {path}: no text in UTF-8") from None


def _identify(station: Station, args: argparse.Namespace) -> int:
    from gcs.analysis.results import write_identification
    from gcs.errors import SettingsError, StationError
    from gcs.options.flights import require_part
    from gcs.text.one_line import one_line
    from gcs.text.progress import Progress

    require_part(args)
    if args.no_wait and (args.output is not None or args.write_model is not None):
        raise SettingsError("-o and --write-model need the result, for which --no-wait does not wait")
    job = station.identify(
        args.flight,
        validate=args.validate,
        vehicle=args.vehicle,
        method=args.method,
        from_=args.start,
        to=args.stop,
    )
    if args.no_wait:
        return _print_job(job, args)
    with Progress() as progress:
        over = station.wait(job, on_progress=lambda done, text: progress(done, one_line(text)))
    if over.state != "done":
        raise StationError(one_line(f"job {over.id} {over.state}: {over.error or 'nothing came of it'}"))
    result = station.result(over.flight_id, "identify", over.id)
    return write_identification(result, args.output, args.write_model, as_json=args.json, command=args.command)


def _job(station: Station, args: argparse.Namespace) -> int:
    from gcs.text.one_line import one_line
    from gcs.text.progress import Progress

    if not args.wait:
        return _print_job(station.job(args.job), args)
    with Progress() as progress:
        over = station.wait(args.job, on_progress=lambda done, text: progress(done, one_line(text)))
    return _print_job(over, args)


def _print_job(job: JobView, args: argparse.Namespace) -> int:
    """1 for a job that gave no result: it failed, was cancelled, or there was nothing to do."""
    from gcs.client.listing import job_lines
    from gcs.text.jsontext import dumps

    print(dumps(job.model_dump(), indent=2) if args.json else "\n".join(job_lines(job)))
    return 1 if job.state in ("failed", "cancelled", "skipped") else 0
