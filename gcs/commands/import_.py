"""`gcs import`: logs of other formats."""

import argparse
from pathlib import Path

NAME = "import"
HELP = "turn a log of another format into a recording"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("file", metavar="FILE", type=Path)
    parser.add_argument("-o", "--output", metavar="FILE.mcap", type=Path, required=True)


def run(args: argparse.Namespace) -> int:
    """Import and say where to."""
    from gcs.conversion import import_file

    import_file(args.file, args.output)
    print(args.output)
    return 0
