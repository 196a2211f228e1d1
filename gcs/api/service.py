"""What the handlers work with."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Protocol, cast

from fastapi import Depends, Request

from gcs.api.last_minute import LastMinute
from gcs.catalogue.database import HASTY_S, PATIENCE
from gcs.catalogue.store import Catalogue
from gcs.formats.map_tiles import MapTiles
from gcs.jobs.drafts import Drafts
from gcs.jobs.flightviews import FlightViews
from gcs.jobs.places import Places
from gcs.jobs.reports import Reports
from gcs.jobs.runner import JobRunner
from gcs.jobs.uploads import Uploads
from gcs.live.feed import LiveFeed
from gcs.settings import Settings
from gcs.station.station import RecordingStation

# Who follow the flight by events, and how many of them may be one; each has a connection for as long as it likes, of
# which others need some.
_MOST_FOLLOWING = (64, 8)
# Recordings that are fetched at a time, and by one: pieces of each are read by threads that all requests share.
_MOST_FETCHED = (32, 16)


class Watched(Protocol):
    """A part that says in words what goes wrong in it, nothing when all is well."""

    @property
    def problem(self) -> str: ...


@dataclass
class Service:
    """The parts of the running service. started: monotonic time of its start, s. others: what else may have trouble.

    live: the flight as it is now; minute: as it was streamed over the last minute; views: recordings, for plots.
    following: those who follow the stream of events. fetching: those who fetch recordings. stopping: set once the
    service is to end. map: what lies beneath the track.
    """

    settings: Settings
    catalogue: Catalogue
    recorder: RecordingStation
    jobs: JobRunner
    started: float
    others: Sequence[Watched]
    live: LiveFeed
    views: FlightViews
    uploads: Uploads = field(init=False)
    drafts: Drafts = field(init=False)
    reports: Reports = field(default_factory=Reports)
    minute: LastMinute = field(default_factory=LastMinute)
    following: Places = field(default_factory=lambda: Places(*_MOST_FOLLOWING, "streams are followed"))
    fetching: Places = field(default_factory=lambda: Places(*_MOST_FETCHED, "recordings are fetched"))
    stopping: asyncio.Event = field(default_factory=asyncio.Event)
    map: MapTiles | None = field(init=False)

    def __post_init__(self) -> None:
        self.uploads = Uploads(self.settings, self.catalogue)
        self.drafts = Drafts(self.settings)
        self.map = None if self.settings.map is None else MapTiles(self.settings.map)

    def stop(self) -> None:
        """Let nobody wait any longer for a file that comes or is read. To be called in the loop of events."""
        self.stopping.set()
        self.uploads.close()
        self.drafts.close()
        self.views.close()


async def _service(request: Request) -> Service:  # without a thread of its own, which there may be none for
    PATIENCE.set(HASTY_S)
    return cast(Service, request.app.state.service)


Serving = Annotated[Service, Depends(_service)]
