"""`gcs export`: recordings in other formats."""

import argparse
from pathlib import Path

NAME = "export"
HELP = "write a recording as .tlog, .csv or .parquet, or the .bin or .ulg it was imported from"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("file", metavar="FILE.mcap", type=Path)
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=Path, required=True, help="its ending names the format; must not exist"
    )
    parser.add_argument(
        "--messages", choices=("csv", "parquet"), help="make FILE a folder with a table of this format for each message"
    )


def run(args: argparse.Namespace) -> int:
    """Export and say where to."""
    if args.messages:
        from gcs.formats.tables import export_messages

        export_messages(args.file, args.output, args.messages)
    else:
        from gcs.formats.conversion import export_file

        export_file(args.file, args.output)
    print(args.output)
    return 0
