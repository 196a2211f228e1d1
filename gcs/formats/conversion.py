"""Recordings in other formats: which there are, and which module reads or writes each."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.errors import ImportFileError, RecordingError
from gcs.mavlink.dialect import DEFAULT_DIALECT, Dialect

if TYPE_CHECKING:
    from gcs.recording.container import Container

#: Gets the share that is done, 0 to 1.
Progress = Callable[[float], None]


def _copy(source: Path, target: Path, progress: Progress, dialect: str, name: str) -> None:
    """A recording is taken as it is, once it has opened; one that was cut off is completed. A ROS bag is imported."""
    from gcs.recording.container import Container
    from gcs.recording.repair import repair

    opened = Container(source)
    if _is_ros(opened):
        _import_ros(source, target, progress, dialect, name)
    elif opened.damage.truncated:
        repair([source], target, remember=True)
    else:
        shutil.copyfile(source, target)


def _import_tlog(source: Path, target: Path, progress: Progress, dialect: str, name: str) -> None:
    from gcs.formats.tlog import import_tlog

    import_tlog(source, target, Dialect.load(dialect), progress, name)


def _import_dataflash(source: Path, target: Path, progress: Progress, dialect: str, name: str) -> None:
    from gcs.importers.ardupilot import import_dataflash

    import_dataflash(source, target, progress, name)


def _import_ulog(source: Path, target: Path, progress: Progress, dialect: str, name: str) -> None:
    from gcs.importers.ulog import import_ulog

    import_ulog(source, target, progress, name)


def _import_text(source: Path, target: Path, progress: Progress, dialect: str, name: str) -> None:
    """A table, or ArduPilot's log as text."""
    import numpy as np

    from gcs.importers.dataflash_text import is_text

    with source.open("rb") as file:
        head = np.frombuffer(file.read(4096), np.uint8)
    (_import_dataflash if is_text(head) else _import_table)(source, target, progress, dialect, name)


def _import_table(source: Path, target: Path, progress: Progress, dialect: str, name: str) -> None:
    from gcs.importers.table import import_table

    import_table(source, target, progress, name)


def _import_matlab(source: Path, target: Path, progress: Progress, dialect: str, name: str) -> None:
    """A table, or ArduPilot's log as Mission Planner saves it."""
    from gcs.importers.ardupilot import import_mission_planner
    from gcs.importers.dataflash_matlab import is_mission_planner

    if is_mission_planner(source):
        import_mission_planner(source, target, progress, name)
    else:
        _import_table(source, target, progress, dialect, name)


def _import_ros(source: Path, target: Path, progress: Progress, dialect: str, name: str) -> None:
    from gcs.importers.ros import import_ros

    import_ros(source, target, progress, name)


def _import_folder(source: Path, target: Path, progress: Progress, name: str, columns: Path | None) -> None:
    from gcs.importers.folder import import_folder

    try:
        import_folder(source, target, progress, name, columns)
    except BaseException:
        target.unlink(missing_ok=True)
        raise


def is_bag(path: Path) -> bool:
    """Whether an MCAP file is a ROS bag and no recording of ours."""
    from gcs.recording.container import Container

    try:
        return _is_ros(Container(path))
    except RecordingError:
        return False  # whoever reads it says what is wrong with it


def _is_ros(opened: Container) -> bool:
    names = [channel.topic for channel in opened.channels.values()]
    return bool(names) and not any(name.startswith("/mavlink/") for name in names)


def _export_tlog(source: Path, target: Path) -> None:
    from gcs.formats.tlog import export_tlog

    export_tlog(source, target)


def _export_csv(source: Path, target: Path) -> None:
    from gcs.formats.tables import export_csv

    export_csv(source, target)


def _export_parquet(source: Path, target: Path) -> None:
    from gcs.formats.tables import export_parquet

    export_parquet(source, target)


def _export_attached(source: Path, target: Path) -> None:
    from gcs.formats.original import export_original

    export_original(source, target)


IMPORTS: dict[str, Callable[[Path, Path, Progress, str, str], None]] = {
    ".mcap": _copy,
    ".tlog": _import_tlog,
    ".bin": _import_dataflash,
    ".ulg": _import_ulog,
    ".csv": _import_table,
    ".tsv": _import_table,
    ".txt": _import_text,
    ".log": _import_dataflash,
    ".parquet": _import_table,
    ".mat": _import_matlab,
    ".npz": _import_table,
    ".db3": _import_ros,
    ".bag": _import_ros,
}
# What a file of columns says something of.
_TABLES = (_import_table, _import_text, _import_matlab)
_WITH_COLUMNS = (*_TABLES, _import_ros, _copy)
EXPORTS: dict[str, Callable[[Path, Path], None]] = {
    ".tlog": _export_tlog,
    ".csv": _export_csv,
    ".parquet": _export_parquet,
    ".bin": _export_attached,
    ".log": _export_attached,
    ".ulg": _export_attached,
}


def check_file(path: Path) -> None:
    """ImportFileError where there is no file of that name, nor a folder of CSV files."""
    if path.is_dir():
        if not any(path.glob("*.csv")):
            raise ImportFileError(
                f"{path} is a folder; name a file in it, or a folder of a log's topics, a .csv of each"
            )
        return
    if not path.is_file():
        raise ImportFileError(f"{path}: there is no such file")


def import_file(
    source: Path,
    target: Path,
    ending: str | None = None,
    progress: Progress = lambda share: None,
    dialect: str = DEFAULT_DIALECT,
    name: str = "",
    columns: Path | None = None,
) -> None:
    """Write the recording `source` as MCAP to `target`, which must not exist. A folder of CSV files is one flight.

    ending: of the original name (".tlog"), where `source` itself has another. dialect: of the frames in a log of raw
    frames. name: by which the file is remembered, where `source` has another. columns: file that says what columns of a
    table are. Raises ImportFileError, RecordingError,
    DialectError; no file is left behind then.
    """
    if source.is_dir():
        check_file(source)
        _check_new(target)
        _import_folder(source, target, progress, name, columns)
        return
    ending = (source.suffix if ending is None else ending).lower()
    if ending not in IMPORTS:
        raise ImportFileError(
            f"{name or source.name}: {ending or 'a file without an ending'} cannot be imported; this version reads "
            + ", ".join(IMPORTS)
        )
    check_file(source)
    if target.exists() and target.samefile(source):
        raise ImportFileError(f"{source} would be written over itself; choose another name for the output")
    _check_new(target)
    if columns is not None and IMPORTS[ending] not in _WITH_COLUMNS:
        raise ImportFileError(f"{name or source.name}: is no table; leave the file of columns out")
    try:
        if columns is not None and IMPORTS[ending] in _TABLES:
            from gcs.importers.dataflash_matlab import is_mission_planner
            from gcs.importers.table import import_table

            if ending == ".mat" and is_mission_planner(source):
                raise ImportFileError(
                    f"{name or source.name}: is a log of ArduPilot, whose labels say what its columns are; leave the"
                    " file of columns out"
                )

            import_table(source, target, progress, name or source.name, columns)
            return
        if columns is not None:
            from gcs.importers.ros import import_ros

            if ending == ".mcap" and not is_bag(source):
                raise ImportFileError(f"{name or source.name}: is a recording; leave the file of columns out")
            import_ros(source, target, progress, name or source.name, columns)
            return
        IMPORTS[ending](source, target, progress, dialect, name or source.name)
    except BaseException:
        target.unlink(missing_ok=True)
        raise


def export_file(source: Path, target: Path) -> None:
    """Write the recording `source` in the format that the ending of `target`, which must not exist, names.

    Raises RecordingError; no file is left behind then.
    """
    ending = target.suffix.lower()
    if ending not in EXPORTS:
        raise RecordingError(
            f"{target.name}: {ending or 'no ending'} cannot be exported; this version writes {', '.join(EXPORTS)}"
        )
    _check_new(target)
    try:
        EXPORTS[ending](source, target)
    except BaseException:
        target.unlink(missing_ok=True)
        raise


def _check_new(target: Path) -> None:
    if target.exists():
        raise RecordingError(f"{target} exists already; choose another name, or remove it first")
