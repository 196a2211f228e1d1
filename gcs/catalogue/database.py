"""The catalogue's file: opened once, used by many threads, whole after a crash at any moment."""

from __future__ import annotations

import contextlib
import os
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from gcs.catalogue.schema import prepare
from gcs.errors import CatalogueError, CatalogueFileError


class Database:
    """Thread-safe access to the file. `clock` gives UTC in ns."""

    def __init__(self, path: Path, clock: Callable[[], int] = time.time_ns) -> None:
        self._path, self._clock = path, clock
        self._lock = threading.RLock()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(path, check_same_thread=False, isolation_level=None)
            self._db.row_factory = sqlite3.Row
            self._db.execute("PRAGMA journal_mode = WAL")
            self._db.execute("PRAGMA synchronous = NORMAL")
            prepare(self._db)
        except sqlite3.DatabaseError as error:
            raise CatalogueError(
                f"{path}: the catalogue cannot be opened ({error}); if it is damaged, stop the service and run"
                f" `gcs repair {path.parent}`: it makes the catalogue anew from the newest backup and the recordings"
            ) from error
        except OSError as error:
            raise CatalogueError(f"{path}: the catalogue cannot be opened ({error})") from error

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._db.close()

    @property
    def size_bytes(self) -> int:
        """What the file takes on the disk."""
        (pages,), (page,) = self._rows("PRAGMA page_count")[0], self._rows("PRAGMA page_size")[0]
        return int(pages * page)

    def check(self) -> None:
        """Read a page of the file. Raises CatalogueFileError."""
        self._rows("PRAGMA schema_version")

    def back_up(self, target: Path) -> None:
        """Write a copy as it stands now; whoever uses the catalogue does not wait. Raises CatalogueFileError."""
        unfinished = target.with_name(f"{target.name}.unfinished")
        with _named_failures():
            # By a connection of its own, which sees no half of a change.
            try:
                with (
                    contextlib.closing(sqlite3.connect(self._path)) as source,
                    contextlib.closing(sqlite3.connect(unfinished)) as copy,
                ):
                    source.backup(copy)  # at once: step by step it begins again with every change
                os.replace(unfinished, target)
            finally:
                unfinished.unlink(missing_ok=True)

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        with self._lock, _named_failures():
            self._db.execute("BEGIN IMMEDIATE")
            try:
                yield self._db
                self._db.execute("COMMIT")
            except BaseException:
                if self._db.in_transaction:  # a full disk has ended it already
                    self._db.execute("ROLLBACK")
                raise

    def _rows(self, query: str, *values: object) -> list[sqlite3.Row]:
        with self._lock, _named_failures():
            return self._db.execute(query, values).fetchall()


@contextmanager
def _named_failures() -> Iterator[None]:
    """A disk that is full or broken is an error with a name, not one of the database's."""
    try:
        yield
    except sqlite3.Error as error:
        raise CatalogueFileError(
            f"the catalogue cannot be read or written ({error}); is the disk full? If catalogue.sqlite is damaged, stop"
            " the service and run `gcs repair DATA`: it makes it anew from the newest backup and the recordings"
        ) from error
