"""Whether the service can do its work now: what a supervisor, a proxy or a container's health check asks."""

from __future__ import annotations

import asyncio

from fastapi import APIRouter
from fastapi.responses import Response

from gcs.api.problems import problem_response
from gcs.api.schemas.station import NotReady, Ready, ReadyLink
from gcs.api.service import Service, Serving
from gcs.errors import CatalogueFileError
from gcs.station.station import LinkState

router = APIRouter(tags=["state"])

# How long the catalogue may take to answer, s.
_PATIENCE_S = 2.0


@router.get("/api/ready", response_model=Ready, responses={503: {"model": NotReady, "description": "Not ready"}})
async def ready(service: Serving) -> Ready | Response:
    """Whether catalogue, recorder, jobs and all links are up; 503 with a list of what is not. Needs no token."""
    links = service.recorder.link_states()
    missing = [*await _catalogue(service), *_recorder(service), *_jobs(service), *_links(links)]
    shown = [ReadyLink(url=one.name, role=one.role, up=one.up, problem=one.problem) for one in links]
    if not missing:
        return Ready(ready=True, links=shown)
    more = {"not_ready": missing, "links": [one.model_dump() for one in shown]}
    return problem_response(503, f"not ready: {'; '.join(missing)}", more=more)


async def _catalogue(service: Service) -> list[str]:
    """Asked in a thread that requests do not take, since the disk may make it wait."""
    try:
        await asyncio.wait_for(asyncio.to_thread(service.catalogue.check), _PATIENCE_S)
    except TimeoutError:
        return [f"catalogue: no answer within {_PATIENCE_S:g} s"]
    except CatalogueFileError as error:
        return [f"catalogue: {error}"]
    return [f"catalogue: {problem}"] if (problem := service.catalogue.problem) else []


def _recorder(service: Service) -> list[str]:
    if not service.recorder.alive:
        return ["recorder: one of its threads has ended, or keeps no time any more; start the service again"]
    return [f"recorder: {service.recorder.state.problem}"] if service.recorder.state.problem else []


def _jobs(service: Service) -> list[str]:
    if not service.jobs.alive:
        return ["jobs: their thread has ended; start the service again"]
    return [f"jobs: {service.jobs.problem}"] if service.jobs.problem else []


def _links(links: list[LinkState]) -> list[str]:
    return [f"link {one.name}: {one.problem or 'not connected yet'}" for one in links if not one.up]
