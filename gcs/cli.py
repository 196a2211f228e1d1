"""The command line: `gcs COMMAND …`. Each command is a module of `gcs.commands`.

Exit codes: 0 done, 1 failed on its input (one line on standard error), 2 wrong use: settings and
connection strings that cannot be meant, and a vehicle file that cannot be used, 130 interrupted.
"""

from __future__ import annotations

import argparse
import gc
import importlib
import os
import pkgutil
import shutil
import signal
import sys
import textwrap
import warnings
from collections.abc import Mapping, Sequence
from types import FrameType, ModuleType

import gcs.commands
from gcs.errors import GcsError, LinkUrlError, SettingsError
from gcs.text.progress import Progress
from gcs.version import VERSION
from sim_vehicle.cli.completion import add_completion
from sim_vehicle.cli.main import INTERRUPTED
from sim_vehicle.errors import SimVehicleError, VehicleFileError

_OBJECTS_BETWEEN_LOOKS = 50_000
# Warnings that are shown in the line of an error.
_NOTICED = 4
#: Commands as the help lists them, by what somebody is about to do.
GROUPS = {
    "to begin with": ("demo", "doctor"),
    "before a flight": ("vehicle", "prior", "calibrate", "noise", "design"),
    "in flight": ("record", "serve", "station", "token", "replay"),
    "recordings and logs": ("import", "export", "info", "recover", "repair"),
    "after a flight": (
        "check",
        "identify",
        "report",
        "discrepancy",
        "performance",
        "tune",
        "margins",
        "coast",
        "batch",
        "export-model",
    ),
}
_WRONG_USE = (SettingsError, LinkUrlError, VehicleFileError)


def _modules() -> list[ModuleType]:
    """Every command: a module with NAME, HELP, add_arguments(parser) and run(args) -> exit code."""
    names = sorted(module.name for module in pkgutil.iter_modules(gcs.commands.__path__))
    return [importlib.import_module(f"gcs.commands.{name}") for name in names]


class _InGroups(argparse.RawDescriptionHelpFormatter):
    """Help whose description lists the commands; argparse alone would once more, in one long row."""

    def add_argument(self, action: argparse.Action) -> None:
        if not isinstance(action, argparse._SubParsersAction):
            super().add_argument(action)


def _overview(about: Mapping[str, str]) -> str:
    """What the program is for, and its commands in groups."""
    lines = ["Ground station: from telemetry to a flight model."]
    width = max(min(shutil.get_terminal_size().columns, 110), 60)
    for title, names in GROUPS.items():
        lines += ["", f"{title}:"]
        for name in names:
            lines += textwrap.wrap(about[name], width, initial_indent=f"  {name:<14}", subsequent_indent=" " * 16)
    return "\n".join([*lines, "", "`gcs COMMAND --help` has the options of each."])


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    modules = _modules()
    parser = argparse.ArgumentParser(
        prog="gcs", usage="%(prog)s [-h] [--version] [--print-completion SHELL] COMMAND ...",
        description=_overview({module.NAME: module.HELP for module in modules}),
        formatter_class=_InGroups,
    )  # fmt: skip
    parser.add_argument("--version", action="version", version=f"gcs {VERSION}")
    add_completion(parser)
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", prog="gcs")
    for module in modules:
        command = commands.add_parser(module.NAME, help=module.HELP, description=module.HELP)
        module.add_arguments(command)
        command.add_argument("--quiet", action="store_true", help="no progress and no remarks on standard error")
        command.set_defaults(run=module.run)
    return parser


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; its exit code. arguments: those of the process where None is given."""
    if arguments is None:
        # Hundreds of thousands of objects come with the libraries to stay; to look through them again and again for
        # cycles takes a tenth of a second.
        gc.set_threshold(_OBJECTS_BETWEEN_LOOKS, 20, 20)
    try:
        return _run(arguments)
    finally:
        if arguments is None:
            # The process ends, and would look for cycles among millions of objects first: a quarter of a second.
            gc.freeze()


def _run(arguments: Sequence[str] | None) -> int:
    parser = build_parser()
    args = parser.parse_args(arguments)
    if args.command is None:
        parser.print_help()
        return 0
    from gcs.options.outputs import outputs_of
    from sysid.errors import SysidError  # which loads scipy: not for --help

    Progress.silent = args.quiet
    # A trial of an estimation that runs away is refused by its cost; what numpy remarks on it helps no user.
    warnings.filterwarnings("ignore", category=RuntimeWarning)
    # A shell starts background commands with SIGINT ignored; a recorder must close its file all the same.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    try:
        with outputs_of(args):
            return int(args.run(args))
    except (GcsError, SysidError, SimVehicleError) as error:
        noticed = list(getattr(error, "__notes__", ()))
        shown = [*noticed[:_NOTICED], *([f"and {len(noticed) - _NOTICED} more"] if len(noticed) > _NOTICED else [])]
        before = f" (noticed before: {'; '.join(shown)})" if shown else ""
        print(f"gcs {args.command}: {error}{before}", file=sys.stderr)
        return 2 if isinstance(error, _WRONG_USE) else 1
    except OSError as error:
        if isinstance(error, BrokenPipeError):
            # The reader of our output (head, less) has gone; nothing more is to be written, not even by Python's exit.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1
        name = f"{error.filename}: " if error.filename else ""
        print(f"gcs {args.command}: {name}{error.strerror or error}", file=sys.stderr)
    except KeyboardInterrupt:
        print(f"gcs {args.command}: interrupted", file=sys.stderr)
        return INTERRUPTED
    return 1


if __name__ == "__main__":
    sys.exit(main())
