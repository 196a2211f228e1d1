"""The reference of all commands, from the parsers that read them."""

from __future__ import annotations

import argparse
import os

from gcs.cli import build_parser as gcs_parser
from sim_vehicle.cli.main import build_parser as simulator_parser

_HEAD = """# Commands

What each command takes, as `--help` prints it. Exit codes are 0 done, 1 failed on its input, 2 wrong use; an error is
one line on standard error that says what to do. Where `FILE` stands for flights, it is a recording or anything that
`gcs import` reads.
"""
_COLUMNS = "110"


def page() -> str:
    """The page in Markdown, a section for each command."""
    parts = [_HEAD]
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = _COLUMNS  # argparse breaks its lines there
    try:
        for parser in (gcs_parser(), simulator_parser()):
            for name, command in sorted(subcommands(parser).items()):
                parts.append(f"## {parser.prog} {name}\n\n```text\n{command.format_help().rstrip()}\n```\n")
    finally:
        os.environ.pop("COLUMNS")
        if before is not None:
            os.environ["COLUMNS"] = before
    return "\n".join(parts)


def subcommands(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """The parsers of a program's commands by name."""
    groups = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    return {name: command for group in groups for name, command in group.choices.items()}
