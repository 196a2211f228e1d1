"""Jobs, their results, and models."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, Response
from pydantic import ValidationError

from gcs.api.link_view import seen_by
from gcs.api.schemas.design import PlanUpload
from gcs.api.schemas.jobs import JobChanges, JobRequest, JobView, ModelItem
from gcs.api.schemas.problem import Problem
from gcs.api.service import Serving
from gcs.errors import JobError
from gcs.exports.archive import archived
from gcs.exports.exported import Exported
from sim_vehicle.model.model_file import model_from_json

router = APIRouter(tags=["estimation"])

# By the name of the result, the kind of job that makes it.
_KINDS = {"identification": "identify", "discrepancy": "discrepancy"}
# Where ArduPilot looks for scripts on its card.
_SCRIPT = "APM/scripts/flight_test.lua"
_PAGE_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
_MISSING: dict[int | str, dict[str, Any]] = {404: {"model": Problem}}
OfJob = Annotated[str | None, Query(description="The job whose result is wanted; the newest without it")]


@router.post(
    "/api/flights/{flight_id}/jobs",
    status_code=202,
    responses={**_MISSING, 409: {"model": Problem}, 503: {"model": Problem}},
)
def start_job(service: Serving, flight_id: str, wanted: JobRequest, request: Request) -> JobView:
    """Queue an identification or a discrepancy analysis; `log` begins with what is to be known of it beforehand."""
    asked = wanted.model_dump(by_alias=True, exclude_none=True)
    owner = request.client.host if request.client else ""
    return JobView.of(service.jobs.submit(flight_id, asked, owner).to_json())


@router.get("/api/jobs/{job_id}", responses=_MISSING)
def job(service: Serving, job_id: str) -> JobView:
    """State, progress, log, and the error in words."""
    return JobView.of(service.catalogue.job(job_id).to_json())


@router.post("/api/jobs/{job_id}/cancel", responses={**_MISSING, 409: {"model": Problem}})
def cancel(service: Serving, job_id: str) -> JobView:
    """End a job that waits or runs; nothing comes of it."""
    return JobView.of(service.jobs.cancel(job_id).to_json())


@router.post(
    "/api/jobs/{job_id}/rerun",
    status_code=202,
    responses={**_MISSING, 409: {"model": Problem}, 503: {"model": Problem}},
)
def rerun(service: Serving, job_id: str, request: Request, changes: JobChanges | None = None) -> JobView:
    """Queue a job once more, with other settings where the body names some; the first one stays as it is."""
    before = service.catalogue.job(job_id)
    changed = {} if changes is None else changes.model_dump(by_alias=True, exclude_unset=True)
    asked = {key: value for key, value in before.request.items() if key != "automatic"}
    try:
        wanted = JobRequest.model_validate({**asked, **changed, "kind": before.kind})
    except ValidationError as error:
        found = [{**one, "loc": ("body", *one["loc"])} for one in error.errors()]
        raise RequestValidationError(found) from error
    return start_job(service, before.flight_id, wanted, request)


@router.delete("/api/jobs/{job_id}", status_code=204, responses={**_MISSING, 409: {"model": Problem}})
def delete(service: Serving, job_id: str) -> None:
    """Forget a job that is over, with its result and its model."""
    service.jobs.delete(job_id)


@router.get("/api/flights/{flight_id}/identification", responses=_MISSING)
def identification(request: Request, service: Serving, flight_id: str, job: OfJob = None) -> dict[str, Any]:
    """Newest result of schema identification/1, or that of one job."""
    service.catalogue.flight(flight_id)
    return seen_by(request, service.catalogue.result(flight_id, "identify", job))


@router.get("/api/flights/{flight_id}/discrepancy", responses=_MISSING)
def discrepancy(request: Request, service: Serving, flight_id: str, job: OfJob = None) -> dict[str, Any]:
    """Newest result of schema discrepancy/1, or that of one job."""
    service.catalogue.flight(flight_id)
    return seen_by(request, service.catalogue.result(flight_id, "discrepancy", job))


@router.get("/api/flights/{flight_id}/design", responses=_MISSING)
def design(request: Request, service: Serving, flight_id: str, job: OfJob = None) -> dict[str, Any]:
    """The newest plan of a next flight, of schema design/1, or that of one job; its forms for a board stand in it."""
    service.catalogue.flight(flight_id)
    return seen_by(request, service.catalogue.result(flight_id, "design", job))


@router.post("/api/flights/{flight_id}/design/upload", responses={**_MISSING, 409: {"model": Problem}})
def upload_design(service: Serving, flight_id: str, job: OfJob = None) -> PlanUpload:
    """Write the plan's script to the card of the flight's vehicle, which must be on, on the ground, and run ArduPilot.

    It is flown once the board has been started anew, armed, with the switch that the script names.
    """
    flight = service.catalogue.flight(flight_id)
    script = service.catalogue.result(flight_id, "design", job)["files"].get("plan.lua")
    if script is None:
        raise JobError("no script was made for ArduPilot; the plan's warnings say why")
    if flight.system is None:
        raise JobError(f"flight {flight_id} holds no message of a vehicle")
    content = script.encode()
    service.recorder.put_file(flight.system, _SCRIPT, content, flight.board)
    return PlanUpload(system=flight.system, path=_SCRIPT, bytes=len(content))


@router.get("/api/flights/{flight_id}/report", response_class=HTMLResponse, responses=_MISSING)
def report(
    request: Request,
    service: Serving,
    flight_id: str,
    of: Annotated[Literal["identification", "discrepancy"], Query(description="Which result")] = "identification",
    job: OfJob = None,
) -> HTMLResponse:
    """The newest result, or one job's, as one page to read, print and keep: style and figures inside, no scripts."""
    service.catalogue.flight(flight_id)
    result = seen_by(request, service.catalogue.result(flight_id, _KINDS[of], job))
    return HTMLResponse(service.reports.page(result), headers={"Content-Security-Policy": _PAGE_POLICY})


@router.get("/api/models")
def models(service: Serving) -> list[ModelItem]:
    """Every identified model, newest first."""
    return [ModelItem.model_validate(entry) for entry in service.catalogue.models()]


@router.get("/api/models/{model_id}", responses=_MISSING)
def model(service: Serving, model_id: str) -> dict[str, Any]:
    """A model of schema model/1, as `--model` and `--prior` read it."""
    return service.catalogue.model(model_id)


@router.get(
    "/api/models/{model_id}/export",
    response_class=Response,
    responses={**_MISSING, 409: {"model": Problem}, 200: {"content": {"application/octet-stream": {}}}},
)
def export_model(
    service: Serving,
    model_id: str,
    to: Annotated[
        Literal["jsbsim", "gazebo", "daveml", "csv", "latex"],
        Query(description="For which program; all but daveml and latex as ZIP archive"),
    ],
) -> Response:
    """The model in the form of another program, as `gcs export-model` writes it."""
    entries = service.catalogue.model(model_id)
    vehicle = service.jobs.aircraft_of(service.catalogue.job(service.catalogue.job_of_model(model_id)))
    content, name = archived(Exported(model_from_json(entries), vehicle), to, f"model-{model_id}")
    given = {"Content-Disposition": f'attachment; filename="{name}"'}
    return Response(content, media_type="application/octet-stream", headers=given)
