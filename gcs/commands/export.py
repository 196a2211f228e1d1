"""`gcs export`: recordings in other formats."""

import argparse
from pathlib import Path

NAME = "export"
HELP = "write a recording as .tlog or .csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("file", metavar="FILE.mcap", type=Path)
    parser.add_argument("-o", "--output", metavar="FILE", type=Path, required=True, help="its ending names the format")


def run(args: argparse.Namespace) -> int:
    """Export and say where to."""
    from gcs.conversion import export_file

    export_file(args.file, args.output)
    print(args.output)
    return 0
