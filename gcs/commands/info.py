"""`gcs info`: what a recording holds."""

import argparse
from pathlib import Path

NAME = "info"
HELP = "show messages, rates, losses and clocks of a recording"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("file", metavar="FILE", type=Path, help="a recording, or anything that import reads")
    parser.add_argument("--json", action="store_true")


def run(args: argparse.Namespace) -> int:
    """Print the description."""
    from gcs.info import as_recordings, describe_recording, info_text
    from gcs.jsontext import dumps

    with as_recordings([args.file]) as (path,):
        info = {**describe_recording(path), "file": str(args.file), "size_bytes": args.file.stat().st_size}
    print(dumps(info, indent=2) if args.json else info_text(info))
    return 0
