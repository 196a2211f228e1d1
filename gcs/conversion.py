"""Recordings in other formats: which there are, and which module reads or writes each."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

from gcs.errors import ImportFileError, RecordingError


def _copy(source: Path, target: Path) -> None:
    """A recording is taken as it is, once it has opened."""
    from gcs.recording.reader import Recording

    Recording(source)
    shutil.copyfile(source, target)


def _import_tlog(source: Path, target: Path) -> None:
    from gcs.tlog import import_tlog

    import_tlog(source, target)


def _export_tlog(source: Path, target: Path) -> None:
    from gcs.tlog import export_tlog

    export_tlog(source, target)


def _export_csv(source: Path, target: Path) -> None:
    from gcs.tables import export_csv

    export_csv(source, target)


IMPORTS: dict[str, Callable[[Path, Path], None]] = {".mcap": _copy, ".tlog": _import_tlog}
EXPORTS: dict[str, Callable[[Path, Path], None]] = {".tlog": _export_tlog, ".csv": _export_csv}


def check_file(path: Path) -> None:
    """ImportFileError where there is no file of that name."""
    if path.is_dir():
        raise ImportFileError(f"{path} is a folder; name a file in it")
    if not path.is_file():
        raise ImportFileError(f"{path}: there is no such file")


def import_file(source: Path, target: Path, ending: str | None = None) -> None:
    """Write the recording `source` as MCAP to `target`.

    ending: of the original name (".tlog"), where `source` itself has another. Raises ImportFileError, RecordingError.
    """
    ending = (source.suffix if ending is None else ending).lower()
    if ending not in IMPORTS:
        raise ImportFileError(
            f"{ending or 'a file without an ending'} cannot be imported; this version reads {', '.join(IMPORTS)}"
        )
    check_file(source)
    if target.exists() and target.samefile(source):
        raise ImportFileError(f"{source} would be written over itself; choose another name for the output")
    IMPORTS[ending](source, target)


def export_file(source: Path, target: Path) -> None:
    """Write the recording `source` in the format that the ending of `target` names. Raises RecordingError."""
    ending = target.suffix.lower()
    if ending not in EXPORTS:
        raise RecordingError(
            f"{target.name}: {ending or 'no ending'} cannot be exported; this version writes {', '.join(EXPORTS)}"
        )
    EXPORTS[ending](source, target)
