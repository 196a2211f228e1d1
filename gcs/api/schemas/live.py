"""What an aircraft does now."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from gcs.api.schemas.links import LinkStatus


class LiveSignal(BaseModel):
    """The newest value of one signal."""

    value: float
    unit: str
    age_s: float = Field(description="Since its message was received")


class LiveProcess(BaseModel):
    """The process that identifies while the aircraft flies."""

    state: Literal["starting", "running", "failed"]
    problem: str
    restarts: int
    dropped_bytes: int = Field(description="Bytes it had no time for; they are recorded all the same")


class Live(BaseModel):
    """What the aircraft does now, and what is known of it."""

    model_config = ConfigDict(populate_by_name=True)

    schema_: Literal["live/1"] = Field(alias="schema")
    flight: str | None = Field(description="Id of the recording being made")
    time_s: float | None = Field(description="Newest time of the flight, s since its first message")
    vehicle: str | None
    landed: str | None = Field(description="The flight whose vehicle was disarmed last, while nobody flies")
    silent: str | None = Field(
        description="The flight that ended last, by silence of an armed vehicle, while nobody flies"
    )
    state: Literal["waiting", "live", "lost"] = Field(description="lost: no message for 2 s")
    signals: dict[str, LiveSignal]
    status: dict[str, Any] = Field(
        description="Mode, armed, battery, GPS, ground_speed (m/s), position (m north and east of home), home, wind and"
        " texts, as they came"
    )
    track: list[tuple[float, float]] = Field(description="Where it has been, m north and east of home")
    links: list[LinkStatus]
    identification: dict[str, Any] | None
    events: list[dict[str, Any]] = Field(description="What has failed or changed in flight, sensors first")
    why: str | None = Field(description="Why there is no identification")
    process: LiveProcess


class NoteText(BaseModel):
    """What is noted in flight."""

    model_config = ConfigDict(str_strip_whitespace=True)

    text: str = Field(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]+$")


class NoteMade(BaseModel):
    """A note, and the flights that it is kept in."""

    text: str
    flights: list[str]


class Minute(BaseModel):
    """The last minute of the flight that is followed, five times a second."""

    flight: str | None = Field(description="Id of the recording; null where none is made")
    time_s: list[float] = Field(description="Time of the flight, s since its first message")
    signals: dict[str, list[float | None]] = Field(description="As many values of each, null where it had none")
