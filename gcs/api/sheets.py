"""What follows from an identified model: the autopilot's parameters, its loops' margins, the aircraft's performance."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request
from fastapi.responses import PlainTextResponse

from gcs.api.link_view import seen_by
from gcs.api.schemas.problem import Problem
from gcs.api.service import Service, Serving
from gcs.tuning.parameter_file import parameter_file

router = APIRouter(tags=["estimation"])

_MISSING: dict[int | str, dict[str, Any]] = {404: {"model": Problem}, 409: {"model": Problem}, 503: {"model": Problem}}
OfJob = Annotated[str | None, Query(description="The job whose result is taken; the newest without it")]
Autopilot = Annotated[Literal["ardupilot", "px4"], Query(alias="for", description="Whose parameters")]


def _sheet(
    request: Request, service: Service, flight_id: str, job: str | None, kind: str, **settings: Any
) -> dict[str, Any]:
    service.catalogue.flight(flight_id)
    made_by, result = service.catalogue.job_and_result(flight_id, "identify", job)
    return {**service.reports.sheet(kind, seen_by(request, result), settings), "job": made_by}


@router.get("/api/flights/{flight_id}/tuning", responses=_MISSING)
def tuning(
    request: Request, service: Serving, flight_id: str, autopilot: Autopilot, job: OfJob = None
) -> dict[str, Any]:
    """What the flight says of the autopilot's parameters, as `gcs tune --json`: of schema tuning/1."""
    return _sheet(request, service, flight_id, job, "tuning", autopilot=autopilot)


@router.get("/api/flights/{flight_id}/tuning/file", response_class=PlainTextResponse, responses=_MISSING)
def tuning_file(
    request: Request, service: Serving, flight_id: str, autopilot: Autopilot, job: OfJob = None
) -> PlainTextResponse:
    """The same as a file to compare and load, as `gcs tune -o`."""
    found = _sheet(request, service, flight_id, job, "tuning", autopilot=autopilot)
    name = f"{flight_id}.{'param' if autopilot == 'ardupilot' else 'params'}"
    return PlainTextResponse(parameter_file(found), headers={"Content-Disposition": f'attachment; filename="{name}"'})


@router.get("/api/flights/{flight_id}/margins", responses=_MISSING)
def margins(request: Request, service: Serving, flight_id: str, job: OfJob = None) -> dict[str, Any]:
    """How much the autopilot's loops can bear, by the parameters in the log, as `gcs margins --json`: margins/1."""
    return _sheet(request, service, flight_id, job, "margins")


@router.get("/api/flights/{flight_id}/performance", responses=_MISSING)
def performance(
    request: Request,
    service: Serving,
    flight_id: str,
    mass: Annotated[float | None, Query(gt=0.0, lt=1e4, description="kg; the vehicle file's without it")] = None,
    altitude: Annotated[float, Query(ge=-500.0, le=8000.0, description="m, in the standard atmosphere")] = 0.0,
    temperature: Annotated[
        float | None, Query(ge=-60.0, le=60.0, description="there, degrees Celsius; the standard one without it")
    ] = None,
    battery: Annotated[
        float | None, Query(gt=0.0, lt=1e6, description="Wh that it holds: how long and far the aircraft flies")
    ] = None,
    job: OfJob = None,
) -> dict[str, Any]:
    """Glide, sink, climb, ceiling and turn of the aircraft, and how long and far a battery lasts where the flight's was
    read, as `gcs performance --json`: of schema performance/1.
    """
    asked = {"mass": mass, "altitude": altitude, "temperature": temperature, "battery": battery}
    return _sheet(request, service, flight_id, job, "performance", **asked)
