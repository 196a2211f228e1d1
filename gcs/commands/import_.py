"""`gcs import`: logs of other formats."""

import argparse
from pathlib import Path

NAME = "import"
HELP = (
    "turn a log (.tlog, ArduPilot .bin, .log, PX4 .ulg), a table (.csv, .parquet, .mat, .npz) or a bag into a recording"
)
_QUIET_S = 2.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.links import add_dialect_argument
    from gcs.options.outputs import NEW, add_output

    parser.add_argument(
        "file",
        metavar="FILE",
        type=Path,
        help="its ending names the format; or a folder of a log's topics, a .csv of each",
    )
    add_output(parser, "-o", "--output", metavar="FILE.mcap", kind=NEW, required=True, help="must not exist yet")
    parser.add_argument(
        "--columns", metavar="MAP.toml", type=Path, help="what the columns of a table are, and their units"
    )
    add_dialect_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Import and say where to."""
    from gcs.formats.conversion import import_file
    from gcs.text.progress import Progress

    with Progress(after_s=_QUIET_S) as progress:
        import_file(
            args.file,
            args.output,
            progress=lambda share: progress(share, "importing"),
            dialect=args.dialect,
            columns=args.columns,
        )
    print(args.output)
    return 0
