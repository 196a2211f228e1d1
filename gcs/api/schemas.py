"""Shapes of requests and answers: what OpenAPI describes is what the handlers give."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from gcs.analysis.flight_part import part_problem


class Problem(BaseModel):
    """An error (RFC 9457): `detail` is a sentence that says what to do."""

    type: str = "about:blank"
    title: str
    status: int
    detail: str
    request_id: str = Field("", description="The id of the request, as in X-Request-ID and the log")


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


class ComponentStatus(BaseModel):
    """One sender on a link."""

    component: int
    received: int
    duplicates: int = Field(description="Frames that came a second time over this source")
    lost: int = Field(description="Frames missing in the sender's sequence")
    loss: float = Field(description="lost / (lost + received)")


class SystemStatus(BaseModel):
    """One system (vehicle or ground station) heard on a link."""

    system: int
    source: str = Field(description="The peer of the link that these frames came from")
    clock_offset_s: float | None = Field(
        description="Our UTC minus the vehicle's time since boot: by round trips where it answers TIMESYNC, else by"
        " arrivals, the smallest delay included"
    )
    clock_offset_std_s: float | None = Field(description="Standard error of the offset")
    clock_offset_bound_s: float | None = Field(
        description="By how much the offset may be wrong at most where the ways there and back take different times;"
        " null where there are no round trips"
    )
    clock_drift_ppm: float | None = Field(
        description="How much faster the vehicle's clock runs than ours; null where it does not fly in real time"
    )
    clock_drift_std_ppm: float | None = Field(description="Standard error of the drift")
    clock_rate: float | None = Field(description="Vehicle's seconds to one of ours: 5.0 for a simulation at 5 times")
    clock_resets: int = Field(description="Restarts of the vehicle's clock over this source")
    round_trip_s: float | None = Field(description="Median round trip by TIMESYNC")
    delay_s: float | None = Field(description="One way at the smallest round trip")
    jitter_s: float | None = Field(description="Mean change of the delay from message to message (RFC 3550)")
    components: list[ComponentStatus]


class SourceStatus(BaseModel):
    """One peer of a link."""

    source: str
    address: str
    bytes: int
    reads: int
    refused: int = Field(description="Bytes beyond what one peer may send")
    last_received_ns: int


class RadioStatus(BaseModel):
    """The last RADIO_STATUS (or RADIO) of a telemetry radio; `rem…` is its partner. Units are the radio's own."""

    system: int
    component: int
    received_ns: int
    rssi: int
    remrssi: int
    noise: int
    remnoise: int
    txbuf: int = Field(description="Free share of the radio's buffer, %")
    rxerrors: int
    fixed: int


class LinkStatus(BaseModel):
    """One link: its connection, what it carried and who speaks on it."""

    url: str
    role: Literal["vehicle", "forward"] = Field(description="Who is behind it: vehicles, or another ground station")
    connected: bool
    problem: str
    bytes: int
    reads: int
    dropped: int = Field(description="Datagrams for which the kernel had no room")
    refused: int = Field(description="Bytes that peers sent beyond what one of them may send")
    bytes_sent: int
    send_errors: int
    connections: int
    reconnects: int
    last_received_ns: int
    sources: list[SourceStatus]
    frames: int
    frames_per_s: float
    bytes_per_s: float
    raw_bytes: int = Field(description="Bytes that belong to no frame")
    bad_crc: int
    unknown_messages: int
    other_senders: int = Field(description="Frames of senders beyond the 256 that are accounted for one by one")
    signed_good: int
    signed_bad: int = Field(description="Wrong signature, or a stamp that does not increase")
    signed_replayed: int = Field(description="Those of signed_bad whose signature is right")
    signed_repeated: int = Field(description="Signature right; another link of the station had brought it before")
    signed_unverified: int = Field(description="Signed, but there is no key")
    unsigned: int
    radio: RadioStatus | None
    systems: list[SystemStatus]


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


class JobView(BaseModel):
    """A job. `progress` runs from 0 to 1; `error` says in words why it failed.

    One that nobody asked for is skipped where nothing airborne and excited is found; the end of its log says so.
    """

    id: str
    flight_id: str
    kind: Literal["identify", "discrepancy", "design"]
    request: dict[str, Any]
    state: Literal["queued", "running", "done", "failed", "skipped", "cancelled"]
    progress: float
    error: str | None
    attempts: int
    created_ns: int
    started_ns: int | None
    ended_ns: int | None
    owner: str = Field(description="Who asked for it: `station`, or the address of the client; empty where unknown")
    priority: int = Field(description="0: queued by the station itself; a person's jobs (1) come first")
    cpu_s: float | None = Field(description="Processor time that it took; null before it has ended")
    peak_bytes: int | None = Field(description="The most memory that it took")
    log: list[str]
    report: str | None = Field(None, description="Once it is done: the address of the flight's newest result as a page")

    @classmethod
    def of(cls, job: dict[str, Any]) -> JobView:
        """The view of a job's own fields."""
        result = {"identify": "identification"}.get(job["kind"], job["kind"])
        address = f"/api/flights/{job['flight_id']}/report?of={result}"
        is_there = job["state"] == "done" and job["kind"] != "design"
        return cls.model_validate({**job, "report": address if is_there else None})


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
    jobs: list[JobView]
    aircraft: ChosenVehicle
    used: list[FlightPart] = Field(description="Parts that the newest identification was made from")
    ground: list[FlightItem] = Field(description="What was recorded on the ground behind it, before the next flight")


class Series(BaseModel):
    """One signal, decimated: of each stretch the smallest and the largest value are kept. Time in s from the start."""

    unit: str
    source: str
    time: list[float]
    value: list[float | None]


class Spectrum(BaseModel):
    """Power spectral density of one signal, one-sided, by Welch's method: value over frequency in Hz.

    Both are empty where the stretch has too few samples.
    """

    unit: str = Field(description="Of the density")
    signal_unit: str
    frequency: list[float]
    value: list[float]


class SpectraView(BaseModel):
    """Spectra of a flight's signals."""

    flight: str
    signals: dict[str, Spectrum]


class Spectrogram(BaseModel):
    """Power spectral density of one signal over time: a row of `value` for each frequency, in dB; null is no power.

    All are empty where the stretch has too few samples.
    """

    unit: str
    signal_unit: str
    time: list[float] = Field(description="Middles of the columns, s from the start of the flight, at even steps")
    frequency: list[float] = Field(description="Hz, at even steps")
    value: list[list[float | None]]


class SpectrogramsView(BaseModel):
    """Spectrograms of a flight's signals."""

    flight: str
    signals: dict[str, Spectrogram]


class PlanUpload(BaseModel):
    """A plan's script on a vehicle's card."""

    system: int
    path: str
    bytes: int


class PlannedCoefficient(BaseModel):
    """One coefficient: the standard error that the plan promised, and the one that the flight gave."""

    name: str
    expected_std: float | None
    reached_std: float | None = Field(description="null where the flight could not identify it")


class Planned(BaseModel):
    """The plan that was there when a flight began, beside what came of it."""

    flight: str = Field(description="The flight behind which it was planned")
    made: str = Field(description="When, UTC")
    gusts: float = Field(description="Turbulence that the plan counted on, m/s")
    coefficients: list[PlannedCoefficient]


class SignalsView(BaseModel):
    """Signals of a flight for plotting."""

    flight: str
    signals: dict[str, Series]


class JobChanges(BaseModel):
    """Settings of an estimation. A model is the id of one (GET /api/models) or the model itself as JSON."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)

    model: str | dict[str, Any] | None = Field(None, description="The model to be judged; discrepancy needs it")
    structure: str | dict[str, Any] | None = None
    prior: str | dict[str, Any] | None = None
    validate_: list[str] = Field(
        default_factory=list, alias="validate", max_length=50, description="Ids of flights to judge the result on"
    )
    rule_out: list[str] = Field(
        default_factory=list, max_length=50, description="Effects that a test on the ground has shown not to be there"
    )
    as_recorded: list[str] = Field(
        default_factory=list, max_length=50, description="Signals that are right as recorded, whatever seems"
    )
    method: Literal["auto", "map", "ee", "oe", "fe"] = "auto"
    from_: float | None = Field(None, alias="from", ge=0, description="Seconds from the start of the flight")
    to: float | None = Field(None, ge=0)
    system: int | None = Field(None, ge=1, le=255)
    vehicle: str | None = Field(
        None, max_length=80, description="An aircraft of the station, id or id@version; without it the flight's own"
    )

    manoeuvres: list[str] = Field(
        default_factory=list, max_length=20, description="Of a design; without them a multisine on all surfaces, tuned"
    )
    duration: float | None = Field(None, ge=4, le=3600, description="Of a design, s")
    gusts: float = Field(0.0, ge=0, le=20, description="Turbulence that a design expects, m/s")
    limits: dict[Literal["alpha", "beta", "bank", "pitch", "surface", "airspeed"], float] = Field(
        default_factory=dict, description="Of a design: degrees from trim, airspeed in per cent"
    )

    @model_validator(mode="after")
    def _part_in_order(self) -> Self:
        if problem := part_problem(self.from_, self.to):
            raise ValueError(problem)
        return self


class JobRequest(JobChanges):
    """An estimation to run, or a flight to plan."""

    kind: Literal["identify", "discrepancy", "design"]


class ModelItem(BaseModel):
    """One identified model. `verdict` and `effects` are a discrepancy's; null and empty for an identification."""

    id: str
    flight_id: str
    flight_name: str = Field(description="The file's name of an upload, else the flight's id")
    kind: Literal["identify", "discrepancy"]
    job_id: str
    name: str
    created_ns: int
    verdict: Literal["none", "parameter_error", "missing_effect", "unexplained"] | None
    effects: list[str] = Field(description="Names of the effects that were found missing and added")


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


class Map(BaseModel):
    """A map of tiles."""

    least_zoom: int
    most_zoom: int
    attribution: str = Field(description="Whose map it is, to be shown beside it")


class MapAnswer(BaseModel):
    """Whether there is a map."""

    map: Map | None


class Minute(BaseModel):
    """The last minute of the flight that is followed, five times a second."""

    flight: str | None = Field(description="Id of the recording; null where none is made")
    time_s: list[float] = Field(description="Time of the flight, s since its first message")
    signals: dict[str, list[float | None]] = Field(description="As many values of each, null where it had none")
