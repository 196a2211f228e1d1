"""`gcs info`: what a recording holds."""

import argparse
from pathlib import Path

NAME = "info"
HELP = "show messages, rates, losses and clocks of a recording"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.links import add_dialect_argument, add_key_argument

    parser.add_argument("file", metavar="FILE", type=Path, help="a recording, or anything that import reads")
    add_dialect_argument(parser)
    add_key_argument(parser)
    parser.add_argument("--vehicle", metavar="FILE", help="also say what it is worth for this aircraft (gcs check)")
    parser.add_argument("--json", action="store_true")


def run(args: argparse.Namespace) -> int:
    """Print the description."""
    from gcs.inspection.info import as_recordings, describe_recording, info_text
    from gcs.mavlink.signing import load_key
    from gcs.text.jsontext import dumps
    from gcs.text.quality import quality_lines

    key = None if args.signing_key is None else load_key(args.signing_key)
    with as_recordings([args.file], args.dialect) as (path,):
        info = {**describe_recording(path, key), "file": str(args.file)}
        if path != args.file:
            info |= {"files": [args.file.name], "size_bytes": args.file.stat().st_size}
        if args.vehicle is not None:
            from gcs.analysis.check import check

            info = {"quality": check([path], args.vehicle)["quality"], **info}
    head = quality_lines(info.get("quality"))
    print(dumps(info, indent=2) if args.json else "\n".join([*head, info_text(info)]))
    return 0
