"""Results and models in the catalogue."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from gcs.catalogue.aircraft_rule import OF_AIRCRAFT, of_aircraft
from gcs.catalogue.flight_table import Flight
from gcs.catalogue.job_table import JobTable
from gcs.errors import CatalogueError


@dataclass(frozen=True)
class FlightOutcome:
    """How far the newest identification of a flight is, and what the newest result is worth.

    state: of the job, None where there was none. verdict: good, care, poor, None where there is no result.
    text: a sentence for a list, empty where there is nothing to say.
    """

    state: str | None = None
    verdict: str | None = None
    text: str = ""


class ResultTable(JobTable):
    """What jobs have made."""

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
            query = "SELECT id FROM jobs WHERE flight_id = ? AND kind = ? AND state = 'skipped'"
            skipped = self._rows(f"{query} ORDER BY number DESC LIMIT 1", flight_id, kind)
            reason = f" ({self.job(skipped[0]['id']).log[-1]})" if skipped else ""
            raise CatalogueError(
                f"flight {flight_id} has no {kind} result yet{reason}; POST /api/flights/{flight_id}/jobs starts one"
            )
        return str(rows[0]["job_id"]), dict(json.loads(rows[0]["json"]))

    def outcomes_of(self, flight_ids: Sequence[str]) -> dict[str, FlightOutcome]:
        """How the identification of each of these flights stands."""
        marks = ", ".join("?" for _ in flight_ids)
        jobs = self._rows(
            f"SELECT flight_id, state, error FROM jobs WHERE kind = 'identify' AND flight_id IN ({marks})"
            " ORDER BY number",
            *flight_ids,
        )
        results = self._rows(
            f"SELECT flight_id, verdict, reason FROM results WHERE kind = 'identify' AND flight_id IN ({marks})"
            " ORDER BY number",
            *flight_ids,
        )
        found = {one: FlightOutcome() for one in flight_ids}
        for row in jobs:
            found[row["flight_id"]] = FlightOutcome(row["state"], None, row["error"] or "")
        for row in results:
            before = found[row["flight_id"]]
            found[row["flight_id"]] = replace(before, verdict=row["verdict"], text=row["reason"] or "")
        return found

    def used_parts(self, flight_id: str) -> list[dict[str, float]]:
        """Parts of a flight that its newest identification was made from, s."""
        rows = self._rows(
            "SELECT json_extract(json, '$.segments') AS parts FROM results"
            " WHERE flight_id = ? AND kind = 'identify' AND json_valid(json) ORDER BY number DESC LIMIT 1",
            flight_id,
        )
        parts = json.loads(rows[0]["parts"] or "[]") if rows else []
        of_it = [part for part in parts if str(part.get("flight", "")).removesuffix(".mcap") == flight_id]
        return [{"start": float(part["start"]), "end": float(part["end"])} for part in of_it]

    def identified_with(self, vehicle: str) -> list[dict[str, Any]]:
        """Newest identification of each flight that was made with an aircraft of that id, in any version, oldest first.

        Each: flight, title, start_ns, coefficients.
        """
        rows = self._rows(
            "SELECT m.flight_id, f.start_ns, ifnull(n.title, '') AS title, m.json, max(m.number) AS newest"
            " FROM models m JOIN flights f ON f.id = m.flight_id JOIN jobs j ON j.id = m.job_id"
            " LEFT JOIN flight_notes n ON n.flight_id = f.id"
            " WHERE m.kind = 'identify' AND f.discarded_ns IS NULL"
            f" AND {OF_AIRCRAFT} GROUP BY m.flight_id ORDER BY f.start_ns",
            *of_aircraft(vehicle),
        )
        return [
            {
                "flight": row["flight_id"],
                "title": row["title"],
                "start_ns": row["start_ns"],
                "coefficients": json.loads(row["json"]).get("coefficients", {}),
            }
            for row in rows
        ]

    def plan_before(self, flight: Flight, vehicle: str) -> dict[str, Any] | None:
        """The newest plan of a flight of that aircraft which was there when the flight began, None where there is none.

        Gives flight (behind which it was planned), created_ns and the result.
        """
        rows = self._rows(
            "SELECT r.flight_id, r.created_ns, r.json FROM results r JOIN jobs j ON j.id = r.job_id"
            " JOIN flights f ON f.id = r.flight_id WHERE r.kind = 'design' AND r.created_ns <= ? AND r.flight_id != ?"
            f" AND f.discarded_ns IS NULL AND {OF_AIRCRAFT} ORDER BY r.number DESC LIMIT 1",
            flight.start_ns,
            flight.id,
            *of_aircraft(vehicle),
        )
        return None if not rows else {**dict(rows[0]), "json": json.loads(rows[0]["json"])}

    def models(self) -> list[dict[str, Any]]:
        """Every model, newest first, without its coefficients; of a discrepancy its verdict and effects too."""
        rows = self._rows(
            "SELECT m.id, m.flight_id, CASE f.source WHEN 'upload' THEN f.name ELSE m.flight_id END AS flight_name,"
            " m.kind, m.job_id, m.name, m.created_ns, m.verdict, ifnull(m.found, '[]') AS effects"
            " FROM models m LEFT JOIN flights f ON f.id = m.flight_id"
            " WHERE f.discarded_ns IS NULL ORDER BY m.number DESC"
        )
        return [{**dict(row), "effects": json.loads(row["effects"])} for row in rows]

    def job_of_model(self, model_id: str) -> str:
        """The job that a model is of; CatalogueError if there is no such model."""
        rows = self._rows("SELECT job_id FROM models WHERE id = ?", model_id)
        if not rows:
            raise CatalogueError(f"there is no model {model_id!r}; GET /api/models lists them")
        return str(rows[0]["job_id"])

    def model(self, model_id: str) -> dict[str, Any]:
        """One model; CatalogueError if there is none."""
        rows = self._rows("SELECT json FROM models WHERE id = ?", model_id)
        if not rows:
            raise CatalogueError(f"there is no model {model_id!r}; GET /api/models lists them")
        return dict(json.loads(rows[0]["json"]))
