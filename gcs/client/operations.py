"""Every operation on a station, once for all clients: what is asked for, and what comes of it."""

from __future__ import annotations

import time
from datetime import date
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

from gcs.api.schemas.flights import FlightItem, FlightPage, FlightSummary, Uploaded
from gcs.api.schemas.jobs import JobView, ModelItem
from gcs.api.schemas.links import LinkStatus
from gcs.api.schemas.live import Live
from gcs.api.schemas.station import Health
from gcs.client.steps import Pause, Request, Steps, answer, done
from gcs.client.transfer import OnProgress, Upload
from gcs.errors import StationError

_PAGE = 500
_AT_WORK = ("queued", "running")
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.2, 2.0
# A radio link or a service that is started anew comes back within it.
_LONGEST_OUTAGE_S = 30.0
_COMES_BACK = (None, 502, 503, 504)


def health() -> Steps[Health]:
    """State of the service; the one answer that needs no token."""
    return answer(Health, Request("GET", "/api/health"))


def links() -> Steps[list[LinkStatus]]:
    """Every link: rates, losses, and the systems heard on it."""
    return answer(list[LinkStatus], Request("GET", "/api/links"))


def live() -> Steps[Live]:
    """What flies now, and what is known of it so far."""
    return answer(Live, Request("GET", "/api/live"))


def models() -> Steps[list[ModelItem]]:
    """Every identified model, newest first."""
    return answer(list[ModelItem], Request("GET", "/api/models"))


def flights(
    limit: int | None = None,
    *,
    search: str = "",
    vehicle: str = "",
    since: date | None = None,
    until: date | None = None,
    deleted: bool = False,
    ground: bool = False,
) -> Steps[list[FlightItem]]:
    """Flights, newest first: all of them, or as many as `limit`.

    search: words of id, name or start. vehicle: id of an aircraft. since, until: days (UTC) of their beginning.
    deleted: those that can be taken back, instead. ground: what was recorded on the ground behind flights too.
    """
    asked = {
        "search": search,
        "vehicle": vehicle,
        "since": since,
        "until": until,
        "deleted": deleted or None,
        "ground": ground or None,
    }
    found: list[FlightItem] = []
    after: str | None = None
    while limit is None or len(found) < limit:
        size = _PAGE if limit is None else min(limit - len(found), _PAGE)
        query = {**asked, "limit": size, "after": after}
        page = yield from answer(FlightPage, Request("GET", "/api/flights", query))
        found += page.flights
        after = page.next
        if after is None or not page.flights:
            break
    return found


def flight(flight_id: str) -> Steps[FlightSummary]:
    """What a flight holds, and the state of its jobs."""
    return answer(FlightSummary, Request("GET", _place("flights", flight_id)))


def upload(
    path: str | Path, name: str | None = None, *, columns: str = "", on_progress: OnProgress | None = None
) -> Steps[Uploaded]:
    """Hand a log, table or bag in; it becomes a flight. Raises OSError where the file cannot be read.

    name: what it is called there, with its ending; the file's own name without it. columns: for a table, the text of a
    mapping file. on_progress: called with the share sent and a line of text.
    """
    file = Upload.of(Path(path), on_progress)
    query = {"name": file.path.name if name is None else name, "columns": columns}
    return answer(Uploaded, Request("POST", "/api/flights", query, upload=file))


def download(flight_id: str, target: str | Path, *, part: int = 1) -> Steps[Path]:
    """Write a flight's recording to the file `target`, whole or not at all; its path.

    part: which file of a recording that was split by size. Raises OSError where the file cannot be written.
    """
    path = Path(target)
    yield Request("GET", f"{_place('flights', flight_id)}/recording", {"part": part}, target=path)
    return path


def delete(flight_id: str) -> Steps[None]:
    """Delete a flight with its recording, jobs, results and models; for a day it can be restored."""
    return done(Request("DELETE", _place("flights", flight_id)))


def identify(flight_id: str, **options: Any) -> Steps[JobView]:
    """Queue an identification. options: those of a job (`JobChanges`), `from_` and `validate_` in Python's spelling."""
    return _job(flight_id, "identify", options)


def discrepancy(flight_id: str, **options: Any) -> Steps[JobView]:
    """Queue a discrepancy analysis of a `model`: the id of one, or the model itself. Other options as in `identify`."""
    return _job(flight_id, "discrepancy", options)


def job(job_id: str) -> Steps[JobView]:
    """State, progress and log of a job, and the error in words."""
    return answer(JobView, Request("GET", _place("jobs", job_id)))


def wait(job: str | JobView, timeout_s: float | None = None, on_progress: OnProgress | None = None) -> Steps[JobView]:
    """A job once it is over; its `state` says how it ended. An outage of up to 30 s between answers is waited out.

    timeout_s: how long to wait, for ever without it; StationError if the job is not over then.
    on_progress: called with the job's progress (0..1) and the last line of its log.
    """
    job_id = job if isinstance(job, str) else job.id
    began = time.monotonic()
    heard, pause = -float("inf"), _FIRST_PAUSE_S
    state = "waited for"
    while True:
        try:
            found = yield from answer(JobView, Request("GET", _place("jobs", job_id)))
        except StationError as error:
            if error.status not in _COMES_BACK or time.monotonic() - heard > _LONGEST_OUTAGE_S:
                raise
        else:
            heard, state = time.monotonic(), found.state
            if on_progress is not None:
                on_progress(found.progress, found.log[-1] if found.log else found.state)
            if found.state not in _AT_WORK:
                return found
        left = float("inf") if timeout_s is None else began + timeout_s - time.monotonic()
        if left <= 0:
            raise StationError(f"job {job_id} is still {state} after {timeout_s:g} s; it goes on at the station")
        yield Pause(min(pause, left))
        pause = min(1.5 * pause, _LONGEST_PAUSE_S)


def result(
    flight_id: str,
    kind: Literal["identification", "identify", "discrepancy", "design"],
    job: str | None = None,
) -> Steps[dict[str, Any]]:
    """The newest result of that kind, or that of one job, as the commands write it. kind: a job's own does too."""
    named = {"identify": "identification"}.get(kind, kind)
    return answer(dict[str, Any], Request("GET", f"{_place('flights', flight_id)}/{quote(named, '')}", {"job": job}))


def _job(flight_id: str, kind: str, options: dict[str, Any]) -> Steps[JobView]:
    body = {name.removesuffix("_"): value for name, value in options.items() if value is not None}
    return answer(JobView, Request("POST", f"{_place('flights', flight_id)}/jobs", body={**body, "kind": kind}))


def _place(collection: str, entry: str) -> str:
    """The path of one entry. Raises StationError for an id that would lead to another path."""
    if not entry.strip("."):
        raise StationError(f"{entry!r} is no id; give one that the list of {collection} shows")
    return f"/api/{collection}/{quote(entry, safe='')}"
