"""What a list says of flights: a name, a comment, tags, which aircraft it was, and how it went in few points."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from gcs.catalogue.database import Database


@dataclass(frozen=True)
class FlightNotes:
    """What a person said of one flight. vehicle: the id of the aircraft that was chosen by hand, "" for none."""

    title: str = ""
    comment: str = ""
    tags: tuple[str, ...] = ()
    vehicle: str = ""


class NoteTable(Database):
    """Notes by flight; a flight of which nobody said anything has none."""

    def notes(self, flight_id: str) -> FlightNotes:
        """Of one flight."""
        return self.notes_of([flight_id])[flight_id]

    def notes_of(self, flight_ids: Sequence[str]) -> dict[str, FlightNotes]:
        """Of each of these flights."""
        marks = ", ".join("?" for _ in flight_ids)
        rows = self._rows(f"SELECT * FROM flight_notes WHERE flight_id IN ({marks})", *flight_ids)
        found = {
            row["flight_id"]: FlightNotes(
                row["title"], row["comment"], tuple(map(str, json.loads(row["tags"]))), row["vehicle"]
            )
            for row in rows
        }
        return {one: found.get(one, FlightNotes()) for one in flight_ids}

    def change_notes(self, flight_id: str, **said: Any) -> None:
        """Keep what was said of a flight; what is not named stays as it is."""
        with self._alone():
            self.put_notes(flight_id, replace(self.notes(flight_id), **said))

    def put_notes(self, flight_id: str, notes: FlightNotes) -> None:
        """Keep what was said of a flight, in place of what was said before."""
        tags = json.dumps(list(notes.tags), ensure_ascii=False)
        with self._transaction() as db:
            db.execute(
                "INSERT INTO flight_notes (flight_id, title, comment, tags, vehicle, changed_ns)"
                " VALUES (?, ?, ?, ?, ?, ?) ON CONFLICT (flight_id) DO UPDATE SET title = excluded.title,"
                " comment = excluded.comment, tags = excluded.tags, vehicle = excluded.vehicle,"
                # When the aircraft was chosen, by which later flights go: a corrected comment is no new choice.
                " changed_ns = CASE WHEN vehicle = excluded.vehicle THEN changed_ns ELSE excluded.changed_ns END",
                (flight_id, notes.title, notes.comment, tags, notes.vehicle, self._clock()),
            )

    def put_outline(self, flight_id: str, outline: dict[str, Any]) -> None:
        """Keep one signal of a flight in few points, by which a list shows how it went."""
        with self._transaction() as db:
            db.execute(
                "INSERT OR REPLACE INTO flight_outlines SELECT id, ? FROM flights WHERE id = ?",
                (json.dumps(outline), flight_id),
            )

    def outlines_of(self, flight_ids: Sequence[str]) -> dict[str, dict[str, Any]]:
        """Those that are kept, by flight."""
        marks = ", ".join("?" for _ in flight_ids)
        rows = self._rows(f"SELECT * FROM flight_outlines WHERE flight_id IN ({marks})", *flight_ids)
        return {row["flight_id"]: json.loads(row["json"]) for row in rows}

    def vehicle_before(
        self, system: int, source: str, start_ns: int, board: str | None = None
    ) -> tuple[str, str] | None:
        """Aircraft and id of the last flight not after that moment for which somebody chose, None if there is none.

        Of flights of that system which came the same way ("live", "upload"), but not of those known to have another
        autopilot board.
        """
        same = "(f.system, f.source) = (?, ?)"
        if board is None:
            return self._chosen_before(same, start_ns, system, source)
        return self._chosen_before(f"{same} AND ifnull(f.board, ?) = ?", start_ns, system, source, board, board)

    def vehicle_of_board(self, board: str, start_ns: int) -> tuple[str, str] | None:
        """The same of flights with that autopilot board, whatever their system, whichever way they came."""
        return self._chosen_before("f.board = ?", start_ns, board)

    def _chosen_before(self, condition: str, start_ns: int, *values: object) -> tuple[str, str] | None:
        rows = self._rows(
            "SELECT n.vehicle, n.flight_id FROM flight_notes n JOIN flights f ON f.id = n.flight_id"
            f" WHERE n.vehicle != '' AND f.discarded_ns IS NULL AND {condition} AND f.start_ns <= ?"
            " ORDER BY f.start_ns DESC, f.id DESC LIMIT 1",
            *values,
            start_ns,
        )
        return (str(rows[0]["vehicle"]), str(rows[0]["flight_id"])) if rows else None

    def vehicle_chosen_last(self) -> tuple[str, str] | None:
        """Aircraft and flight of the newest choice by hand, None if there is none."""
        rows = self._rows(
            "SELECT n.vehicle, n.flight_id FROM flight_notes n JOIN flights f ON f.id = n.flight_id"
            " WHERE n.vehicle != '' AND f.discarded_ns IS NULL ORDER BY n.changed_ns DESC, n.rowid DESC LIMIT 1"
        )
        return (str(rows[0]["vehicle"]), str(rows[0]["flight_id"])) if rows else None
