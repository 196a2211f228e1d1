"""What a station answered as lines for a terminal; names that people gave cannot reach the terminal's controls."""

from __future__ import annotations

from collections.abc import Sequence

from gcs.api.schemas.flights import FlightItem
from gcs.api.schemas.jobs import JobView, ModelItem
from gcs.text.one_line import one_line
from gcs.text.utctext import utc_text


def flight_lines(flights: Sequence[FlightItem]) -> list[str]:
    """A line for each flight: id, beginning, duration, what it is called, and what came of it."""
    rows = [
        (one.id, one.start[:16], f"{one.duration_s:.0f} s", one.title or one.name, one.outcome.text) for one in flights
    ]
    return _aligned(rows) or ["the station has no such flight"]


def model_lines(models: Sequence[ModelItem]) -> list[str]:
    """A line for each model: id, its making, kind, flight, and what a discrepancy analysis says."""
    rows = [
        (
            one.id,
            utc_text(one.created_ns)[:16],
            one.kind,
            one.flight_name,
            " ".join([*filter(None, [one.verdict]), *one.effects]),
        )
        for one in models
    ]
    return _aligned(rows) or ["the station has no model yet"]


def job_lines(job: JobView) -> list[str]:
    """A job's state and log."""
    head = f"job {job.id}: {job.kind} of flight {job.flight_id}, {job.state}, {100 * job.progress:.0f} %"
    error = [f"  error: {job.error}"] if job.error else []
    return [one_line(head), *(f"  {one_line(line)}" for line in [*job.log, *error])]


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    clean = [[one_line(entry) for entry in row] for row in rows]
    wide = [max(map(len, column)) for column in zip(*clean, strict=True)]
    return ["  ".join(f"{entry:<{width}}" for entry, width in zip(row, wide, strict=True)).rstrip() for row in clean]
