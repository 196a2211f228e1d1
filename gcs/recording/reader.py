"""Reading recordings: columns of one message type in bulk, counts, losses, and each link's bytes as they came.

Whole files and files that were cut off read alike. What is damaged is left out, counted and named in
`Recording.damage`.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.records import Attachment
from numpy.typing import NDArray

from gcs.errors import RecordingError
from gcs.mavlink.cdr import Layout, parse_ros2msg
from gcs.mavlink.crc import CRC_TABLES
from gcs.recording import scan
from gcs.recording.build import RUN_NOISE, RUN_UNKNOWN
from gcs.recording.columns import MessageChannel, MessageColumns, Selection, iter_columns, joined, message_channel
from gcs.recording.container import Container, Damage, Group
from gcs.recording.joined import JoinedContainer
from gcs.recording.wire import WIRE_TOPIC, WireRecord, decode_wire

#: Uncompressed bytes of a file that are held at a time where it is read in parts.
STREAM_BYTES = 32 << 20
_LARGEST_FRAME = 10 + 255 + 2 + 13

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class WirePieces:
    """One link's bytes of one chunk: `data` in N pieces of (time ns, offset, length, kind).

    chunk: number of the chunk. kind: -1 a frame of known id, RUN_NOISE bytes of no frame, RUN_UNKNOWN a frame of
    unknown id.
    """

    chunk: int
    link: str
    data: Bytes
    pieces: Ints


class Recording:
    """One MCAP recording, opened for reading; of one that was split by size all parts, in order.

    RecordingError, in one line, if the file is missing, empty, no MCAP file, or cut off before its first message.
    """

    def __init__(self, path: str | os.PathLike[str] | Sequence[Path]) -> None:
        self._file = _open(path)
        self._layouts: dict[int, Layout] = {}
        self._channels = {}
        self._wire_channels: dict[int, str] = {}
        for channel in self._file.channels.values():
            message = message_channel(channel.id, channel.topic, channel.schema_id, channel.metadata)
            if message is not None:
                self._channels[channel.id] = message
            elif channel.topic == WIRE_TOPIC:
                self._wire_channels[channel.id] = channel.metadata.get("link", "")

    @property
    def path(self) -> Path:
        """The file."""
        return self._file.path

    @property
    def damage(self) -> Damage:
        """What could not be read; checks the whole file."""
        for _ in self._file.groups():
            pass
        self.attachments()
        return self._file.damage

    @property
    def start_ns(self) -> int:
        """UTC of the first reception, 0 in a recording without messages."""
        return min((chunk.start_ns for chunk in self._file.chunks if chunk.end_ns), default=0)

    @property
    def end_ns(self) -> int:
        """UTC of the last reception, 0 in a recording without messages."""
        return max((chunk.end_ns for chunk in self._file.chunks), default=0)

    @property
    def duration_s(self) -> float:
        """From the first to the last reception."""
        return (self.end_ns - self.start_ns) / 1e9

    @property
    def truncated(self) -> bool:
        """Whether the file has no end: it was cut off, or is still being written."""
        return self._file.damage.truncated

    def topics(self) -> tuple[str, ...]:
        """Topics of all MAVLink messages, in the order of first reception."""
        return tuple(dict.fromkeys(channel.topic for channel in self._channels.values()))

    def is_repeated(self, topic: str) -> bool:
        """Whether a topic came over several links, so that each of its messages may be there more than once."""
        return len({channel.link for channel in self._channels.values() if channel.topic == topic}) > 1

    def messages(self) -> tuple[str, ...]:
        """Names of all message types, sorted."""
        return tuple(sorted({channel.name for channel in self._channels.values()}))

    def links(self) -> tuple[str, ...]:
        """Names of the links that were recorded."""
        return tuple(dict.fromkeys(self._wire_channels.values()))

    def dialects(self) -> tuple[str, ...]:
        """Names of the MAVLink dialects that its channels name."""
        named = (channel.metadata.get("dialect", "") for channel in self._file.channels.values())
        return tuple(filter(None, dict.fromkeys(named)))

    def systems(self) -> tuple[tuple[int, int], ...]:
        """(system, component) of everything heard, sorted."""
        return tuple(sorted({(channel.system, channel.component) for channel in self._channels.values()}))

    def metadata(self) -> dict[str, dict[str, str]]:
        """Metadata by name; of several with one name the last."""
        return dict(self._file.metadata)

    def attachments(self) -> tuple[Attachment, ...]:
        """Files inside the recording whose checksums are right."""
        return tuple(self._file.attachments)

    def counts(self) -> dict[str, int]:
        """Messages of each topic, over all links."""
        per_channel = self._file.message_counts
        if per_channel is None or self._file.damage:
            per_channel = {}
            for group in self._file.groups():
                for channel, count in zip(*np.unique(group.rows[:, 0], return_counts=True), strict=True):
                    per_channel[int(channel)] = per_channel.get(int(channel), 0) + int(count)
        counts: dict[str, int] = dict.fromkeys(self.topics(), 0)
        for channel in self._channels.values():
            counts[channel.topic] += per_channel.get(channel.id, 0)
        return counts

    def release(self) -> None:
        """Give back what is kept in memory for further readings, which then read the file again."""
        self._file.release()

    def columns(
        self,
        message_name: str,
        system: int | None = None,
        component: int | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
        fields: Sequence[str] | None = None,
    ) -> list[MessageColumns]:
        """Every message of that name, one entry per (system, component), ordered by these; empty if there are none.

        A message that came over several links counts once. start_ns, end_ns: log time, both included, of the messages
        wanted. fields: their fields wanted, in lower case; all without. Only the chunks that can hold such messages
        are decompressed, if the file has its summary. RecordingError for a field that the message does not have.
        """
        wanted = Selection(start_ns, end_ns, fields)
        entries = []
        for channels in self._members(message_name, system, component):
            parts = list(iter_columns(self._file, channels, self._layout(channels[0].schema_id), wanted))
            if parts:
                entries.append(joined(parts))
        return entries

    def iter_columns(
        self,
        message_name: str,
        system: int | None = None,
        component: int | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
        fields: Sequence[str] | None = None,
        group_bytes: int = STREAM_BYTES,
    ) -> Iterator[MessageColumns]:
        """As `columns`, in parts: about `group_bytes` of the file are held uncompressed at a time.

        The parts of one (system, component) come behind one another in the order of reception.
        """
        wanted = Selection(start_ns, end_ns, fields, group_bytes)
        for channels in self._members(message_name, system, component):
            yield from iter_columns(self._file, channels, self._layout(channels[0].schema_id), wanted)

    def _members(self, name: str, system: int | None, component: int | None) -> list[list[MessageChannel]]:
        """The channels, one per link, of each (system, component) that sent the message."""
        wanted: dict[tuple[int, int, int], list[MessageChannel]] = {}
        for channel in self._channels.values():
            fits = system in (None, channel.system) and component in (None, channel.component)
            if channel.name == name and fits:
                wanted.setdefault((channel.system, channel.component, channel.schema_id), []).append(channel)
        return [wanted[key] for key in sorted(wanted)]

    def _layout(self, schema_id: int) -> Layout:
        if schema_id not in self._layouts:
            schema = self._file.schemas.get(schema_id)
            if schema is None:
                raise RecordingError(f"{self.path} lacks the definition of a message; it is damaged there")
            layout = parse_ros2msg(schema.data.decode(errors="replace"))
            possible = 0 < layout.wire_size <= scan.LARGEST_PAYLOAD and len(layout.runs) <= scan.LARGEST_RUN_COUNT
            if not possible or len({field.name for field in layout.fields}) < len(layout.fields):
                raise RecordingError(f"{self.path}: {schema.name} is defined as no MAVLink message can be")
            self._layouts[schema_id] = layout
        return self._layouts[schema_id]

    def reception_times(self) -> Iterator[dict[tuple[str, str], Ints]]:
        """(topic, link) -> (N,) log times of its messages, a part of the file after the other."""
        for group in self._file.groups():
            part: dict[tuple[str, str], Ints] = {}
            for channel in self._channels.values():
                times = group.rows[group.rows_of((channel.id,)), 2]
                if times.size:
                    key = (channel.topic, channel.link)
                    part[key] = np.concatenate((part[key], times)) if key in part else times
            yield part

    def lost(self) -> dict[tuple[str, int, int], int]:
        """Messages that never came, by (link, system, component): gaps in the counter over all their channels.

        Frames of unknown id fill a gap too.
        """
        members: dict[tuple[str, int, int], list[int]] = {}
        for channel in self._channels.values():
            members.setdefault((channel.link, channel.system, channel.component), []).append(channel.id)
        counters: dict[tuple[str, int, int], list[Ints]] = {key: [] for key in members}
        for group in self._file.groups():
            for key, channels in members.items():
                counters[key].append(group.rows[group.rows_of(channels), 1])
        lost = {key: _gaps(np.concatenate(parts)) if parts else 0 for key, parts in counters.items()}
        for key, count in self._kept_as_bytes().items() if any(lost.values()) else ():
            if key in lost:
                lost[key] = max(lost[key] - count, 0)
        return lost

    def _kept_as_bytes(self) -> Counter[tuple[str, int, int]]:
        """By (link, system, component) how many frames stand among the bytes: of an id that the dialect did not know,
        or beyond those that a recording keeps apart.
        """
        found: Counter[tuple[str, int, int]] = Counter()
        for group in self._file.groups():
            for row in group.rows_of(self._wire_channels).tolist():
                record = self._wire_record(group, row)
                starts = (np.cumsum(record.run_length) - record.run_length)[record.run_kind == RUN_UNKNOWN]
                at = starts + np.where(record.run_bytes[starts] == 0xFD, 5, 3)
                senders = record.run_bytes[at].astype(np.int64) << 8 | record.run_bytes[at + 1]
                link = self._wire_channels[int(group.rows[row, 0])]
                for sender, count in zip(
                    *(one.tolist() for one in np.unique(senders, return_counts=True)), strict=True
                ):
                    found[link, sender >> 8, sender & 0xFF] += count
        return found

    def wire_pieces(self) -> Iterator[WirePieces]:
        """Each link's bytes chunk by chunk, cut into frames and what lay between them."""
        channel_rows = self._channel_rows()
        members: dict[str, list[int]] = {link: [] for link in self.links()}
        for channel in self._channels.values():
            members.setdefault(channel.link, []).append(channel.id)
        first_chunk = 0
        for group in self._file.groups():
            picked = {link: group.rows_of(channels) for link, channels in members.items()}
            for row in group.rows_of(self._wire_channels).tolist():
                link = self._wire_channels[int(group.rows[row, 0])]
                chunk = int(np.searchsorted(group.chunk_rows, row, side="right")) - 1
                limits = np.searchsorted(picked[link], group.chunk_rows[chunk : chunk + 2])
                messages = picked[link][limits[0] : limits[1]]
                data, pieces = self._rebuild(group, self._wire_record(group, row), messages, link, channel_rows)
                yield WirePieces(first_chunk + chunk, link, data, pieces)
            first_chunk += group.chunk_rows.size - 1

    def _rebuild(
        self, group: Group, record: WireRecord, messages: Ints, link: str, channel_rows: Ints
    ) -> tuple[Bytes, Ints]:
        if messages.size != record.form.size:
            raise RecordingError(
                f"{self.path}: the bytes of link {link} cannot be rebuilt: messages are missing or in other chunks"
            )
        wire_sizes = channel_rows[group.rows[messages, 0], scan.WIRE]
        runs = (record.run_frame, record.run_kind, record.run_length)
        if not scan.runs_fit(wire_sizes, record.form, *runs, record.run_bytes):
            raise RecordingError(f"{self.path}: the bytes of link {link} cannot be rebuilt: their account is damaged")
        out = np.empty(messages.size * _LARGEST_FRAME + record.run_bytes.size, np.uint8)
        pieces = np.empty((messages.size + record.run_frame.size, 4), np.int64)
        count = scan.rebuild(
            group.data,
            group.rows,
            messages,
            channel_rows,
            record.form,
            *runs,
            record.run_time,
            record.run_bytes,
            record.start_ns,
            CRC_TABLES,
            out,
            pieces,
        )
        used = int(pieces[count - 1, 1] + pieces[count - 1, 2]) if count else 0
        return out[:used], pieces[:count]

    def _wire_record(self, group: Group, row: int) -> WireRecord:
        start = int(group.rows[row, 4])
        try:
            return decode_wire(group.data[start : start + int(group.rows[row, 5])].tobytes())
        except ValueError as error:
            raise RecordingError(f"{self.path}: {error}; the bytes of its links cannot be rebuilt") from None

    def _channel_rows(self) -> Ints:
        """One row per channel for `scan.rebuild`."""
        rows = np.zeros((max(self._file.channels, default=0) + 1, scan.ROW_WIDTH), np.int64)
        for channel in self._channels.values():
            layout = self._layout(channel.schema_id)
            runs = [value for run in layout.runs for value in run]
            head = (
                channel.message_id,
                channel.system,
                channel.component,
                channel.crc_extra,
                channel.base_length,
                layout.wire_size,
                len(layout.runs),
            )
            rows[channel.id, : len(head)] = head
            rows[channel.id, scan.RUNS : scan.RUNS + len(runs)] = runs
        return rows


def _open(path: str | os.PathLike[str] | Sequence[Path]) -> Container | JoinedContainer:
    if isinstance(path, str | os.PathLike):
        return Container(path)
    return Container(path[0]) if len(path) == 1 else JoinedContainer(path)


def _gaps(counters: Ints) -> int:
    """Numbers missing between the smallest and the largest counter, which is kept in 32 bits."""
    if counters.size == 0:
        return 0
    steps = np.diff(counters.astype(np.uint32).view(np.int32)).astype(np.int32)
    unwrapped = np.concatenate(([0], np.cumsum(steps, dtype=np.int64)))
    unwrapped.sort()
    distinct = 1 + int(np.count_nonzero(np.diff(unwrapped)))
    return int(unwrapped[-1] - unwrapped[0]) + 1 - distinct


__all__ = ["RUN_NOISE", "RUN_UNKNOWN", "MessageColumns", "Recording", "WirePieces"]
