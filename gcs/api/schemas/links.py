"""Links, and who is heard on them."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field


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
