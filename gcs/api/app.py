"""The application: everything it needs is handed in, nothing is opened on import."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager

from fastapi import FastAPI
from fastapi_offline import FastAPIOffline

from gcs.api import problems
from gcs.api.access import router as access_router
from gcs.api.bodies import BodyLimit
from gcs.api.description import describe
from gcs.api.flights import router as flights_router
from gcs.api.jobs import router as jobs_router
from gcs.api.live import router as live_router
from gcs.api.metrics import router as metrics_router
from gcs.api.page import router as page_router
from gcs.api.readiness import router as readiness_router
from gcs.api.request_ids import RequestIds
from gcs.api.security import DESCRIPTION_FILES, Access, Guard
from gcs.api.service import Service, Watched
from gcs.api.sheets import router as sheets_router
from gcs.api.status import router as status_router
from gcs.api.vehicles import router as vehicles_router
from gcs.catalogue.store import Catalogue
from gcs.jobs.flightviews import FlightViews
from gcs.jobs.runner import JobRunner
from gcs.live.feed import LiveFeed
from gcs.settings import Settings
from gcs.station.station import RecordingStation
from gcs.version import VERSION


def create_app(
    settings: Settings,
    catalogue: Catalogue,
    recorder: RecordingStation,
    jobs: JobRunner,
    others: Sequence[Watched] = (),
    live: LiveFeed | None = None,
    views: FlightViews | None = None,
) -> FastAPI:
    """The REST application. Starting it starts recorder and jobs, stopping it stops both and closes the catalogue.

    others: further parts whose trouble /api/health reports. live: what flies now; None makes one that nobody feeds.
    views: flights for plots; None makes them.
    """

    feed = live or LiveFeed(settings, recorder.live_vehicles)
    seen = views or FlightViews(settings, vehicle_of=jobs.choice.file_of, outlined=catalogue.put_outline)
    service = Service(settings, catalogue, recorder, jobs, time.monotonic(), others, feed, seen)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        threading.Thread(target=catalogue.examine, name="catalogue", daemon=True).start()
        jobs.start()
        if live is not None:
            live.start()
        recorder.start()
        watching = asyncio.create_task(service.minute.follow(feed))
        try:
            yield
        finally:
            watching.cancel()
            service.stop()
            app.state.access.audit.close()
            feed.stop()
            recorder.stop()
            jobs.stop()
            catalogue.close()
            if service.map is not None:
                service.map.close()

    app = FastAPIOffline(  # its /docs takes no script from another site: a field has no network
        title="Ground station",
        version=VERSION,
        description="Flights recorded from MAVLink telemetry, and the flight models identified from them.",
        lifespan=lifespan,
        redoc_url=None,
        static_url=DESCRIPTION_FILES,
    )
    app.state.service = service
    app.add_middleware(BodyLimit)
    app.state.access = Access(settings)
    app.add_middleware(Guard, access=app.state.access)
    app.add_middleware(RequestIds)  # the last one added is asked first
    problems.install(app)
    describe(app)
    for router in (
        status_router,
        access_router,
        readiness_router,
        metrics_router,
        live_router,
        flights_router,
        jobs_router,
        sheets_router,
        vehicles_router,
        page_router,
    ):
        app.include_router(router)
    return app
