"""The messages of one vehicle's flight: whose they are, each once, and when they were made."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gcs.clock.stamps import Stamps, VehicleClock, build_clock
from gcs.clock.timesync import own_replies
from gcs.errors import SignalMapError
from gcs.flights.sender import AUTOPILOT_INVALID, GCS, GENERIC, Sender
from gcs.flights.signal_sources import INSTANCE_FIELDS

Array = NDArray[np.float64]
Records = NDArray[Any]

MAV_AUTOPILOT_ARDUPILOT = 3
AUTOPILOT_COMPONENT = 1
# Messages that say how the vehicle is, measured or not.
OF_STATE = ("HEARTBEAT", "EXTENDED_SYS_STATE")
STAMP_FIELDS = {"time_usec": 1_000, "time_boot_ms": 1_000_000}


class Columns(Protocol):
    """One message of one component as the recording gives it: (N,) arrays in order of reception."""

    @property
    def name(self) -> str: ...
    @property
    def system(self) -> int: ...
    @property
    def component(self) -> int: ...
    @property
    def log_time(self) -> NDArray[np.int64]: ...
    @property
    def fields(self) -> Records: ...


class ColumnSource(Protocol):
    """What is needed of a recording."""

    @property
    def path(self) -> Path: ...
    def metadata(self) -> dict[str, dict[str, str]]: ...
    def columns(
        self, message_name: str, system: int | None = None, component: int | None = None
    ) -> Sequence[Columns]: ...
    def release(self) -> None: ...


@dataclass(frozen=True)
class Stream:
    """One message of one component of the vehicle, each message once.

    log_ns: (N,) reception. records: (N,) structured array, field names in lower case.
    time_s: (N,) seconds from the flight's first stamp, once the clock is known.
    """

    message: str
    component: int
    log_ns: NDArray[np.int64]
    records: Records
    time_s: Array = field(default_factory=lambda: np.empty(0))

    @property
    def stamps(self) -> Stamps:
        """The messages' own stamps; 0 where they have none."""
        for name, unit_ns in STAMP_FIELDS.items():
            if name in (self.records.dtype.names or ()):
                raw = self.records[name]
                # A stamp that cannot be held in ns (after the year 2262) is none.
                known = raw < np.iinfo(np.int64).max // unit_ns
                ns = np.where(known, raw, 0).astype(np.int64) * unit_ns
                period = 2**32 * unit_ns if raw.dtype.itemsize == 4 else 0
                return Stamps(self.message, self.component, self.log_ns, ns, period)
        return Stamps(self.message, self.component, self.log_ns, np.zeros(self.log_ns.size, np.int64))

    def values(self, name: str) -> Array:
        """(N,) float64 of a field, or of an element as "data[3]". KeyError where there is none."""
        base, _, rest = name.partition("[")
        try:
            column = self.records[base]
        except (ValueError, IndexError):  # as numpy says it
            raise KeyError(name) from None
        if (column.ndim == 2) != bool(rest):
            raise KeyError(name)
        if rest:
            index = int(rest.rstrip("]"))
            if index >= column.shape[1]:
                raise KeyError(name)
            column = column[:, index]
        return np.asarray(column, dtype=np.float64)

    def named(self, name: str) -> Stream:
        """The messages whose `name` field says `name`."""
        wanted = np.zeros(self.records["name"].shape[1], np.uint8)
        text = name.encode()[: wanted.size]
        wanted[: len(text)] = np.frombuffer(text, np.uint8)
        column = self.records["name"]
        # Whatever follows the first zero is not part of the name.
        ended = np.cumsum(column == 0, axis=1) > 0
        return self.only(np.all(np.where(ended, 0, column) == wanted, axis=1))

    def only(self, keep: NDArray[np.bool_] | NDArray[np.intp]) -> Stream:
        """The messages chosen by a mask, or by their places."""
        time_s = self.time_s[keep] if self.time_s.size else self.time_s
        return Stream(self.message, self.component, self.log_ns[keep], self.records[keep], time_s)


@dataclass
class VehicleStreams:
    """All needed messages of one system, and the clock they are on."""

    sender: Sender
    streams: dict[str, list[Stream]]
    clock: VehicleClock
    warnings: list[str] = field(default_factory=list)

    @property
    def duration_s(self) -> float:
        """Seconds from the first to the last stamp. Messages of state go on where nothing is measured any more."""
        times = [s.time_s for name, group in self.streams.items() if name not in OF_STATE for s in group]
        return float(max((t.max() for t in times if t.size), default=0.0))


def sender_of(recording: ColumnSource, system: int | None) -> Sender:
    """The vehicle that sent a recording, as its HEARTBEAT says.

    Raises SignalMapError where several vehicles or none are in the recording, or `system` is not.
    """
    found = _senders(recording, system)
    if system is not None:
        if system in found:
            return found[system]
        # A log without any HEARTBEAT is that of the system that is named.
        heard = {c.system for c in recording.columns("HEARTBEAT") if c.fields.size}
        if heard and system not in heard:
            raise SignalMapError(
                f"{recording.path.stem}: no system {system}; vehicles in it: {_list(_senders(recording, None))}"
            )
        return Sender(system, GENERIC, AUTOPILOT_INVALID)
    flying = {number: one for number, one in found.items() if one.autopilot != AUTOPILOT_INVALID}
    candidates = flying or found
    if len(candidates) == 1:
        return next(iter(candidates.values()))
    if not candidates:
        advice = "where it holds telemetry at all, name the vehicle (--system N)"
        raise SignalMapError(f"{recording.path.stem}: no vehicle's HEARTBEAT in it: {advice}")
    raise SignalMapError(f"{recording.path.stem}: several vehicles, {_list(candidates)}; choose one with --system N")


def _senders(recording: ColumnSource, system: int | None) -> dict[int, Sender]:
    """The vehicles whose HEARTBEAT is in a recording, or the one that is named: others may be very many."""
    found: dict[int, Sender] = {}
    for columns in recording.columns("HEARTBEAT", system=system):
        if columns.fields.size == 0 or np.all(columns.fields["type"] == GCS):
            continue
        last = columns.fields[-1]
        # Cameras, gimbals and companion computers say "no autopilot"; the one that flies counts.
        if last["autopilot"] != AUTOPILOT_INVALID or columns.system not in found:
            found[columns.system] = Sender(columns.system, int(last["type"]), int(last["autopilot"]))
    return found


def _list(systems: Iterable[int]) -> str:
    return ", ".join(str(number) for number in sorted(systems)) or "none"


def load_streams(recording: ColumnSource, messages: Iterable[str], system: int | None = None) -> VehicleStreams:
    """Every message of `messages` that the vehicle sent during its (longest) flight, and the flight's clock."""
    sender = sender_of(recording, system)
    number = sender.system
    streams: dict[str, list[Stream]] = {}
    for message in dict.fromkeys(messages):
        columns = [entry for entry in recording.columns(message, system=number) if entry.fields.size]
        columns.sort(key=lambda entry: (entry.component != AUTOPILOT_COMPONENT, entry.component))
        streams[message] = [once(Stream(message, c.component, c.log_time, c.fields)) for c in columns]
    pairs = _system_time(streams.get("SYSTEM_TIME", []))
    stamped = [stream.stamps for group in streams.values() for stream in group if stream.message != "SYSTEM_TIME"]
    replies = [entry for entry in recording.columns("TIMESYNC", system=number) if entry.fields.size]
    if not any(entry.valid.any() for entry in stamped):
        others = [*(stream.stamps for stream in streams.get("SYSTEM_TIME", [])), *map(_reply_stamps, replies)]
        stamped = [*stamped, *others]
    recording.release()
    clock = build_clock(stamped, pairs)
    for message, group in streams.items():
        inside = [_instance(stream.only(clock.inside(stream.log_ns))) for stream in group]
        streams[message] = [replace(stream, time_s=clock.seconds(stream.stamps)) for stream in inside]
    return VehicleStreams(sender, streams, clock, list(clock.warnings))


def _system_time(streams: Sequence[Stream]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]] | None:
    if not streams:
        return None
    records = streams[0].records
    unix_us = np.minimum(records["time_unix_usec"], np.uint64(2**62 // 1000)).astype(np.int64)
    return streams[0].log_ns, unix_us * 1_000, records["time_boot_ms"].astype(np.int64) * 1_000_000


def _reply_stamps(columns: Columns) -> Stamps:
    """The vehicle's time in its replies to this station, for a vehicle whose other messages carry none."""
    own = own_replies(columns.log_time, columns.fields["tc1"], columns.fields["ts1"])
    return Stamps("TIMESYNC", columns.component, columns.log_time[own], columns.fields["tc1"][own])


def _instance(stream: Stream) -> Stream:
    """Only the lowest of several instances (a second IMU, a second servo port) in one message."""
    name = INSTANCE_FIELDS.get(stream.message)
    if name is None or name not in (stream.records.dtype.names or ()) or stream.records.size == 0:
        return stream
    instance = stream.records[name]
    return stream.only(np.asarray(instance == instance.min()))


def once(stream: Stream) -> Stream:
    """A stream without exact repetitions of a stamped message.

    The recording drops what a second link repeats frame by frame; a vehicle that numbers each link's frames by itself
    sends the same message as two different frames, which only stamp and content show.
    """
    stamps = stream.stamps
    raw = stamps.raw_ns
    order = np.argsort(raw, kind="stable")
    same = raw[order][1:] == raw[order][:-1]
    shared = np.zeros(raw.size, bool)
    shared[order[1:]] |= same
    shared[order[:-1]] |= same
    places = np.flatnonzero(shared & stamps.valid)
    if places.size == 0:
        return stream
    _, first = np.unique(_packed(stream.records[places]), return_index=True)
    keep = np.ones(raw.size, bool)
    keep[places] = False
    keep[places[first]] = True
    return stream.only(keep)


def _packed(records: Records) -> NDArray[np.void]:
    """Each record as one opaque value, padding between fields left out."""
    parts = [
        np.ascontiguousarray(records[name]).view(np.uint8).reshape(records.size, -1)
        for name in records.dtype.names or ()
    ]
    joined = np.ascontiguousarray(np.concatenate(parts, axis=1))
    return joined.view(np.dtype((np.void, joined.shape[1]))).ravel()
