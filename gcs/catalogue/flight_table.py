"""Flights in the catalogue."""

from __future__ import annotations

import json
import sqlite3
from dataclasses import asdict, dataclass
from pathlib import Path

from gcs.catalogue.aircraft_rule import OF_AIRCRAFT, of_aircraft
from gcs.catalogue.note_table import NoteTable
from gcs.errors import CatalogueError, RecordingDeletedError
from gcs.recording.parts import part_path
from gcs.text.utctext import utc_text

_SAID = (
    "(SELECT title || ' ' || comment || ' ' || tags || ' ' || vehicle FROM flight_notes WHERE flight_id = flights.id)"
)
_SEARCHED = (
    "id || ' ' || name || ' ' || strftime('%Y-%m-%d %H:%M:%S', start_ns / 1000000000, 'unixepoch')"
    f" || ' ' || ifnull({_SAID}, '')"
)
_OF_VEHICLE = (
    "(id IN (SELECT flight_id FROM flight_notes WHERE vehicle = ?)"
    f" OR id IN (SELECT flight_id FROM jobs j WHERE json_valid(request) AND {OF_AIRCRAFT}))"
)
# Those whose recordings are there.
_KEPT = "deleted_ns IS NULL AND discarded_ns IS NULL"
# How long a flight that somebody deleted can be taken back.
UNDO_NS = 86_400_000_000_000
# A job that was running when the service stopped is tried once more; one that stops it twice is not.


@dataclass(frozen=True)
class Flight:
    """One flight and its recording.

    file: name of the MCAP in the folder of flights; `parts`: how many files there are if it was split by size.
    name: what the user called the file, or its own name. source: "live" or "upload".
    state: "recording", "complete", or "recovered" after a crash.
    deleted_ns: when the recording was deleted to make room (UTC, ns), None while it is there.
    vehicle_s: how long it was by the vehicle's clock, None where that is not known.
    discarded_ns: when somebody deleted the flight (UTC, ns), which can be taken back for a while; None else.
    follows: the flight behind which this was recorded on the ground, None for a flight, "" where nobody who is believed
    was heard. settled: 1 where somebody has deleted an identification of it, and the station makes none by itself.
    board: a hash of the autopilot board's own number, None where it did not say it.
    """

    id: str
    file: str
    name: str
    source: str
    state: str
    system: int | None
    start_ns: int
    end_ns: int
    messages: int
    bytes: int
    end_reason: str = ""
    parts: int = 1
    deleted_ns: int | None = None
    vehicle_s: float | None = None
    discarded_ns: int | None = None
    follows: str | None = None
    settled: int = 0
    board: str | None = None

    def files(self, folder: Path) -> list[Path]:
        """All files of the recording, in order."""
        return [part_path(folder / self.file, number) for number in range(1, self.parts + 1)]

    def kept_files(self, folder: Path) -> list[Path]:
        """The files that are there. RecordingDeletedError if they were deleted to make room, CatalogueError if gone."""
        if self.deleted_ns is not None:
            raise RecordingDeletedError(
                f"the recording of flight {self.id} was deleted on {utc_text(self.deleted_ns)} to make room;"
                " its results and models are kept"
            )
        paths = [path for path in self.files(folder) if path.is_file()]
        linked = [path.name for path in paths if path.is_symlink()]
        if linked:
            raise CatalogueError(
                f"{linked[0]} in the data folder is a symbolic link, which is not followed: put the file itself there"
            )
        if not paths:
            raise CatalogueError(f"the recording of flight {self.id} is gone from the data folder")
        return paths


def _insert(db: sqlite3.Connection, otherwise: str, flight: Flight) -> sqlite3.Cursor:
    columns = asdict(flight)
    marks = ", ".join("?" for _ in columns)
    into = f"INSERT OR {otherwise} INTO flights ({', '.join(columns)}) VALUES ({marks})"
    return db.execute(into, tuple(columns.values()))


def _is_needed(db: sqlite3.Connection, flight_id: str) -> bool:
    """Whether a job that waits or runs reads the flight."""
    waiting = db.execute("SELECT flight_id, request FROM jobs WHERE state IN ('queued', 'running')")
    return any(
        flight_id == row["flight_id"] or flight_id in json.loads(row["request"]).get("validate", ()) for row in waiting
    )


class FlightTable(NoteTable):
    """What is known of flights."""

    def put_flight(self, flight: Flight) -> None:
        """Add a flight, or replace what is known of it."""
        with self._transaction() as db:
            _insert(db, "REPLACE", flight)

    def add_flight(self, flight: Flight) -> bool:
        """Add a flight unless its id is taken, in which case nothing is changed; whether it was added."""
        with self._transaction() as db:
            return _insert(db, "IGNORE", flight).rowcount > 0

    def remove_flight(self, flight_id: str) -> None:
        """Forget a flight of which nothing was recorded."""
        with self._transaction() as db:
            db.execute("DELETE FROM flights WHERE id = ?", (flight_id,))

    def flight(self, flight_id: str) -> Flight:
        """The flight of that id; CatalogueError if there is none, or if it was deleted."""
        flight = self._known(flight_id)
        if flight.discarded_ns is not None:
            until = utc_text(flight.discarded_ns + UNDO_NS)
            raise CatalogueError(
                f"flight {flight_id} was deleted; POST /api/flights/{flight_id}/restore takes that back until {until}"
            )
        return flight

    def _known(self, flight_id: str) -> Flight:
        rows = self._rows("SELECT * FROM flights WHERE id = ?", flight_id)
        if not rows:
            raise CatalogueError(f"there is no flight {flight_id!r}; GET /api/flights lists them")
        return Flight(**rows[0])

    def has_flight(self, flight_id: str) -> bool:
        """Whether the id is taken."""
        return bool(self._rows("SELECT 1 FROM flights WHERE id = ?", flight_id))

    def flights(
        self,
        limit: int = 50,
        after: str | None = None,
        search: str = "",
        *,
        since_ns: int | None = None,
        until_ns: int | None = None,
        vehicle: str = "",
        discarded: bool = False,
        ground: bool = False,
    ) -> list[Flight]:
        """Newest first, after the one named.

        search: words in id, name, start (as `2026-11-23 06:10`, UTC), or in what people said of it, its aircraft too.
        since_ns, until_ns: those that began then or later, and before. vehicle: those of an aircraft, by its id: chosen
        by hand, or named in a job.

        discarded: those that were deleted, which can be taken back, instead of those that are there. ground: what was
        recorded on the ground behind flights too.
        """
        conditions, values = [f"discarded_ns IS {'NOT ' * discarded}NULL"], list[object]()
        if discarded:  # ground data that was deleted by itself too
            conditions.append("ifnull(follows, '') NOT IN (SELECT id FROM flights WHERE discarded_ns IS NOT NULL)")
        elif not ground:
            conditions.append("follows IS NULL")
        if after is not None:
            last = self._known(after)
            conditions.append("(start_ns, id) < (?, ?)")
            values += [last.start_ns, last.id]
        if since_ns is not None:
            conditions.append("start_ns >= ?")
            values.append(since_ns)
        if until_ns is not None:
            conditions.append("start_ns < ?")
            values.append(until_ns)
        if vehicle:
            conditions.append(_OF_VEHICLE)
            values += [vehicle, *of_aircraft(vehicle)]
        for word in search.split():
            conditions.append(f"instr(lower({_SEARCHED}), lower(?))")  # both by SQLite, which leaves Ü as it is
            values.append(word)
        query = f"SELECT * FROM flights WHERE {' AND '.join(conditions)} ORDER BY start_ns DESC, id DESC LIMIT ?"
        return [Flight(**row) for row in self._rows(query, *values, limit)]

    def same_flight(self, flight: Flight) -> str | None:
        """The first other flight with as many messages between the same instants whose recording is kept."""
        same = f"(start_ns, end_ns, messages) = (?, ?, ?) AND id != ? AND {_KEPT}"
        values = (flight.start_ns, flight.end_ns, flight.messages, flight.id)
        rows = self._rows(f"SELECT id FROM flights WHERE {same} ORDER BY rowid", *values)
        return str(rows[0]["id"]) if rows else None

    def kept_flights(self) -> list[Flight]:
        """Flights whose recordings have not been deleted, oldest first."""
        rows = self._rows(f"SELECT * FROM flights WHERE {_KEPT} ORDER BY start_ns, id")
        return [Flight(**row) for row in rows]

    def deleted_flights(self) -> list[Flight]:
        """Flights whose recordings were deleted to make room."""
        return [Flight(**row) for row in self._rows("SELECT * FROM flights WHERE deleted_ns IS NOT NULL")]

    def identified_flights(self) -> set[str]:
        """Ids of the flights with an identification that is done, or was skipped for want of anything airborne."""
        rows = self._rows(
            "SELECT flight_id FROM jobs WHERE kind = 'identify' AND state IN ('done', 'skipped')"
            " UNION SELECT id FROM flights WHERE settled"
        )
        return {row["flight_id"] for row in rows}

    def unidentified_flights(self) -> list[Flight]:
        """Flights of vehicles, recorded here to their end and kept, for which no identification was ever queued."""
        asked = "SELECT flight_id FROM jobs WHERE kind = 'identify'"
        rows = self._rows(
            f"SELECT * FROM flights WHERE source = 'live' AND state != 'recording' AND system IS NOT NULL AND {_KEPT}"
            f" AND follows IS NULL AND NOT settled AND id NOT IN ({asked}) ORDER BY start_ns, id"
        )
        return [Flight(**row) for row in rows]

    def mark_deleted(self, flight_id: str) -> bool:
        """Note that the recording is being deleted; False, and nothing noted, while a job needs it."""
        with self._transaction() as db:
            if _is_needed(db, flight_id):
                return False
            db.execute("UPDATE flights SET deleted_ns = ? WHERE id = ?", (self._clock(), flight_id))
        return True

    def ground_after(self, flight_id: str) -> list[Flight]:
        """What was recorded on the ground behind a flight, oldest first."""
        rows = self._rows(f"SELECT * FROM flights WHERE follows = ? AND {_KEPT} ORDER BY start_ns, id", flight_id)
        return [Flight(**row) for row in rows]

    def discard_flight(self, flight_id: str) -> bool:
        """Delete a flight, which can be taken back for a day; False, and nothing is done, while a job needs it."""
        with self._transaction() as db:
            behind = db.execute("SELECT id FROM flights WHERE follows = ?", (flight_id,)).fetchall()
            if any(_is_needed(db, one) for one in (flight_id, *(row["id"] for row in behind))):
                return False
            behind_it = "follows = ? AND state != 'recording' AND discarded_ns IS NULL"
            both = f"UPDATE flights SET discarded_ns = ? WHERE id = ? OR ({behind_it})"
            db.execute(both, (self._clock(), flight_id, flight_id))
        return True

    def restore_flight(self, flight_id: str) -> Flight:
        """Take the deletion of a flight back. CatalogueError if there is none of that id any more."""
        known = self._known(flight_id)
        with self._transaction() as db:
            both = "UPDATE flights SET discarded_ns = NULL WHERE discarded_ns = ? AND (id = ? OR follows = ?)"
            db.execute(both, (known.discarded_ns, flight_id, flight_id))
        return self.flight(flight_id)

    def flights_to_erase(self) -> list[Flight]:
        """Flights that were deleted longer ago than it can be taken back."""
        before = self._clock() - UNDO_NS
        return [Flight(**row) for row in self._rows("SELECT * FROM flights WHERE discarded_ns <= ?", before)]

    def keep_discarded(self) -> None:
        """Have every deletion count from now on."""
        with self._transaction() as db:
            db.execute("UPDATE flights SET discarded_ns = ? WHERE discarded_ns IS NOT NULL", (self._clock(),))

    def erase_flight(self, flight_id: str) -> bool:
        """Forget a flight for good, with its jobs, results and models; False where it was restored meanwhile."""
        before = self._clock() - UNDO_NS
        with self._transaction() as db:
            due = db.execute("SELECT 1 FROM flights WHERE id = ? AND discarded_ns <= ?", (flight_id, before))
            if due.fetchone() is None:
                return False
            db.execute("DELETE FROM job_log WHERE job_id IN (SELECT id FROM jobs WHERE flight_id = ?)", (flight_id,))
            for table in ("jobs", "results", "models", "flight_notes", "flight_outlines"):
                db.execute(f"DELETE FROM {table} WHERE flight_id = ?", (flight_id,))
            db.execute("DELETE FROM flights WHERE id = ?", (flight_id,))
            db.execute("UPDATE flights SET follows = NULL WHERE follows = ?", (flight_id,))
        return True

    def unfinished_flights(self) -> list[Flight]:
        """Flights that were being recorded when the service stopped without ending them."""
        return [Flight(**row) for row in self._rows("SELECT * FROM flights WHERE state = 'recording'")]
