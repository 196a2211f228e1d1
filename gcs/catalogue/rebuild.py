"""A damaged catalogue made anew: from its newest backup, what can still be read of it, and the recordings."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from gcs.catalogue.backup import backups_in
from gcs.catalogue.intake import recover
from gcs.catalogue.store import Catalogue
from gcs.settings import Settings

# In the order in which one refers to another.
_TABLES = ("flights", "jobs", "job_log", "results", "models", "flight_notes")


def rebuild(settings: Settings) -> Iterator[str]:
    """Make the catalogue of a data folder whole, and say what is done, a line at a time.

    Nobody else may use the folder meanwhile. What is damaged is put aside, never deleted. Raises CatalogueError,
    CatalogueFileError, OSError.
    """
    aside, fault = None, _fault(settings.database) if settings.database.exists() else "it is gone"
    if not fault:
        yield "the catalogue is whole"
    else:
        if settings.database.exists():
            aside = _put_aside(settings)
            yield f"the catalogue is damaged ({fault}); it is kept in {aside}"
        else:
            yield "there is no catalogue; it is made anew"
        whole = next((backup for backup in backups_in(settings.backups) if not _fault(backup)), None)
        if whole is not None:
            shutil.copyfile(whole, settings.database)
            yield f"the backup {whole.name} takes its place"
    with contextlib.closing(Catalogue(settings.database)) as catalogue:
        if aside is not None:
            taken = _salvage(aside / settings.database.name, settings.database)
            yield f"still readable in the damaged one, and taken over: {taken} rows"
        if fault:
            catalogue.keep_discarded()  # a deletion that was taken back since the backup must not be carried out
        # As uploads, which no rule deletes: what they were, nobody knows any more.
        listed = [replace(flight, source="upload") for flight in recover(settings, catalogue)]
        for flight in listed:
            catalogue.put_flight(flight)
        yield f"recordings that it did not know: {len(listed)}"
        for flight in listed:
            yield f"  {flight.id}: {flight.messages} messages; {flight.end_reason}"


def _fault(path: Path) -> str:
    """What is wrong with an SQLite file, empty if nothing is."""
    try:
        with contextlib.closing(sqlite3.connect(path)) as db:
            (found,) = db.execute("PRAGMA quick_check(1)").fetchone()
            if found != "ok":
                return str(found).splitlines()[-1]
            tables = db.execute("SELECT count(*) FROM sqlite_master WHERE name = 'flights'").fetchone()
            return "" if tables[0] else "it is empty"
    except sqlite3.Error as error:
        return str(error)


def _put_aside(settings: Settings) -> Path:
    """Move the catalogue's files into a folder of their own."""
    aside = settings.data / f"damaged-{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}"
    aside.mkdir()
    for ending in ("", "-wal", "-shm"):
        path = settings.database.with_name(settings.database.name + ending)
        if path.exists():
            os.replace(path, aside / path.name)
    return aside


def _salvage(damaged: Path, target: Path) -> int:
    """Copy what can be read of a damaged file: rows that the other one has not, and how flights and jobs stood last."""
    taken = 0
    with contextlib.closing(sqlite3.connect(damaged)) as source, contextlib.closing(sqlite3.connect(target)) as into:
        for table in _TABLES:
            known = {row[1] for row in into.execute(f"PRAGMA table_info({table})")}
            for order in ("ASC", "DESC"):  # from both ends up to where it is damaged
                with contextlib.suppress(sqlite3.Error):
                    rows = source.execute(f"SELECT * FROM {table} ORDER BY rowid {order}")
                    columns = [column[0] for column in rows.description]
                    at = [i for i, name in enumerate(columns) if name in known]
                    names, marks = ", ".join(columns[i] for i in at), ", ".join("?" for _ in at)
                    newer = "REPLACE" if table in ("flights", "jobs", "flight_notes") else "IGNORE"
                    add = f"INSERT OR {newer} INTO {table} ({names}) VALUES ({marks})"
                    for row in rows:
                        with contextlib.suppress(sqlite3.IntegrityError):
                            taken += into.execute(add, tuple(row[i] for i in at)).rowcount
        into.commit()
    return taken
