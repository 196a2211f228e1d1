"""Completion of command lines by the shell: a script that is printed, to be put where the shell looks for such."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

_SHELLS = ("bash", "zsh", "tcsh")


def add_completion(parser: argparse.ArgumentParser) -> None:
    """Add --print-completion to a command."""
    parser.add_argument(
        "--print-completion",
        action=_PrintCompletion,
        metavar="SHELL",
        choices=_SHELLS,
        help="bash, zsh or tcsh: a script",
    )


class _PrintCompletion(argparse.Action):
    """Print the script for a shell and end. Its library is loaded then alone."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        import shtab

        print(shtab.complete(parser, str(values)))
        parser.exit(0)
