"""What a command writes, and what of a user's it may replace: checked before its work begins, for every command alike.

A command says where it writes by `add_output`, with the kind of file that it writes there. A file that stands in that
place is replaced where it is of the same kind, by its content and not by its name: a result by a newer result, but no
recording and no aircraft. `--force` replaces any file.
"""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

from gcs.errors import SettingsError
from gcs.formats.arrow import has_arrow
from gcs.text.generator import GENERATOR
from sim_vehicle.cli.writable import unwritable

_LOOKED_AT_BYTES = 4096


@dataclass(frozen=True)
class FileKind:
    """A kind of file.

    words: what it is called. begins: a pattern that its beginning has; None where no file is ever replaced. columns:
    the first ones of a Parquet file of this kind.
    """

    words: str
    begins: str | None = None
    columns: tuple[str, ...] = ()

    def holds(self, path: Path) -> bool:
        """Whether the file is of this kind; an empty one can be of any that is replaced."""
        if self.begins is None:
            return False
        with path.open("rb") as file:
            head = file.read(_LOOKED_AT_BYTES)
        if head.startswith(b"PAR1"):
            return bool(self.columns) and _parquet_columns(path)[: len(self.columns)] == self.columns
        return not head or re.match(self.begins.encode(), head, re.DOTALL) is not None


def _parquet_columns(path: Path) -> tuple[str, ...]:
    if not has_arrow():
        return ()
    from pyarrow import ArrowException, parquet

    try:
        return tuple(parquet.read_schema(path).names)
    except (ArrowException, OSError):
        return ()


def _json(words: str, schema: str) -> FileKind:
    return FileKind(words, rf'\s*\{{\s*"schema":\s*"{re.escape(schema)}"')


IDENTIFICATION = _json("result of identify", "identification/1")
DISCREPANCY = _json("result of discrepancy", "discrepancy/1")
MODEL = _json("model file", "model/1")
COAST = _json("result of coast", "coast/1")
PERFORMANCE = _json("performance sheet", "performance/1")
PLAN = _json("plan", "plan/1")
HTML = FileKind("report of this program", f"<!DOCTYPE html>.*{re.escape(GENERATOR)}")
SKETCH = FileKind("drawing by vehicle show", "<svg [^>]*from above and from the front, to scale")
PULSES = FileKind("schedule of pulse widths", r"time_s(?:,servo\d+_us)+\r?\n")
SCRIPT = FileKind("script by design", "-- A flight test for ArduPilot Plane")
FLEET_TABLE = FileKind("table of a batch", '"?flight"?,"?source"?,"?aircraft"?,', ("flight", "source", "aircraft"))
PARAMETERS = FileKind("file of parameters by this program", "# Parameters proposed by gcs")
NEW = FileKind("")


def add_output(parser: argparse.ArgumentParser, *flags: str, kind: FileKind, **options: Any) -> None:
    """Add an argument that names a file to be written, and `--force` with the first one of the command."""
    written: dict[str, FileKind] = parser.get_default("writes") or {}
    if not written:
        parser.add_argument("--force", action="store_true", help="replace a file that is there, of whatever kind")
    action = parser.add_argument(*flags, type=Path, **options)
    parser.set_defaults(writes={**written, action.dest: kind})


def require_replaceable(path: Path, kind: FileKind, *, force: bool = False) -> None:
    """Raise SettingsError, one line, where another kind of file stands in the place and is not to be replaced."""
    if not path.is_file() or (force and not (kind is NEW and path.is_symlink())):
        return
    if kind is NEW and path.is_symlink():
        raise SettingsError(f"{path} is a link to another file; give that file's own name")
    if kind is NEW:
        raise SettingsError(f"{path} exists already; choose another name, or replace it with --force")
    try:
        like = kind.holds(path)
    except OSError as error:
        raise SettingsError(f"{path} cannot be looked at: {error.strerror}; choose another name") from None
    if not like:
        raise SettingsError(
            f"{path} is there already and is no {kind.words}; give another name, or --force to replace it"
        )


@contextmanager
def outputs_of(args: argparse.Namespace) -> Iterator[None]:
    """What a command writes, from before its work to behind it.

    Raises SettingsError, before anything is done, where a place cannot be written, is named twice, or holds what is not
    to be replaced: a file of another kind, or one that the command reads. A file that `--force` replaces by a new one
    (of a command that demands a new name) stands aside until the new one is there.
    """
    writes: dict[str, FileKind] = getattr(args, "writes", {})
    places = [(getattr(args, dest), kind) for dest, kind in writes.items() if getattr(args, dest) is not None]
    there: list[Path] = []
    for path, kind in places:
        # A folder that must be new is for its own command to refuse: some commands write folders.
        why = None if kind is NEW and not path.is_file() else unwritable(path)
        if why is None and any(_same(path, other) for other in there):
            why = "is named for two results"
        if why is None and any(_same(path, other) for other in _read(args)) and not kind.holds(path):
            why = "is one of the files to be read"
        if why is not None:
            raise SettingsError(f"{path} {why}; give another file for the result")
        require_replaceable(path, kind, force=args.force)
        there.append(path)
    with _set_aside([path for path, kind in places if kind is NEW and path.is_file()]):
        yield


def _read(args: argparse.Namespace) -> list[Path]:
    """Files that stand among the other arguments."""
    found: list[Path] = []
    for dest, value in vars(args).items():
        if dest not in args.writes:
            values = value if isinstance(value, list) else [value]
            found += [Path(one) for one in values if isinstance(one, Path | str) and _is_file(Path(one))]
    return found


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # longer than the name of any file
        return False


def _same(one: Path, other: Path) -> bool:
    return one.resolve() == other.resolve() and not one.is_char_device()


@contextmanager
def _set_aside(paths: list[Path]) -> Iterator[None]:
    """Under names that show, in case that nothing comes back here: not before the new files are whole do they go."""
    aside = {path: path.with_name(f"{path.stem}.before-{uuid4().hex[:8]}{path.suffix}") for path in paths}
    try:
        for path, kept in aside.items():
            os.replace(path, kept)
        yield
    except BaseException as error:
        for path, kept in aside.items():
            if kept.exists() and path.exists():
                error.add_note(f"what stood in {path} before is in {kept}")
            elif kept.exists():
                os.replace(kept, path)
        raise
    for kept in aside.values():
        kept.unlink(missing_ok=True)
