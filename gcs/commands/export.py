"""`gcs export`: recordings, and logs that `gcs import` reads, in other formats."""

import argparse
from pathlib import Path

NAME = "export"
HELP = "write a recording or a log as .tlog, .csv or .parquet, or the .bin or .ulg it was imported from"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.outputs import NEW, add_output

    parser.add_argument("file", metavar="FILE", type=Path, help="a recording, or a log that import reads")
    add_output(parser, "-o", "--output", metavar="FILE", kind=NEW, required=True, help="its ending names the format")
    parser.add_argument(
        "--messages", choices=("csv", "parquet"), help="make FILE a folder with a table of this format for each message"
    )


def run(args: argparse.Namespace) -> int:
    """Export and say where to."""
    from gcs.formats.conversion import export_file
    from gcs.formats.tables import export_messages
    from gcs.inspection.info import as_recordings

    with as_recordings([args.file]) as (recording,):
        if args.messages:
            export_messages(recording, args.output, args.messages)
        else:
            export_file(recording, args.output)
    print(args.output)
    return 0
