"""`gcs recover`: a whole recording out of one that was cut off, damaged or split."""

import argparse
import sys
from pathlib import Path

NAME = "recover"
HELP = "write a recording that was cut off or damaged, or its parts, to one whole file"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.outputs import NEW, add_output

    parser.add_argument("files", metavar="FILE.mcap", type=Path, nargs="+", help="the recording, or its parts in order")
    add_output(parser, "-o", "--output", metavar="NEW.mcap", kind=NEW, required=True)


def run(args: argparse.Namespace) -> int:
    """Recover, and say what had to be left out."""
    from gcs.errors import RecordingError
    from gcs.recording.repair import repair

    if args.output.exists():
        raise RecordingError(f"{args.output} exists already; choose another name, or remove it first")
    damage = repair(args.files, args.output)
    for note in damage.notes:
        print(f"left out: {note}", file=sys.stderr)
    print(args.output)
    return 0
