"""Options of the commands that receive: the dialect, and the key of signatures."""

from __future__ import annotations

import argparse
from pathlib import Path

from gcs.errors import SettingsError
from gcs.mavlink.dialect import DEFAULT_DIALECT
from gcs.mavlink.linkoptions import LinkOptions
from gcs.mavlink.signing import load_key


def add_dialect_argument(parser: argparse.ArgumentParser) -> None:
    """--dialect."""
    parser.add_argument(
        "--dialect",
        metavar="NAME|FILE.xml",
        default=DEFAULT_DIALECT,
        help="MAVLink dialect by name, or your own definition (%(default)s)",
    )


def add_key_argument(parser: argparse.ArgumentParser) -> None:
    """--signing-key."""
    parser.add_argument(
        "--signing-key",
        metavar="FILE",
        type=Path,
        help="key to check MAVLink 2 signatures with: 32 bytes, or 64 hexadecimal digits",
    )


def add_link_arguments(parser: argparse.ArgumentParser) -> None:
    """--dialect, --signing-key and --sign."""
    add_dialect_argument(parser)
    add_key_argument(parser)
    parser.add_argument(
        "--sign", action="store_true", help="sign what the station itself sends; what is passed on never is"
    )


def add_require_signed_argument(parser: argparse.ArgumentParser) -> None:
    """--require-signed."""
    parser.add_argument(
        "--require-signed",
        action="store_true",
        help="frames without a good signature are recorded, but name no vehicle, move no clock, cut no flight and are"
        " not passed on",
    )


def link_options(args: argparse.Namespace) -> LinkOptions:
    """What the arguments say; SettingsError where that cannot be meant or the key cannot be read."""
    if args.sign and args.signing_key is None:
        raise SettingsError("--sign needs the key to sign with: give --signing-key FILE")
    key = None if args.signing_key is None else load_key(args.signing_key)
    require = getattr(args, "require_signed", False)
    if require and key is None:
        raise SettingsError("--require-signed needs the key to check with: give --signing-key FILE")
    return LinkOptions(args.dialect, key, args.sign, require)
