"""Health and links."""

from __future__ import annotations

import shutil
import time

from fastapi import APIRouter

from gcs.api.schemas import Forwarding, Health, LinkStatus
from gcs.api.service import Serving, Watched
from gcs.version import VERSION

router = APIRouter(tags=["state"])


@router.get("/api/health")
async def health(service: Serving) -> Health:
    """Whether the service records: links, disk, version. Needs no token."""
    # It waits for nothing and needs no thread, so that it answers whatever others ask for.
    links = service.recorder.links
    state = service.recorder.state
    parts: tuple[Watched, ...] = (service.recorder, service.jobs, *service.others)
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
