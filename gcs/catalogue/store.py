"""The catalogue: flights, jobs, results and models in one SQLite file that survives a crash at any moment."""

from __future__ import annotations

import json
import secrets
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from gcs.catalogue.schema import prepare
from gcs.errors import CatalogueError, CatalogueFileError, RecordingDeletedError
from gcs.recording.parts import part_path
from gcs.text.jsontext import dumps
from gcs.text.utctext import utc_text

# What a search for flights looks at: an upload's name, and the instant as its user knows it.
_SEARCHED = "id || ' ' || name || ' ' || strftime('%Y-%m-%d %H:%M:%S', start_ns / 1000000000, 'unixepoch')"
# A job that was running when the service stopped is tried once more; one that stops it twice is not.
_MAX_ATTEMPTS = 2
_MAX_LOG_LINES = 1000


@dataclass(frozen=True)
class Flight:
    """One flight and its recording.

    file: name of the MCAP in the folder of flights; `parts`: how many files there are if it was split by size.
    name: what the user called the file, or its own name. source: "live" or "upload".
    state: "recording", "complete", or "recovered" after a crash.
    deleted_ns: when the recording was deleted to make room (UTC, ns), None while it is there.
    vehicle_s: how long it was by the vehicle's clock, None where that is not known.
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
        if not paths:
            raise CatalogueError(f"the recording of flight {self.id} is gone from the data folder")
        return paths


@dataclass(frozen=True)
class Job:
    """One estimation. state: queued, running, done, failed or skipped; progress 0..1; error in words if it failed."""

    id: str
    flight_id: str
    kind: str
    request: dict[str, Any]
    state: str
    progress: float
    error: str | None
    attempts: int
    created_ns: int
    started_ns: int | None
    ended_ns: int | None
    log: list[str] = field(default_factory=list)

    def to_json(self) -> dict[str, Any]:
        """The job as the REST interface gives it."""
        return asdict(self)


def _insert(db: sqlite3.Connection, otherwise: str, flight: Flight) -> sqlite3.Cursor:
    columns = asdict(flight)
    marks = ", ".join("?" for _ in columns)
    into = f"INSERT OR {otherwise} INTO flights ({', '.join(columns)}) VALUES ({marks})"
    return db.execute(into, tuple(columns.values()))


class Catalogue:
    """Thread-safe access to the catalogue's file. `clock` gives UTC in ns."""

    def __init__(self, path: Path, clock: Callable[[], int] = time.time_ns) -> None:
        self._clock = clock
        self._lock = threading.RLock()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._db = sqlite3.connect(path, check_same_thread=False, isolation_level=None)
            self._db.row_factory = sqlite3.Row
            self._db.execute("PRAGMA journal_mode = WAL")
            self._db.execute("PRAGMA synchronous = NORMAL")
            prepare(self._db)
        except (sqlite3.Error, OSError) as error:
            raise CatalogueError(f"{path}: the catalogue cannot be opened ({error})") from error

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._db.close()

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

    # flights

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
        """The flight of that id; CatalogueError if there is none."""
        rows = self._rows("SELECT * FROM flights WHERE id = ?", flight_id)
        if not rows:
            raise CatalogueError(f"there is no flight {flight_id!r}; GET /api/flights lists them")
        return Flight(**rows[0])

    def has_flight(self, flight_id: str) -> bool:
        """Whether the id is taken."""
        return bool(self._rows("SELECT 1 FROM flights WHERE id = ?", flight_id))

    def flights(self, limit: int = 50, after: str | None = None, search: str = "") -> list[Flight]:
        """Newest first, after the one named. search: words in id, name or start, as `2026-11-23 06:10`, UTC."""
        conditions, values = [], list[object]()
        if after is not None:
            last = self.flight(after)
            conditions.append("(start_ns, id) < (?, ?)")
            values += [last.start_ns, last.id]
        for word in search.split():
            conditions.append(f"instr(lower({_SEARCHED}), lower(?))")  # both by SQLite, which leaves Ü as it is
            values.append(word)
        where = f"WHERE {' AND '.join(conditions)}" if conditions else ""
        query = f"SELECT * FROM flights {where} ORDER BY start_ns DESC, id DESC LIMIT ?"
        return [Flight(**row) for row in self._rows(query, *values, limit)]

    def same_flight(self, flight: Flight) -> str | None:
        """The first other flight with as many messages between the same instants whose recording is kept."""
        same = "(start_ns, end_ns, messages) = (?, ?, ?) AND id != ? AND deleted_ns IS NULL ORDER BY rowid"
        values = (flight.start_ns, flight.end_ns, flight.messages, flight.id)
        rows = self._rows(f"SELECT id FROM flights WHERE {same}", *values)
        return str(rows[0]["id"]) if rows else None

    def kept_flights(self) -> list[Flight]:
        """Flights whose recordings have not been deleted, oldest first."""
        return [
            Flight(**row) for row in self._rows("SELECT * FROM flights WHERE deleted_ns IS NULL ORDER BY start_ns, id")
        ]

    def deleted_flights(self) -> list[Flight]:
        """Flights whose recordings were deleted to make room."""
        return [Flight(**row) for row in self._rows("SELECT * FROM flights WHERE deleted_ns IS NOT NULL")]

    def identified_flights(self) -> set[str]:
        """Ids of the flights with an identification that is done, or was skipped for want of anything airborne."""
        rows = self._rows(
            "SELECT DISTINCT flight_id FROM jobs WHERE kind = 'identify' AND state IN ('done', 'skipped')"
        )
        return {row["flight_id"] for row in rows}

    def unidentified_flights(self) -> list[Flight]:
        """Flights of vehicles, recorded here to their end and kept, for which no identification was ever queued."""
        rows = self._rows(
            "SELECT * FROM flights WHERE source = 'live' AND state != 'recording' AND system IS NOT NULL AND deleted_ns"
            " IS NULL AND id NOT IN (SELECT flight_id FROM jobs WHERE kind = 'identify') ORDER BY start_ns, id"
        )
        return [Flight(**row) for row in rows]

    def mark_deleted(self, flight_id: str) -> bool:
        """Note that the recording is being deleted; False, and nothing noted, while a job needs it."""
        with self._transaction() as db:
            for row in db.execute("SELECT flight_id, request FROM jobs WHERE state IN ('queued', 'running')"):
                if flight_id == row["flight_id"] or flight_id in json.loads(row["request"]).get("validate", ()):
                    return False
            db.execute("UPDATE flights SET deleted_ns = ? WHERE id = ?", (self._clock(), flight_id))
        return True

    def unfinished_flights(self) -> list[Flight]:
        """Flights that were being recorded when the service stopped without ending them."""
        return [Flight(**row) for row in self._rows("SELECT * FROM flights WHERE state = 'recording'")]

    # jobs

    def add_job(self, flight_id: str, kind: str, request: dict[str, Any]) -> Job:
        """Queue a job."""
        job_id = secrets.token_hex(6)
        with self._transaction() as db:
            db.execute(
                "INSERT INTO jobs (id, flight_id, kind, request, state, progress, attempts, created_ns)"
                " VALUES (?, ?, ?, ?, 'queued', 0, 0, ?)",
                (job_id, flight_id, kind, dumps(request), self._clock()),
            )
        return self.job(job_id)

    def job(self, job_id: str) -> Job:
        """The job of that id with its log; CatalogueError if there is none."""
        rows = self._rows("SELECT * FROM jobs WHERE id = ?", job_id)
        if not rows:
            raise CatalogueError(f"there is no job {job_id!r}")
        lines = self._rows("SELECT line FROM job_log WHERE job_id = ? ORDER BY number", job_id)
        return _job(rows[0], [row["line"] for row in lines])

    def jobs_of(self, flight_id: str) -> list[Job]:
        """Jobs of a flight, newest first, without their logs."""
        rows = self._rows("SELECT * FROM jobs WHERE flight_id = ? ORDER BY number DESC", flight_id)
        return [_job(row, []) for row in rows]

    def take_job(self) -> Job | None:
        """Turn the oldest queued job into a running one."""
        with self._transaction() as db:
            row = db.execute("SELECT id FROM jobs WHERE state = 'queued' ORDER BY number LIMIT 1").fetchone()
            if row is None:
                return None
            db.execute(
                "UPDATE jobs SET state = 'running', progress = 0, started_ns = ?, attempts = attempts + 1 WHERE id = ?",
                (self._clock(), row["id"]),
            )
        return self.job(row["id"])

    def report_progress(self, job_id: str, progress: float, line: str = "") -> None:
        """Progress (0..1, never backwards) and a line for the log, of which the last 1000 are kept."""
        with self._transaction() as db:
            db.execute(
                "UPDATE jobs SET progress = max(progress, ?) WHERE id = ?",
                (min(max(progress, 0.0), 1.0), job_id),
            )
            if line:
                db.execute(
                    "INSERT INTO job_log (job_id, at_ns, line) VALUES (?, ?, ?)",
                    (job_id, self._clock(), line),
                )
                db.execute(
                    "DELETE FROM job_log WHERE job_id = ? AND number <= (SELECT max(number) FROM job_log) - ?",
                    (job_id, _MAX_LOG_LINES),
                )

    def finish_job(self, job: Job, result: dict[str, Any]) -> None:
        """Store a result and its model, and mark the job done, all or nothing."""
        now = self._clock()
        model = result.get("model")
        with self._transaction() as db:
            db.execute(
                "INSERT INTO results (flight_id, kind, job_id, created_ns, json) VALUES (?, ?, ?, ?, ?)",
                (job.flight_id, job.kind, job.id, now, dumps(result)),
            )
            if isinstance(model, dict):
                found = [str(effect["name"]) for effect in result.get("effects", ())]
                db.execute(
                    "INSERT OR REPLACE INTO models (id, flight_id, kind, job_id, name, created_ns, json, verdict,"
                    " found) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
                    (job.id, job.flight_id, job.kind, job.id, str(model.get("name", "")), now, dumps(model),
                     result.get("verdict"), dumps(found)),
                )  # fmt: skip
            db.execute("UPDATE jobs SET state = 'done', progress = 1, ended_ns = ? WHERE id = ?", (now, job.id))

    def fail_job(self, job_id: str, error: str) -> None:
        """Mark a job failed, with the reason in words."""
        with self._transaction() as db:
            db.execute(
                "UPDATE jobs SET state = 'failed', error = ?, ended_ns = ? WHERE id = ?",
                (error, self._clock(), job_id),
            )

    def skip_job(self, job_id: str, reason: str) -> None:
        """Mark a job as having nothing to work on; its log says why."""
        self.report_progress(job_id, 1.0, reason)
        with self._transaction() as db:
            db.execute("UPDATE jobs SET state = 'skipped', ended_ns = ? WHERE id = ?", (self._clock(), job_id))

    def requeue_interrupted_jobs(self) -> None:
        """What ran when the service stopped is queued again, or failed if that has happened to it before."""
        for row in self._rows("SELECT id, attempts FROM jobs WHERE state = 'running'"):
            if row["attempts"] >= _MAX_ATTEMPTS:
                self.fail_job(row["id"], "the service stopped twice while this job was running; start it anew")
                continue
            with self._transaction() as db:
                db.execute("UPDATE jobs SET state = 'queued', progress = 0 WHERE id = ?", (row["id"],))
            self.report_progress(row["id"], 0.0, "the service was stopped while this job ran; queued again")

    # results and models

    def result(self, flight_id: str, kind: str, job_id: str | None = None) -> dict[str, Any]:
        """Newest result of a kind ("identify" or "discrepancy"), or one job's; CatalogueError if none."""
        return self.job_and_result(flight_id, kind, job_id)[1]

    def job_and_result(self, flight_id: str, kind: str, job_id: str | None = None) -> tuple[str, dict[str, Any]]:
        """The same with the id of the job that made it."""
        query = "SELECT job_id, json FROM results WHERE flight_id = ? AND kind = ? AND job_id = ifnull(?, job_id)"
        rows = self._rows(f"{query} ORDER BY number DESC LIMIT 1", flight_id, kind, job_id)
        if not rows and job_id is not None:
            raise CatalogueError(f"flight {flight_id} has no {kind} result of job {job_id!r}; the newest needs no job=")
        if not rows:
            skipped = [job for job in self.jobs_of(flight_id) if (job.kind, job.state) == (kind, "skipped")]
            reason = f" ({self.job(skipped[0].id).log[-1]})" if skipped else ""
            raise CatalogueError(
                f"flight {flight_id} has no {kind} result yet{reason}; POST /api/flights/{flight_id}/jobs starts one"
            )
        return str(rows[0]["job_id"]), dict(json.loads(rows[0]["json"]))

    def models(self) -> list[dict[str, Any]]:
        """Every model, newest first, without its coefficients; of a discrepancy its verdict and effects too."""
        rows = self._rows(
            "SELECT m.id, m.flight_id, CASE f.source WHEN 'upload' THEN f.name ELSE m.flight_id END AS flight_name,"
            " m.kind, m.job_id, m.name, m.created_ns, m.verdict, ifnull(m.found, '[]') AS effects"
            " FROM models m LEFT JOIN flights f ON f.id = m.flight_id ORDER BY m.number DESC"
        )
        return [{**dict(row), "effects": json.loads(row["effects"])} for row in rows]

    def model(self, model_id: str) -> dict[str, Any]:
        """One model; CatalogueError if there is none."""
        rows = self._rows("SELECT json FROM models WHERE id = ?", model_id)
        if not rows:
            raise CatalogueError(f"there is no model {model_id!r}; GET /api/models lists them")
        return dict(json.loads(rows[0]["json"]))


@contextmanager
def _named_failures() -> Iterator[None]:
    """A disk that is full or broken is an error with a name, not one of the database's."""
    try:
        yield
    except sqlite3.Error as error:
        raise CatalogueFileError(
            f"the catalogue cannot be read or written ({error}); is the disk full? If catalogue.sqlite is damaged, move"
            " it away: the next start lists the recordings anew, and results have to be made again"
        ) from error


def _job(row: sqlite3.Row, log: list[str]) -> Job:
    columns = {key: row[key] for key in row.keys() if key != "number"}  # noqa: SIM118 - a Row iterates its values
    columns["request"] = json.loads(columns["request"])
    return Job(**columns, log=log)
