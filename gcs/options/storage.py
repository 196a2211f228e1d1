"""Options of the commands that record: how the files are kept on disk."""

from __future__ import annotations

import argparse

from gcs.recording.storage import (
    DEFAULT_RESERVE_BYTES,
    DEFAULT_SYNC,
    SMALLEST_SPLIT_BYTES,
    StorageOptions,
    SyncPolicy,
)
from gcs.text.sizes import parse_size


def add_storage_arguments(parser: argparse.ArgumentParser) -> None:
    """--fsync, --split-size and --reserve."""
    parser.add_argument(
        "--fsync",
        metavar="WHEN",
        default=DEFAULT_SYNC,
        help="when the disk must have what was written: never, close (at the end of a file), chunk (each chunk), or"
        f" every so many seconds and at the end ({DEFAULT_SYNC})",
    )
    parser.add_argument(
        "--split-size", metavar="SIZE", help="size, as 512MB, at which a recording goes on in another file"
    )
    parser.add_argument(
        "--reserve",
        metavar="SIZE",
        default=f"{DEFAULT_RESERVE_BYTES >> 20}MiB",
        help="free space on the disk at which recording stops (%(default)s)",
    )


def storage_options(args: argparse.Namespace) -> StorageOptions:
    """What the arguments say; SettingsError where that cannot be meant."""
    split = None
    if args.split_size is not None:
        split = parse_size(args.split_size, "--split-size", SMALLEST_SPLIT_BYTES)
    return StorageOptions(SyncPolicy.parse(args.fsync), split, parse_size(args.reserve, "--reserve"))
