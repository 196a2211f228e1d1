"""Jobs in the catalogue."""

from __future__ import annotations

import json
import secrets
import sqlite3
from dataclasses import asdict, dataclass, field
from typing import Any

from gcs.catalogue.database import Database
from gcs.errors import CatalogueError
from gcs.text.jsontext import dumps

_MAX_ATTEMPTS = 2
_MAX_LOG_LINES = 1000
# Jobs of a flight that are listed.
_MOST_LISTED = 50
_MODEL_FIELDS = ("model", "structure", "prior")
# A request in which models that came with it are their names alone; their text is not even read here.
_WITHOUT_MODELS = "json_replace(request, {})".format(
    ", ".join(
        f"'$.{key}', json(CASE json_type(request, '$.{key}') WHEN 'object'"
        f" THEN json_object('name', json_extract(request, '$.{key}.name'))"
        f" ELSE json_quote(json_extract(request, '$.{key}')) END)"
        for key in _MODEL_FIELDS
    )
)
BY_STATION, BY_PERSON = 0, 1


@dataclass(frozen=True)
class Job:
    """One estimation.

    state: queued, running, done, failed, skipped or cancelled. progress: 0..1. error: in words if it failed.
    priority: that of a person's is above that of one which the station queued by itself. cpu_s, peak_bytes: what its
    last worker took, None where none has ended. owner: who asked for it, `station` for the station itself, or the
    client's address.
    """

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
    priority: int = BY_PERSON
    cpu_s: float | None = None
    peak_bytes: int | None = None
    owner: str = ""
    log: list[str] = field(default_factory=list)

    def to_json(self) -> dict[str, Any]:
        """The job as the REST interface gives it."""
        return asdict(self)


class JobTable(Database):
    """Jobs, from queued to over."""

    def add_job(
        self, flight_id: str, kind: str, request: dict[str, Any], priority: int = BY_PERSON, owner: str = ""
    ) -> Job:
        """Queue a job."""
        job_id = secrets.token_hex(6)
        with self._transaction() as db:
            db.execute(
                "INSERT INTO jobs (id, flight_id, kind, request, state, progress, attempts, created_ns, priority,"
                " owner) VALUES (?, ?, ?, ?, 'queued', 0, 0, ?, ?, ?)",
                (job_id, flight_id, kind, dumps(request), self._clock(), priority, owner),
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
        """The newest 50 jobs of a flight, newest first, without their logs, and without models but for their names."""
        rows = self._rows(
            f"SELECT *, {_WITHOUT_MODELS} AS shown FROM jobs WHERE flight_id = ? ORDER BY number DESC LIMIT ?",
            flight_id,
            _MOST_LISTED,
        )
        return [_job(row, []) for row in rows]

    def fruitless_jobs(self, flight_id: str) -> int:
        """How many jobs of a flight that people asked for are over and came to nothing."""
        rows = self._rows(
            "SELECT count(*) AS n FROM jobs WHERE flight_id = ? AND priority = ? AND state NOT IN"
            " ('queued', 'running', 'done')",
            flight_id,
            BY_PERSON,
        )
        return int(rows[0]["n"])

    def take_job(self) -> Job | None:
        """Turn the oldest queued job into a running one, a person's before those that the station queued itself."""
        with self._transaction() as db:
            row = db.execute(
                "SELECT id FROM jobs WHERE state = 'queued' ORDER BY priority DESC, number LIMIT 1"
            ).fetchone()
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
        """Store a result and its model, and mark the job done, all or nothing; nothing of a cancelled one."""
        now = self._clock()
        model = result.get("model")
        quality = result.get("quality") or {}
        reason = str(next(iter(quality.get("reasons", ())), "")) or None
        with self._transaction() as db:
            done = "UPDATE jobs SET state = 'done', progress = 1, ended_ns = ? WHERE id = ? AND state != 'cancelled'"
            if db.execute(done, (now, job.id)).rowcount == 0:
                return
            db.execute(
                "INSERT INTO results (flight_id, kind, job_id, created_ns, json, verdict, reason)"
                " VALUES (?, ?, ?, ?, ?, ?, ?)",
                (job.flight_id, job.kind, job.id, now, dumps(result), quality.get("verdict"), reason),
            )
            if isinstance(model, dict):
                found = [str(effect["name"]) for effect in result.get("effects", ())]
                db.execute(
                    "INSERT OR REPLACE INTO models (id, flight_id, kind, job_id, name, created_ns, json, verdict,"
                    " found) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
                    (job.id, job.flight_id, job.kind, job.id, str(model.get("name", "")), now, dumps(model),
                     result.get("verdict"), dumps(found)),
                )  # fmt: skip

    def fail_job(self, job_id: str, error: str) -> None:
        """Mark a job failed, with the reason in words."""
        with self._transaction() as db:
            db.execute(
                "UPDATE jobs SET state = 'failed', error = ?, ended_ns = ? WHERE id = ? AND state != 'cancelled'",
                (error, self._clock(), job_id),
            )

    def skip_job(self, job_id: str, reason: str) -> None:
        """Mark a job as having nothing to work on; its log says why."""
        self.report_progress(job_id, 1.0, reason)
        with self._transaction() as db:
            skipped = "UPDATE jobs SET state = 'skipped', ended_ns = ? WHERE id = ? AND state != 'cancelled'"
            db.execute(skipped, (self._clock(), job_id))

    def queued_jobs(self, priority: int) -> int:
        """How many of that priority wait."""
        rows = self._rows("SELECT count(*) AS n FROM jobs WHERE state = 'queued' AND priority = ?", priority)
        return int(rows[0]["n"])

    def job_states(self) -> tuple[dict[str, int], int | None]:
        """How many jobs are in each state, and when the oldest that waits was queued, ns UTC, None where none waits."""
        rows = self._rows("SELECT state, count(*) AS n, min(created_ns) AS oldest FROM jobs GROUP BY state")
        counts = {str(row["state"]): int(row["n"]) for row in rows}
        return counts, next((int(row["oldest"]) for row in rows if row["state"] == "queued"), None)

    def cancel_job(self, job_id: str) -> bool:
        """Mark a job that waits or runs as cancelled; False, and nothing is changed, if it is over."""
        with self._transaction() as db:
            return (
                db.execute(
                    "UPDATE jobs SET state = 'cancelled', ended_ns = ? WHERE id = ? AND state IN ('queued', 'running')",
                    (self._clock(), job_id),
                ).rowcount
                > 0
            )

    def delete_job(self, job_id: str) -> bool:
        """Forget a job with its log, result and model; False, and nothing is changed, while it waits or runs."""
        with self._transaction() as db:
            # What a person has deleted the station does not make again by itself.
            of_it = "SELECT flight_id FROM jobs WHERE id = ? AND kind = 'identify'"
            db.execute(f"UPDATE flights SET settled = 1 WHERE id IN ({of_it})", (job_id,))
            over = "DELETE FROM jobs WHERE id = ? AND state NOT IN ('queued', 'running')"
            if db.execute(over, (job_id,)).rowcount == 0:
                return False
            for table in ("job_log", "results", "models"):
                db.execute(f"DELETE FROM {table} WHERE job_id = ?", (job_id,))
        return True

    def note_cost(self, job_id: str, cpu_s: float, peak_bytes: int) -> None:
        """Keep what a job's worker took."""
        with self._transaction() as db:
            db.execute("UPDATE jobs SET cpu_s = ?, peak_bytes = ? WHERE id = ?", (cpu_s, peak_bytes, job_id))

    def requeue_interrupted_jobs(self, why: str = "the service stopped") -> None:
        """What was interrupted is queued again, or failed if that has happened to it before; why: in words."""
        for row in self._rows("SELECT id, attempts FROM jobs WHERE state = 'running'"):
            if row["attempts"] >= _MAX_ATTEMPTS:
                self.fail_job(row["id"], f"{why} while this job ran, for the second time; start it anew")
                continue
            with self._transaction() as db:
                again = "UPDATE jobs SET state = 'queued', progress = 0 WHERE id = ? AND state = 'running'"
                db.execute(again, (row["id"],))
            self.report_progress(row["id"], 0.0, f"{why} while this job ran; queued again")


def _job(row: sqlite3.Row, log: list[str]) -> Job:
    columns = {key: row[key] for key in row.keys() if key != "number"}  # noqa: SIM118 - a Row iterates its values
    columns["request"] = json.loads(columns.pop("shown", columns["request"]))
    return Job(**columns, log=log)
