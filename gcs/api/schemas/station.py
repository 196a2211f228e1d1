"""The service itself: whether it can work, and what it passes on."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field

from gcs.api.schemas.problem import Problem


class ReadyLink(BaseModel):
    """Whether a link is up: bytes can flow, or it listens for peers."""

    url: str
    role: Literal["vehicle", "forward"] = Field(description="Who is behind it: vehicles, or another ground station")
    up: bool
    problem: str = Field(description="Why bytes cannot flow, empty where they can or nobody has come yet")


class Ready(BaseModel):
    """The service can do its work."""

    ready: Literal[True]
    links: list[ReadyLink]


class NotReady(Problem):
    """The service cannot do all of its work: `not_ready` has a sentence for each part that is not up."""

    not_ready: list[str]
    links: list[ReadyLink]


class Forwarding(BaseModel):
    """What was passed on between vehicles and other ground stations."""

    frames: int
    copies: int = Field(description="Frames held back, as the same had come by another way")
    dropped_bytes: int = Field(description="Bytes there was no time to pass on; they are recorded all the same")
    refused: int = Field(description="Frames that may not pass: by the link's options, or for want of a signature")


class Health(BaseModel):
    """State of the service. `problem` is empty when all is well."""

    status: Literal["ok", "degraded"]
    version: str
    uptime_s: float
    links_connected: int
    links_total: int
    disk_free_bytes: int
    disk_total_bytes: int
    recording: list[str] = Field(description="Ids of the flights being recorded now")
    unrecorded_bytes: int
    forwarding: Forwarding | None = Field(description="null where nothing is passed on")
    problem: str


class Map(BaseModel):
    """A map of tiles."""

    least_zoom: int
    most_zoom: int
    attribution: str = Field(description="Whose map it is, to be shown beside it")


class MapAnswer(BaseModel):
    """Whether there is a map."""

    map: Map | None
