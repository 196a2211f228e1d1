"""Flights: the list, uploads, summaries, recordings and signals."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import FileResponse
from starlette.concurrency import run_in_threadpool

from gcs.api.held import HeldFile
from gcs.api.link_view import seen_by
from gcs.api.schemas.design import Planned, PlannedCoefficient
from gcs.api.schemas.flights import ChosenVehicle, FlightItem, FlightNotesChange, FlightPage, FlightSummary, Uploaded
from gcs.api.schemas.jobs import JobView
from gcs.api.schemas.problem import Problem
from gcs.api.schemas.signals import Series, SignalsView, SpectraView, Spectrogram, SpectrogramsView, Spectrum
from gcs.api.service import Service, Serving
from gcs.api.upload import receive_upload
from gcs.catalogue.aircraft_rule import STATION
from gcs.catalogue.database import PATIENCE, PATIENT_S
from gcs.catalogue.flight_table import Flight
from gcs.catalogue.note_table import FlightNotes
from gcs.catalogue.result_table import FlightOutcome
from gcs.errors import CatalogueError, GcsError, JobError
from gcs.text.intervals import of_the_flight
from gcs.text.utctext import utc_text
from sim_vehicle.errors import SimVehicleError

router = APIRouter(tags=["flights"])

_PROBLEM = {"model": Problem}
_DAY_NS = 86_400_000_000_000
_LATEST_NS = 2**63 - 1
# Of what says what the columns of a table are, characters: it stands in the address.
_LONGEST_MAPPING = 4000
_UPLOAD_BODY = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["file"],
                    "properties": {"file": {"type": "string", "format": "binary"}},
                }
            },
            "application/octet-stream": {"schema": {"type": "string", "format": "binary"}},
        },
    }
}


def _items(service: Service, found: Sequence[Flight]) -> list[FlightItem]:
    ids = [flight.id for flight in found]
    notes, outcomes = service.catalogue.notes_of(ids), service.catalogue.outcomes_of(ids)
    outlines = service.catalogue.outlines_of(ids)
    return [
        FlightItem.model_validate(
            {**_fields(flight, notes[flight.id], outcomes[flight.id]), "outline": outlines.get(flight.id)}
        )
        for flight in found
    ]


def _item(service: Service, flight: Flight) -> FlightItem:
    return _items(service, [flight])[0]


def _fields(flight: Flight, notes: FlightNotes, outcome: FlightOutcome) -> dict[str, object]:
    return {
        "title": notes.title,
        "comment": notes.comment,
        "tags": list(notes.tags),
        "vehicle": notes.vehicle or None,
        "outcome": {"state": outcome.state, "verdict": outcome.verdict, "text": outcome.text},
        "id": flight.id,
        "name": flight.name,
        "source": flight.source,
        "state": flight.state,
        "system": flight.system,
        "start": utc_text(flight.start_ns),
        "end": utc_text(flight.end_ns),
        "duration_s": (flight.end_ns - flight.start_ns) / 1e9,
        "vehicle_duration_s": flight.vehicle_s,
        "messages": flight.messages,
        "bytes": flight.bytes,
        "end_reason": flight.end_reason,
        "follows": flight.follows,
        "parts": flight.parts,
        "board": flight.board,
        "recording_deleted": None if flight.deleted_ns is None else utc_text(flight.deleted_ns),
    }


@router.get("/api/flights", responses={404: _PROBLEM})
def flights(
    service: Serving,
    limit: Annotated[int, Query(ge=1, le=1000)] = 50,
    after: str | None = None,
    search: Annotated[
        str, Query(max_length=200, description="Words that stand in the id, the name or the start, as 2026-11-23 06:10")
    ] = "",
    since: Annotated[date | None, Query(description="Those that began on this day (UTC) or later")] = None,
    until: Annotated[date | None, Query(description="Those that began on this day (UTC) or before")] = None,
    vehicle: Annotated[
        str, Query(max_length=200, description="Those of an aircraft, by its id: chosen by hand, or named in a job")
    ] = "",
    deleted: Annotated[bool, Query(description="Those that were deleted, and can be taken back, instead")] = False,
    ground: Annotated[bool, Query(description="What was recorded on the ground behind flights too")] = False,
) -> FlightPage:
    """Flights, newest first."""
    found = service.catalogue.flights(
        limit + 1,
        after,
        search,
        since_ns=None if since is None else _midnight_ns(since, 0),
        until_ns=None if until is None else _midnight_ns(until, 1),
        vehicle=vehicle,
        discarded=deleted,
        ground=ground,
    )
    page = found[:limit]
    return FlightPage(flights=_items(service, page), next=page[-1].id if len(found) > limit else None)


def _midnight_ns(day: date, later: int) -> int:
    """UTC ns at which a day begins, so many days later, within what the catalogue's numbers hold."""
    return max(min(((day - date(1970, 1, 1)).days + later) * _DAY_NS, _LATEST_NS), 0)


@router.post(
    "/api/flights",
    status_code=201,
    responses={408: _PROBLEM, 411: _PROBLEM, 413: _PROBLEM, 422: _PROBLEM, 503: _PROBLEM, 507: _PROBLEM},
    openapi_extra=_UPLOAD_BODY,
)
async def upload(
    request: Request,
    service: Serving,
    name: Annotated[str, Query(description="File name of a body that is not multipart")] = "",
    columns: Annotated[
        str, Query(description="TOML: what the columns of a table are", max_length=_LONGEST_MAPPING)
    ] = "",
) -> Uploaded:
    """Upload a log (.mcap, .tlog, .bin, .ulg), a table (.csv, .parquet, .mat, .npz) or a ROS bag.

    A form with the part `file`, or the file itself with `?name=`.
    """
    PATIENCE.set(PATIENT_S)  # what took an hour to come is worth a wait
    with service.uploads.places.held(request.state.identity.name):
        return await _taken_in(request, service, name, columns)


async def _taken_in(request: Request, service: Service, name: str, columns: str) -> Uploaded:
    async with receive_upload(request, service, name) as (path, original):
        flight = await run_in_threadpool(service.uploads.take_in, path, original, columns)
        service.views.prepare(flight)
        same = await run_in_threadpool(service.catalogue.same_flight, flight)
    seems = (
        f"flight {same} has as many messages between the same instants, so it seems to be the same: go on with either"
    )
    note = seems if same else ""
    return Uploaded.model_validate({**_item(service, flight).model_dump(), "note": note})


@router.get("/api/flights/{flight_id}", responses={404: _PROBLEM, 503: _PROBLEM})
def flight(request: Request, service: Serving, flight_id: str) -> FlightSummary:
    """What a flight holds, and the state of its jobs; to a shared link neither jobs nor other flights."""
    found = service.catalogue.flight(flight_id)
    jobs = [JobView.of(job.to_json()) for job in service.catalogue.jobs_of(flight_id)]
    ground = _items(service, service.catalogue.ground_after(flight_id))
    summary, item = service.views.summary(found), _item(service, found).model_dump()
    whole = FlightSummary.model_validate(
        {
            **item,
            **summary,
            "jobs": jobs,
            "ground": ground,
            "aircraft": _aircraft(service, found),
            "used": service.catalogue.used_parts(flight_id),
        }
    )
    return _of_a_link(request, whole) if request.state.identity.flight else whole


def _of_a_link(request: Request, whole: FlightSummary) -> FlightSummary:
    """Without who asked for jobs from where, which other flights there are, and which board it was."""
    aircraft = whole.aircraft.model_copy(update={"why": "", "problem": ""})
    thin = whole.model_copy(update={"jobs": [], "ground": [], "follows": None, "board": None, "aircraft": aircraft})
    return FlightSummary.model_validate(seen_by(request, thin.model_dump()))


def _aircraft(service: Service, flight: Flight) -> ChosenVehicle:
    try:
        chosen = service.jobs.choice.of(flight)
    except (GcsError, SimVehicleError) as error:
        return ChosenVehicle(id=None, name=None, version=None, by_hand=False, why="", problem=str(error))
    one = chosen.vehicle
    return ChosenVehicle(
        id=one.id, name=one.vehicle.name, version=one.version, by_hand=chosen.by_hand, why=chosen.why, problem=""
    )


@router.get("/api/flights/{flight_id}/planned", responses={404: _PROBLEM})
def planned(request: Request, service: Serving, flight_id: str) -> Planned:
    """The newest plan of the same aircraft that was there when the flight began, held against its newest model."""
    found = service.catalogue.flight(flight_id)
    job, result = service.catalogue.job_and_result(flight_id, "identify")
    model = result["model"]["coefficients"]
    vehicle = str(service.catalogue.job(job).request.get("vehicle") or STATION).partition("@")[0]
    plan = service.catalogue.plan_before(found, vehicle)
    if plan is None:
        raise CatalogueError(f"no flight of this aircraft was planned before flight {flight_id}")
    promised = {entry["name"]: entry["std"] for entry in plan["json"]["coefficients"]}
    held_against = Planned(
        flight=plan["flight_id"],
        made=utc_text(plan["created_ns"]),
        gusts=float(plan["json"].get("gusts") or 0.0),
        coefficients=[
            PlannedCoefficient(name=name, expected_std=std, reached_std=of_the_flight(model.get(name, {})))
            for name, std in promised.items()
        ],
    )
    return Planned.model_validate(seen_by(request, held_against.model_dump()))


@router.patch("/api/flights/{flight_id}", responses={404: _PROBLEM, 409: _PROBLEM, 422: _PROBLEM})
def describe(service: Serving, flight_id: str, change: FlightNotesChange) -> FlightItem:
    """Say what a flight was: its name, a note, tags, which aircraft it was."""
    found = service.catalogue.flight(flight_id)
    said = change.model_dump(exclude_none=True)
    if said.get("vehicle"):
        service.jobs.choice.require_listed(said["vehicle"])
    if "tags" in said:
        said["tags"] = tuple(dict.fromkeys(tag.strip() for tag in said["tags"] if tag.strip()))
    service.catalogue.change_notes(flight_id, **said)
    if "vehicle" in said and found.state != "recording":
        service.views.prepare(found)
    return _item(service, found)


@router.delete("/api/flights/{flight_id}", status_code=204, responses={404: _PROBLEM, 409: _PROBLEM})
def delete(service: Serving, flight_id: str) -> None:
    """Delete a flight with its recording, jobs, results and models; for a day it can be restored."""
    found = service.catalogue.flight(flight_id)
    if found.state == "recording":
        raise JobError(f"flight {flight_id} is still being recorded; wait until it has ended")
    if not service.catalogue.discard_flight(flight_id):
        raise JobError(f"a job that waits or runs needs flight {flight_id}; cancel it, or wait until it is done")


@router.post("/api/flights/{flight_id}/restore", responses={404: _PROBLEM})
def restore(service: Serving, flight_id: str) -> FlightItem:
    """Take the deletion of a flight back."""
    return _item(service, service.catalogue.restore_flight(flight_id))


@router.get(
    "/api/flights/{flight_id}/recording",
    response_class=FileResponse,
    responses={
        200: {"content": {"application/octet-stream": {}}},
        206: {"description": "The range asked for"},
        404: _PROBLEM,
        410: {"model": Problem, "description": "The recording was deleted to make room"},
        503: _PROBLEM,
    },
)
def recording(
    request: Request,
    service: Serving,
    flight_id: str,
    part: Annotated[int, Query(ge=1, description="Which file of a recording that was split by size")] = 1,
) -> FileResponse:
    """The MCAP file; HTTP ranges are honoured."""
    found = service.catalogue.flight(flight_id)
    found.kept_files(service.settings.flights)
    if part > found.parts:
        raise CatalogueError(f"the recording of flight {flight_id} has {found.parts} parts, no part {part}")
    path = found.files(service.settings.flights)[part - 1]
    if not path.is_file():
        raise CatalogueError(f"part {part} of the recording of flight {flight_id} is gone from the data folder")
    who = request.state.identity.name
    return HeldFile(path, media_type="application/octet-stream", filename=path.name, places=service.fetching, who=who)


_Names = Annotated[str, Query(max_length=5000, description="Names from the flight's summary, separated by commas")]
_Moment = Annotated[float | None, Query(description="s from the start of the flight")]


@router.get("/api/flights/{flight_id}/signals", responses={404: _PROBLEM, 409: _PROBLEM, 503: _PROBLEM})
def signals(
    service: Serving,
    flight_id: str,
    names: _Names,
    start: _Moment = None,
    end: _Moment = None,
    points: Annotated[int, Query(ge=2, le=100_000)] = 2000,
) -> SignalsView:
    """Signals for plotting, at most about `points` samples of each; the extremes of every stretch are kept."""
    found = service.catalogue.flight(flight_id)
    series = service.views.series(found, _wanted(names), start, end, points)
    return SignalsView(flight=flight_id, signals={name: Series(**entry) for name, entry in series.items()})


@router.get("/api/flights/{flight_id}/spectrum", responses={404: _PROBLEM, 409: _PROBLEM, 503: _PROBLEM})
def spectrum(
    service: Serving, flight_id: str, names: _Names, start: _Moment = None, end: _Moment = None
) -> SpectraView:
    """Power spectral densities of signals: vibration, sensors' noise, what the air does."""
    found = service.catalogue.flight(flight_id)
    spectra = service.views.spectra(found, _wanted(names), start, end)
    return SpectraView(flight=flight_id, signals={name: Spectrum(**entry) for name, entry in spectra.items()})


@router.get("/api/flights/{flight_id}/spectrogram", responses={404: _PROBLEM, 409: _PROBLEM, 503: _PROBLEM})
def spectrogram(
    service: Serving, flight_id: str, names: _Names, start: _Moment = None, end: _Moment = None
) -> SpectrogramsView:
    """Spectra of signals over time: when something shook, and how the frequency moved with the propeller."""
    found = service.catalogue.flight(flight_id)
    made = service.views.spectrograms(found, _wanted(names), start, end)
    return SpectrogramsView(flight=flight_id, signals={name: Spectrogram(**entry) for name, entry in made.items()})


def _wanted(names: str) -> list[str]:
    return list(dict.fromkeys(name.strip() for name in names.split(",") if name.strip()))
