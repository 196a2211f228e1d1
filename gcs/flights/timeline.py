"""What happened in a flight, and any field of any message, on the clock of the flight's signals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray
from pymavlink import mavutil

from gcs.flights.streams import ColumnSource, Stream, VehicleStreams, once

Array = NDArray[np.float64]

ARMED, _CUSTOM = 0x80, 0x01  # MAV_MODE_FLAG_SAFETY_ARMED, _CUSTOM_MODE_ENABLED
_FLAGS = {0x04: "AUTO", 0x08: "GUIDED", 0x10: "STABILIZE", 0x40: "MANUAL"}
# Elements of an array field that are handed out, and texts of a flight.
_MOST_ELEMENTS, _MOST_TEXTS, _MOST_MODES = 16, 300, 300
#: How a text begins that somebody noted in flight, and the system that says so: this station.
NOTE, _STATION = "note: ", 255


@dataclass(frozen=True)
class ModePart:
    """A stretch in one mode of the autopilot, s; its name as ground stations of that autopilot show it."""

    start: float
    end: float
    mode: str
    armed: bool


@dataclass(frozen=True)
class Said:
    """A text (STATUSTEXT): when, s, how severe (0 emergency to 7 debug), what, and whether it is a note that somebody
    made at this station.
    """

    time: float
    severity: int
    text: str
    note: bool = False


@dataclass(frozen=True)
class RawField:
    """One field of one message as it was sent. component: whose, where several components send it."""

    name: str
    time_s: Array
    values: Array


def modes(recording: ColumnSource, streams: VehicleStreams) -> list[ModePart]:
    """Modes of the autopilot, one after the other, by its HEARTBEAT."""
    beats = next(_clocked(recording, streams, "HEARTBEAT"), None)
    if beats is None:
        return []
    keys = [beats.records[name].astype(np.int64) for name in ("custom_mode", "base_mode", "type", "autopilot")]
    changed = np.flatnonzero(np.any([np.diff(key) != 0 for key in keys], axis=0)) + 1
    firsts = [0, *changed.tolist()][:_MOST_MODES]
    ends = [*(float(beats.time_s[first]) for first in firsts[1:]), streams.duration_s]
    found: list[ModePart] = []
    for first, end in zip(firsts, ends, strict=True):
        custom, base, kind, autopilot = (int(key[first]) for key in keys)
        words = mode_name(custom, base, kind, autopilot)
        part = ModePart(max(float(beats.time_s[first]), 0.0), end, words, bool(base & ARMED))
        if found and (found[-1].mode, found[-1].armed) == (part.mode, part.armed):
            found[-1] = replace(found[-1], end=end)
        else:
            found.append(part)
    return found


def mode_name(custom: int, base: int, kind: int, autopilot: int) -> str:
    """A mode's name: by its number where the autopilot has numbers of its own, else by the flags of MAV_MODE_FLAG."""
    if not base & _CUSTOM and autopilot != mavutil.mavlink.MAV_AUTOPILOT_PX4:
        return next((name for flag, name in _FLAGS.items() if base & flag), "PREFLIGHT")
    beat = SimpleNamespace(custom_mode=custom, base_mode=base, type=kind, autopilot=autopilot)
    beat.get_type = lambda: "HEARTBEAT"
    return str(mavutil.mode_string_v10(beat))


def text_of(row: np.void) -> tuple[str, int | None]:
    """The text of a STATUSTEXT, and which piece of a longer one it is, None where it is whole."""
    text = bytes(row["text"]).split(b"\0")[0].decode("utf-8", "replace")
    pieces = "id" in (row.dtype.names or ()) and int(row["id"])
    return text, int(row["chunk_seq"]) if pieces else None


def texts(recording: ColumnSource, streams: VehicleStreams) -> list[Said]:
    """What the vehicle said and what was noted here, in order; one text in several chunks is one."""
    notes = [replace(one, note=True) for one in _said(recording, streams, _STATION) if one.text.startswith(NOTE)]
    said = _said(recording, streams, streams.sender.system)
    return sorted([*said, *(replace(one, text=one.text.removeprefix(NOTE)) for one in notes)], key=lambda one: one.time)


def _said(recording: ColumnSource, streams: VehicleStreams, system: int) -> list[Said]:
    found: list[Said] = []
    for stream in _clocked(recording, streams, "STATUSTEXT", system):
        parts: dict[int, int] = {}
        for row, time in zip(stream.records, stream.time_s.tolist(), strict=True):
            text, piece = text_of(row)
            number = int(row["id"]) if "id" in (stream.records.dtype.names or ()) else 0
            if piece and number in parts:
                before = found[parts[number]]
                found[parts[number]] = replace(before, text=before.text + text)
                continue
            if len(found) == _MOST_TEXTS:
                break
            parts[number] = len(found)
            found.append(Said(time, int(row["severity"]), text))
    return found


def raw_fields(recording: ColumnSource, streams: VehicleStreams, message: str) -> list[RawField]:
    """Every number of a message as it was sent, an array's elements one by one; none of a message that is not there."""
    stream = next(_clocked(recording, streams, message), None)  # the autopilot's own, where others send it too
    if stream is None:
        return []
    order = np.argsort(stream.time_s, kind="stable")
    time = stream.time_s[order]
    return [RawField(f"{message}.{name}", time, stream.values(name)[order]) for name in _numeric(stream)]


def _numeric(stream: Stream) -> Iterator[str]:
    for name in stream.records.dtype.names or ():
        column = stream.records[name]
        yield from array_elements(name, 0 if column.ndim == 1 else column.shape[1])


def array_elements(name: str, count: int) -> list[str]:
    """Names of a field's numbers: its own, or those of an array's first elements. count: 0 for no array."""
    return [f"{name}[{i}]" for i in range(min(count, _MOST_ELEMENTS))] if count else [name]


def _clocked(
    recording: ColumnSource, streams: VehicleStreams, message: str, system: int | None = None
) -> Iterator[Stream]:
    """The vehicle's messages of that name, or another system's, within the flight, on the vehicle's clock; the
    autopilot's component first.
    """
    columns = [one for one in recording.columns(message, system=system or streams.sender.system) if one.fields.size]
    for one in sorted(columns, key=lambda entry: (entry.component != 1, entry.component)):
        stream = once(Stream(message, one.component, one.log_time, one.fields))
        inside = stream.only(streams.clock.inside(stream.log_ns))
        if inside.log_ns.size:
            yield replace(inside, time_s=streams.clock.seconds(inside.stamps))
