"""The catalogue's file: opened once, used by many threads, whole after a crash at any moment."""

from __future__ import annotations

import logging
import os
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from gcs.catalogue.schema import prepare
from gcs.errors import CatalogueBusyError, CatalogueError, CatalogueFileError

_log = logging.getLogger(__name__)


# How long whoever asks waits for others who write, s: the station's own threads, and requests, which hold a thread
# that others need.
PATIENT_S, HASTY_S = 5.0, 0.5
# Connections for reading that are kept for the next who reads.
_IDLE = 8
_DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
#: How long the one who asks now waits, s.
PATIENCE: ContextVar[float] = ContextVar("catalogue_patience", default=PATIENT_S)


class Database:
    """Thread-safe access to the file. `clock` gives UTC in ns. Who reads waits for nobody who writes."""

    def __init__(self, path: Path, clock: Callable[[], int] = time.time_ns) -> None:
        self._path, self._clock = path, clock
        self._lock = threading.RLock()
        self._writing: int | None = None
        self._damage = ""
        self._busy = False
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
        self._readers = _Readers(path)

    def close(self) -> None:
        """Close the file."""
        self._readers.close()
        with self._lock:
            self._db.close()

    @property
    def size_bytes(self) -> int:
        """What the file takes on the disk."""
        (pages,), (page,) = self._rows("PRAGMA page_count")[0], self._rows("PRAGMA page_size")[0]
        return int(pages * page)

    @property
    def problem(self) -> str:
        """What is wrong with the file, in words: damage that was met since the start, or who else writes it now.

        It waits for nobody.
        """
        if self._damage or not self._lock.acquire(blocking=False):
            return self._damage or (_BUSY if self._busy else "")
        try:
            self._db.execute("PRAGMA busy_timeout = 0")
            self._db.execute("BEGIN IMMEDIATE")
            self._db.execute("ROLLBACK")
            self._busy = False
        except sqlite3.Error as error:
            self._busy = _code(error) == sqlite3.SQLITE_BUSY
            return _BUSY if self._busy else f"the catalogue cannot be written ({error})"
        finally:
            self._lock.release()
        return ""

    def examine(self) -> None:
        """Look through the whole file for damage, which `problem` says from then on; it takes as long as to read it."""
        with suppress(CatalogueFileError), self._named_failures(), self._readers.one() as db:
            (found,) = db.execute("PRAGMA quick_check(1)").fetchone()
            if found != "ok":
                self._note_damage(str(found).splitlines()[-1])

    def back_up(self, target: Path) -> None:
        """Write a copy as it stands now; whoever uses the catalogue does not wait. Raises CatalogueFileError."""
        unfinished = target.with_name(f"{target.name}.unfinished")
        with self._named_failures():
            # By a connection of its own, which sees no half of a change.
            try:
                with (
                    closing(sqlite3.connect(self._path)) as source,
                    closing(sqlite3.connect(unfinished)) as copy,
                ):
                    source.backup(copy)  # at once: step by step it begins again with every change
                os.replace(unfinished, target)
            finally:
                unfinished.unlink(missing_ok=True)

    @contextmanager
    def _alone(self) -> Iterator[float]:
        """Hold off all other threads that write; until when whoever asks has patience. CatalogueBusyError beyond."""
        until = time.monotonic() + PATIENCE.get()
        if not self._lock.acquire(timeout=PATIENCE.get()):
            self._busy = True
            raise CatalogueBusyError(_BUSY)
        try:
            yield until
        finally:
            self._lock.release()

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        with self._alone() as until, self._named_failures():
            left_ms = max(1, round(1000.0 * (until - time.monotonic())))
            self._db.execute(f"PRAGMA busy_timeout = {left_ms}")
            self._db.execute("BEGIN IMMEDIATE")
            self._writing, self._busy = threading.get_ident(), False
            try:
                yield self._db
                self._db.execute("COMMIT")
            except BaseException:
                if self._db.in_transaction:  # a full disk has ended it already
                    self._db.execute("ROLLBACK")
                raise
            finally:
                self._writing = None

    def _rows(self, query: str, *values: object) -> list[sqlite3.Row]:
        with self._named_failures():
            if self._writing == threading.get_ident():  # of what it has written itself
                return self._db.execute(query, values).fetchall()
            with self._readers.one() as db:
                return db.execute(query, values).fetchall()

    def _note_damage(self, what: str) -> None:
        if not self._damage:
            self._damage = (
                f"the catalogue is damaged ({what}), and flights go on being recorded: stop the service and run `gcs"
                " repair DATA`, which makes it anew from the newest backup and the recordings"
            )
            _log.error("%s", self._damage)

    @contextmanager
    def _named_failures(self) -> Iterator[None]:
        """A disk that is full or broken is an error with a name, not one of the database's."""
        try:
            yield
        except sqlite3.Error as error:
            if _code(error) in _DAMAGED:
                self._note_damage(str(error))
            if _code(error) == sqlite3.SQLITE_BUSY:
                self._busy = True
                raise CatalogueBusyError(_BUSY) from error
            raise CatalogueFileError(
                f"the catalogue cannot be read or written ({error}); is the disk full? If catalogue.sqlite is damaged,"
                " stop the service and run `gcs repair DATA`: it makes it anew from the newest backup and the"
                " recordings"
            ) from error


_BUSY = "the catalogue cannot be written: another program holds catalogue.sqlite (database is locked); end it"


class _Readers:
    """Connections that only read, each used by one thread at a time."""

    def __init__(self, path: Path) -> None:
        self._uri = f"{path.resolve().as_uri()}?mode=ro"
        self._lock, self._idle = threading.Lock(), list[sqlite3.Connection]()
        self._used, self._closed = set[sqlite3.Connection](), False

    @contextmanager
    def one(self) -> Iterator[sqlite3.Connection]:
        """A connection, for as long as the context lasts. Raises sqlite3.Error."""
        with self._lock:
            if self._closed:
                raise sqlite3.ProgrammingError("it is closed")
            db = self._idle.pop() if self._idle else None
        db = db or self._opened()
        with self._lock:
            self._used.add(db)
        try:
            yield db
        finally:
            with self._lock:
                self._used.discard(db)
                kept = not self._closed and len(self._idle) < _IDLE
                if kept:
                    self._idle.append(db)
            if not kept:
                db.close()

    def refresh(self) -> None:
        """Have whoever reads next read from the disk, not from what a connection remembers of it."""
        with self._lock:
            idle, self._idle = self._idle, []
        for db in idle:
            db.close()

    def close(self) -> None:
        """End all; what is being read breaks off."""
        with self._lock:
            self._closed = True
            for db in self._used:
                db.interrupt()
        self.refresh()

    def _opened(self) -> sqlite3.Connection:
        db = sqlite3.connect(self._uri, timeout=HASTY_S, check_same_thread=False, isolation_level=None, uri=True)
        db.row_factory = sqlite3.Row
        return db


def _code(error: sqlite3.Error) -> int:
    """The error of SQLite, without what it adds in detail."""
    return int(getattr(error, "sqlite_errorcode", 0)) & 0xFF
