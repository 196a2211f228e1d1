"""Health and links."""

from __future__ import annotations

import shutil
import time

from fastapi import APIRouter, HTTPException
from fastapi.responses import Response

from gcs.api.schemas.links import LinkStatus
from gcs.api.schemas.problem import Problem
from gcs.api.schemas.station import Forwarding, Health, Map, MapAnswer
from gcs.api.service import Serving, Watched
from gcs.version import VERSION

router = APIRouter(tags=["state"])


@router.get("/api/health")
async def health(service: Serving) -> Health:
    """Whether the service records: links, disk, version. Needs no token."""
    # It waits for nothing and needs no thread, so that it answers whatever others ask for.
    links = service.recorder.links
    state = service.recorder.state
    parts: tuple[Watched, ...] = (service.recorder, service.catalogue, service.jobs, *service.others)
    problem = next((part.problem for part in parts if part.problem), "")
    forwarding = service.recorder.forwarding()
    disk = shutil.disk_usage(service.settings.data)
    return Health(
        status="degraded" if problem else "ok",
        version=VERSION,
        uptime_s=time.monotonic() - service.started,
        links_connected=sum(link.connected for link in links),
        links_total=len(links),
        disk_free_bytes=disk.free,
        disk_total_bytes=disk.total,
        recording=service.recorder.live_flights(),
        unrecorded_bytes=state.unrecorded_bytes,
        forwarding=None if forwarding is None else Forwarding.model_validate(forwarding),
        problem=problem,
    )


@router.get("/api/links")
def links(service: Serving) -> list[LinkStatus]:
    """Every link: rates, losses, checksum failures, and the systems heard on it with their clocks."""
    return [LinkStatus.model_validate(status) for status in service.recorder.link_status()]


@router.get("/api/map")
def map_tiles(service: Serving) -> MapAnswer:
    """The map that the service was started with (`--map`), null where it was started without one."""
    tiles = service.map
    if tiles is None:
        return MapAnswer(map=None)
    return MapAnswer(map=Map(least_zoom=tiles.least_zoom, most_zoom=tiles.most_zoom, attribution=tiles.attribution))


@router.get(
    "/api/map/{zoom}/{column}/{row}",
    response_class=Response,
    responses={200: {"content": {"image/*": {}}, "description": "a picture"}, 404: {"model": Problem}},
)
def map_tile(service: Serving, zoom: int, column: int, row: int) -> Response:
    """A tile of the map: Web Mercator, rows counted from the north."""
    found = None if service.map is None else service.map.tile(zoom, column, row)
    if service.map is None or found is None:
        raise HTTPException(404, "the map has no such tile")
    return Response(found, media_type=service.map.kind, headers={"Cache-Control": "no-cache"})
