"""Flights of the catalogue."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from gcs.api.schemas.jobs import JobView


class Outcome(BaseModel):
    """How far the newest identification of a flight is, and what it says at a glance.

    state: of the newest job of that kind, null where there was none. verdict: of the newest result, with its reasons.
    """

    state: Literal["queued", "running", "done", "failed", "skipped", "cancelled"] | None
    verdict: Literal["good", "care", "poor"] | None
    text: str = Field(description="One sentence for a list")


class FlightNotesChange(BaseModel):
    """What a person says of a flight; what is left out stays as it is."""

    model_config = ConfigDict(extra="forbid")

    title: str | None = Field(None, max_length=200)
    comment: str | None = Field(None, max_length=20_000)
    tags: list[Annotated[str, Field(min_length=1, max_length=40)]] | None = Field(None, max_length=30)
    vehicle: str | None = Field(None, max_length=60, description="Id of an aircraft; empty: chosen by itself again")


class ChosenVehicle(BaseModel):
    """The aircraft of a flight and why it is that; `problem` says why there is none."""

    id: str | None
    name: str | None
    version: int | None
    by_hand: bool
    why: str
    problem: str


class Outline(BaseModel):
    """One signal of a flight, its height or else its airspeed, as means of even stretches."""

    name: str
    unit: str
    values: list[float | None]


class FlightItem(BaseModel):
    """One flight of the catalogue. Times are UTC."""

    id: str
    name: str
    source: Literal["live", "upload"]
    state: Literal["recording", "complete", "recovered"]
    system: int | None
    start: str
    end: str
    duration_s: float = Field(description="From the first to the last message received, by this computer's clock")
    vehicle_duration_s: float | None = Field(description="By the vehicle's clock, null where it does not give the time")
    messages: int
    bytes: int
    end_reason: str
    follows: str | None = Field(description="The flight that this is ground data behind, null for a flight")
    parts: int = Field(description="Files of the recording, more than one if it was split by size")
    recording_deleted: str | None = Field(description="When the recording was deleted to make room, null while kept")
    board: str | None = Field(
        description="A hash of the autopilot board's own number (AUTOPILOT_VERSION), null where it did not say it"
    )
    title: str = Field(description="What a person calls it, empty for none")
    comment: str
    tags: list[str]
    vehicle: str | None = Field(description="Id of the aircraft that was chosen by hand, null for none")
    outcome: Outcome = Field(description="What came of it so far")
    outline: Outline | None = Field(description="How it went, for a list; null before it has been read for plots")


class Uploaded(FlightItem):
    """The flight that an upload became."""

    note: str = Field(description="What to know of it, as that the same flight is there already; empty else")


class FlightPage(BaseModel):
    """Flights, newest first. `next` is the value of `after` for the page behind this one, null on the last."""

    flights: list[FlightItem]
    next: str | None


class FlightPart(BaseModel):
    """A part of a flight, s from its start."""

    start: float
    end: float


class ModeView(FlightPart):
    """A stretch in one mode of the autopilot."""

    mode: str
    armed: bool


class TextView(BaseModel):
    """A text of the vehicle, or a note made in flight; severity from 0 (emergency) to 7 (debug)."""

    time: float
    severity: int
    text: str
    note: bool = False


class FlightSummary(FlightItem):
    """What a flight holds."""

    topics: dict[str, int] = Field(description="Messages per topic")
    lost: int = Field(description="Frames missing in the senders' sequences")
    damage: list[str] = Field(description="Parts of the recording that cannot be read")
    signals: list[str] = Field(description="Names that GET …/signals accepts")
    fields: dict[str, list[str]] = Field(
        description="Messages of the vehicle with their numbers; GET …/signals accepts MESSAGE.field too"
    )
    modes: list[ModeView] = Field(description="Modes of the autopilot, one after the other")
    texts: list[TextView] = Field(description="What the vehicle said and what was noted")
    warnings: list[str]
    jobs: list[JobView] = Field(description="The newest 50; of a model that came with one its name alone")
    aircraft: ChosenVehicle
    used: list[FlightPart] = Field(description="Parts that the newest identification was made from")
    ground: list[FlightItem] = Field(description="What was recorded on the ground behind it, before the next flight")
