"""Jobs, their results, and models."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from gcs.api.schemas import JobRequest, JobView, ModelItem, Problem
from gcs.api.service import Serving

router = APIRouter(tags=["estimation"])

_MISSING: dict[int | str, dict[str, Any]] = {404: {"model": Problem}}


@router.post("/api/flights/{flight_id}/jobs", status_code=202, responses={**_MISSING, 409: {"model": Problem}})
def start_job(service: Serving, flight_id: str, request: JobRequest) -> JobView:
    """Queue an identification or a discrepancy analysis."""
    wanted = request.model_dump(by_alias=True, exclude_none=True)
    return JobView.model_validate(service.jobs.submit(flight_id, wanted).to_json())


@router.get("/api/jobs/{job_id}", responses=_MISSING)
def job(service: Serving, job_id: str) -> JobView:
    """State, progress, log, and the error in words."""
    return JobView.model_validate(service.catalogue.job(job_id).to_json())


@router.get("/api/flights/{flight_id}/identification", responses=_MISSING)
def identification(service: Serving, flight_id: str) -> dict[str, Any]:
    """Newest result of schema identification/1."""
    service.catalogue.flight(flight_id)
    return service.catalogue.result(flight_id, "identify")


@router.get("/api/flights/{flight_id}/discrepancy", responses=_MISSING)
def discrepancy(service: Serving, flight_id: str) -> dict[str, Any]:
    """Newest result of schema discrepancy/1."""
    service.catalogue.flight(flight_id)
    return service.catalogue.result(flight_id, "discrepancy")


@router.get("/api/models")
def models(service: Serving) -> list[ModelItem]:
    """Every identified model, newest first."""
    return [ModelItem.model_validate(entry) for entry in service.catalogue.models()]


@router.get("/api/models/{model_id}", responses=_MISSING)
def model(service: Serving, model_id: str) -> dict[str, Any]:
    """A model of schema model/1, as `--model` and `--prior` read it."""
    return service.catalogue.model(model_id)
