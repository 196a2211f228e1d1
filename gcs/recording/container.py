"""The MCAP file below the messages: finding chunks, whole file or not, and checking what is in them."""

from __future__ import annotations

import mmap
import os
import zlib
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Footer, Metadata, Schema, Statistics
from numpy.typing import NDArray

from gcs.errors import RecordingError
from gcs.recording import records
from gcs.recording.chunks import checked_content, decompress, find_chunk, is_cut_off
from gcs.recording.records import ChunkInfo, Content
from gcs.recording.scan import first_unfit, list_messages, walk_records
from gcs.text.sizes import size_text

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

#: Logs that can be made recordings (`gcs.formats.conversion`).
LOG_ENDINGS = (".tlog", ".bin", ".log", ".ulg", ".csv", ".tsv", ".txt", ".parquet", ".mat", ".npz", ".db3", ".bag")

# Of messages that stand in no chunk, as many bytes are read like one.
_BARE_BYTES = 1 << 20
GROUP_BYTES = 256 << 20  # uncompressed bytes that are held at a time
_RECORD_HEAD = records.HEAD.size
_MESSAGE_HEAD = 22  # a message's channel, sequence and two times
_FOOTER_BYTES = _RECORD_HEAD + 20 + len(records.MAGIC)


@dataclass
class Damage:
    """What of a file could not be used.

    chunks: chunks left out because their bytes are not what was written. bytes: bytes of the file that cannot be read.
    truncated: the file has no end. notes: one line for each finding. inside: the first of them that reports more lost
    than the one record that was being written when the file was cut off; empty if there is none.
    """

    chunks: int = 0
    bytes: int = 0
    truncated: bool = False
    notes: list[str] = field(default_factory=list)
    inside: str = ""

    def __bool__(self) -> bool:
        return bool(self.chunks or self.bytes)

    def lose(self, offset: int, size: int, why: str, inside: bool = True) -> None:
        """Note bytes that cannot be read."""
        if size > 0:
            self.bytes += size
            self.note(f"{size} bytes at {offset} cannot be read: {why}", inside)

    def note(self, finding: str, inside: bool) -> None:
        """Note a finding."""
        self.notes.append(finding)
        if inside and not self.inside:
            self.inside = finding


@dataclass(frozen=True)
class Group:
    """Some consecutive chunks, uncompressed, and their messages.

    data: (B,) uint8. rows: (N, 6) int64: channel, sequence, log time, publish time, offset and length of the
    message's data. chunk_rows: (chunks + 1,) where each chunk's messages begin in `rows`.
    """

    data: Bytes
    rows: Ints
    chunk_rows: Ints

    @cached_property
    def channel(self) -> NDArray[np.uint16]:
        """(N,) channel of each message."""
        return self.rows[:, 0].astype(np.uint16)

    @cached_property
    def _by_channel(self) -> tuple[Ints, NDArray[np.uint16]]:
        order = np.argsort(self.channel, kind="stable")
        return order, self.channel[order]

    def rows_of(self, channels: Iterable[int]) -> Ints:
        """Positions in `rows` of the messages of these channels, in file order."""
        order, sorted_channels = self._by_channel
        pieces = []
        for channel in channels:
            start, stop = np.searchsorted(sorted_channels, (channel, channel + 1))
            pieces.append(order[start:stop])
        if len(pieces) == 1:
            return pieces[0]
        return np.sort(np.concatenate(pieces)) if pieces else np.empty(0, np.int64)


class Container:
    """One MCAP file, opened. RecordingError if it is none, or if there is nothing in it to use."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.damage = Damage()
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.chunks: list[ChunkInfo] = []
        self._bare: list[ChunkInfo] = []
        self.message_counts: dict[int, int] | None = None
        self._attachment_places: list[tuple[int, int]] = []
        self.metadata: list[tuple[str, dict[str, str]]] = []
        self._cached: Group | None = None
        self._indexed: dict[int, tuple[ChunkInfo, frozenset[int]]] = {}
        self._selected_bytes = 0
        self._bad_chunks: set[int] = set()
        self.bytes = self._map()
        self._check_head()
        self._read_records()

    def _map(self) -> Bytes:
        try:
            with open(self.path, "rb") as file:
                if os.fstat(file.fileno()).st_size == 0:
                    raise RecordingError(f"{self.path} is empty; nothing was recorded in it")
                return np.frombuffer(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ), np.uint8)
        except OSError as error:
            raise RecordingError(f"{self.path} cannot be read: {error.strerror}") from None

    def _check_head(self) -> None:
        magic, end = (
            self.bytes[part].tobytes() for part in (slice(len(records.MAGIC)), slice(-len(records.MAGIC), None))
        )
        if magic != records.MAGIC[: len(magic)] and end == records.MAGIC:
            self.damage.notes.append("the first bytes are not those of an MCAP file; its end was believed")
        elif magic != records.MAGIC[: len(magic)]:
            raise RecordingError(f"{self.path} is not an MCAP file; `gcs import` reads {', '.join(LOG_ENDINGS)}")
        if self.bytes.size < len(records.MAGIC) + _RECORD_HEAD:
            raise RecordingError(f"{self.path} was cut off before its first message; there is nothing to use in it")

    def _content(self, place: Ints) -> bytes:
        return self.bytes[place[1] : place[1] + place[2]].tobytes()

    def _walk(self, start: int, stop: int) -> tuple[Ints, int]:
        """Records from `start` on, and where they end."""
        places = np.empty((4096, 3), np.int64)
        count, end = walk_records(self.bytes, start, stop, places, 0)
        while count == places.shape[0]:
            places = np.concatenate((places, np.empty_like(places)))
            count, end = walk_records(self.bytes, end, stop, places, count)
        return places[:count], int(end)

    def _read_records(self) -> None:
        whole = self.bytes[-len(records.MAGIC) :].tobytes() == records.MAGIC
        summary = self._read_summary() if whole else []
        if summary:
            self._read_by_summary(summary)
        else:
            self._read_without_summary()
        self.chunks = sorted(self.chunks + self._bare, key=lambda chunk: chunk.offset)
        if self.message_counts is None or not self.message_counts.keys() <= self.channels.keys():
            self._take_definitions_of_chunks()
        if not self.channels:
            why = "was cut off before its first message"
            if self.damage.inside:
                why = "is damaged where its messages are described"
            raise RecordingError(f"{self.path} {why}; there is nothing to use in it")

    def _read_by_summary(self, summary: list[ChunkInfo]) -> None:
        """All records where the summary, which has a checksum, says where the chunks are."""
        start, stop = len(records.MAGIC), self.bytes.size
        places, end = self._walk(start, stop)
        self._take(places)
        ended = places.size > 0 and places[-1, 0] == Opcode.FOOTER
        astray = not ended
        while not ended:
            later = [chunk.offset for chunk in summary if chunk.offset > end]
            if not later:
                break
            places, end = self._walk(later[0], stop)
            self._take(places)
            ended = places.size > 0 and places[-1, 0] == Opcode.FOOTER
        # A damaged length leads the walk astray, even past good chunks.
        if astray or [chunk.offset for chunk in self.chunks] != [chunk.offset for chunk in summary]:
            self.damage.notes.append("a record's length is damaged; the chunks were found by the summary")
        self.chunks = summary

    def _read_without_summary(self) -> None:
        """All records from the first on; behind one that is damaged it goes on at the next chunk that is whole."""
        at, stop = len(records.MAGIC), self.bytes.size
        while True:
            places, end = self._walk(at, stop)
            sound = int(first_unfit(self.bytes, places))
            if sound < len(places):
                places, end = places[:sound], int(places[sound, 1]) - _RECORD_HEAD
            self._take(places)
            if np.isin(places[:, 0], (Opcode.DATA_END, Opcode.FOOTER)).any():
                self.damage.truncated = Opcode.FOOTER not in places[:, 0]
                cut = True
                break
            chunk, wrong = find_chunk(self.bytes, end, stop)
            if chunk is None:
                self.damage.truncated = True
                cut = not wrong and is_cut_off(self.bytes, end, stop)
                break
            if chunk.offset > end:
                self.damage.lose(end, chunk.offset - end, "damaged; the next whole chunk is behind it")
            else:
                self.damage.note(f"the record at {end} is damaged in front of its chunk, which is whole", inside=False)
            self.chunks.append(chunk)
            at = chunk.offset + chunk.length
        if self.damage.truncated:
            why = "the file was cut off" if cut else "damaged, and no whole chunk is behind it"
            self.damage.lose(end, stop - end, why, inside=not cut)

    def _read_summary(self) -> list[ChunkInfo]:
        """Schemas, channels, counts and chunk places of the summary, if it is there and sound."""
        footer = self.bytes[-_FOOTER_BYTES:].tobytes()
        if len(footer) < _FOOTER_BYTES or footer[0] != Opcode.FOOTER:
            return []
        said: Footer = Footer.read(Content(footer[_RECORD_HEAD:]))
        start = said.summary_start
        end = self.bytes.size - _FOOTER_BYTES
        if not 0 < start <= end:
            return []
        if said.summary_crc and zlib.crc32(self.bytes[start : end + 25].data) != said.summary_crc:
            self.damage.notes.append("the summary is damaged; the file was read without it")
            return []
        chunks = []
        try:
            for place in self._walk(start, end)[0]:
                opcode = int(place[0])
                if opcode == Opcode.CHUNK_INDEX:
                    chunk, held = records.read_chunk_index(self._content(place))
                    chunks.append(chunk)
                    self._indexed[chunk.offset] = chunk, held
                elif opcode == Opcode.STATISTICS:
                    self.message_counts = Statistics.read(Content(self._content(place))).channel_message_counts
                elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._take_definition(opcode, self._content(place))
        except ValueError as error:
            self.damage.notes.append(f"the summary is damaged ({error}); the file was read without it")
            self.message_counts = None
            self._indexed = {}
            return []
        return sorted(chunks, key=lambda chunk: chunk.offset)

    def _take_definition(self, opcode: int, content: bytes) -> None:
        if opcode == Opcode.SCHEMA:
            schema: Schema = Schema.read(Content(content))
            if schema.encoding == "ros2msg":
                schema.data.decode()  # a ValueError where text is damaged; other definitions may be no text
            self.schemas[schema.id] = schema
        else:
            channel: Channel = Channel.read(Content(content))
            self.channels[channel.id] = channel

    def _take(self, places: Ints) -> None:
        """Keep what the records say; chunks, and messages outside of them, are only noted."""
        self._take_bare(places[(places[:, 0] == Opcode.MESSAGE) & (places[:, 2] >= _MESSAGE_HEAD)])
        wanted = np.isin(
            places[:, 0], (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.METADATA)
        )
        for place in places[wanted]:
            opcode = int(place[0])
            try:
                if opcode == Opcode.CHUNK:
                    head = self.bytes[place[1] : place[1] + min(place[2], 4096)].tobytes()
                    info, _, _ = records.read_chunk_head(
                        head, int(place[1]) - _RECORD_HEAD, int(place[2]) + _RECORD_HEAD
                    )
                    self.chunks.append(info)
                elif opcode == Opcode.ATTACHMENT:
                    self._attachment_places.append((int(place[1]), int(place[2])))
                elif opcode == Opcode.METADATA:
                    entry: Metadata = Metadata.read(Content(self._content(place)))
                    self.metadata.append((entry.name, entry.metadata))
                else:
                    self._take_definition(opcode, self._content(place))
            except ValueError as error:
                self.damage.lose(int(place[1]) - _RECORD_HEAD, int(place[2]) + _RECORD_HEAD, str(error))

    def _take_bare(self, places: Ints) -> None:
        """Note messages outside chunks, those behind one another together."""
        starts, ends = places[:, 1] - _RECORD_HEAD, places[:, 1] + places[:, 2]
        apart = (starts[1:] != ends[:-1]) | (np.diff(starts // _BARE_BYTES) != 0)
        bounds = [0, *(np.flatnonzero(apart) + 1).tolist(), len(places)] if len(places) else []
        for first, behind in pairwise(bounds):
            start, stop = int(starts[first]), int(ends[behind - 1])
            rows = np.empty((behind - first, 6), np.int64)
            list_messages(self.bytes, start, stop, rows, 0)
            times = rows[:, 2].astype(np.uint64)
            size = stop - start
            self._bare.append(ChunkInfo(start, size, int(times.min()), int(times.max()), "", size, size, bare=True))

    def _take_definitions_of_chunks(self) -> None:
        """Without a summary that repeats them, schemas and channels are only found inside the chunks."""
        for group in self.groups():
            places, _ = _walk_all(group.data)
            for opcode, at, length in places[np.isin(places[:, 0], (Opcode.SCHEMA, Opcode.CHANNEL))].tolist():
                try:
                    self._take_definition(opcode, group.data[at : at + length].tobytes())
                except ValueError as error:
                    self.damage.note(f"a description of messages in a chunk is damaged ({error})", inside=True)

    @cached_property
    def attachments(self) -> list[Attachment]:
        """Files inside the recording, read when they are asked for; one with a wrong checksum counts as damage."""
        found = []
        for at, length in self._attachment_places:
            try:
                found.append(records.read_attachment(self.bytes[at : at + length].tobytes()))
            except ValueError as error:
                self.damage.lose(at - _RECORD_HEAD, length + _RECORD_HEAD, str(error))
        return found

    def content_of(self, chunk: ChunkInfo) -> bytes | None:
        """The chunk's content, or None (and a note of the damage) if it is not what was written."""
        try:
            return checked_content(self.bytes, chunk, self._decompress)
        except ValueError as error:
            if chunk.offset not in self._bad_chunks:
                self._bad_chunks.add(chunk.offset)
                self.damage.chunks += 1
                self.damage.lose(chunk.offset, chunk.length, str(error))
            return None
        except MemoryError:
            size = size_text(chunk.uncompressed_size)
            raise RecordingError(f"{self.path}: a chunk of {size} does not fit into memory; free some") from None

    def _decompress(self, chunk: ChunkInfo, stored: bytes) -> bytes:
        return decompress(chunk, stored)

    def groups(self) -> Iterator[Group]:
        """All messages, some chunks at a time, in file order."""
        if self._cached is not None:
            yield self._cached
            return
        if sum(chunk.uncompressed_size for chunk in self.chunks) > GROUP_BYTES:
            yield from self._gathered(self.chunks, GROUP_BYTES)
            return
        self._cached = next(self._gathered(self.chunks, GROUP_BYTES), None) or _group(bytearray(), [])
        yield self._cached

    def release(self) -> None:
        """Give back the content that is kept in memory; it is read again where somebody asks for it."""
        self._cached = None

    def _gathered(self, chunks: Iterable[ChunkInfo], group_bytes: int) -> Iterator[Group]:
        """These chunks' messages, about `group_bytes` at a time."""
        # One buffer that grows: what is uncompressed is never held twice.
        pending, ends = bytearray(), list[int]()
        for chunk in chunks:
            data = self.content_of(chunk)
            if data is None:
                continue
            pending += data
            ends.append(len(pending))
            if len(pending) > group_bytes:
                yield _group(pending, ends)
                pending, ends = bytearray(), []
        if ends:
            yield _group(pending, ends)

    def selected_groups(
        self,
        channels: Collection[int],
        start_ns: int | None = None,
        end_ns: int | None = None,
        group_bytes: int | None = None,
    ) -> Iterator[Group]:
        """As `groups`, but of the chunks that can hold messages of these channels and this span of log time alone.

        Which these are, only a summary says for sure; of a file without one every chunk is read. A group holds about
        `group_bytes`, unless all of the file is in memory already.
        """
        group_bytes = GROUP_BYTES if group_bytes is None else group_bytes
        wanted = [chunk for chunk in self.chunks if self._may_hold(chunk, channels, start_ns, end_ns)]
        size = sum(chunk.uncompressed_size for chunk in wanted)
        whole = sum(chunk.uncompressed_size for chunk in self.chunks)
        # Many small selections cost more than the whole file once, which is then kept.
        if self._cached is not None or (whole <= group_bytes and self._selected_bytes + size > whole // 2):
            yield from self.groups()
            return
        self._selected_bytes += size
        yield from self._gathered(wanted, group_bytes)

    def _may_hold(self, chunk: ChunkInfo, channels: Collection[int], start_ns: int | None, end_ns: int | None) -> bool:
        if chunk.offset not in self._indexed:
            return True
        info, held = self._indexed[chunk.offset]
        early = start_ns is not None and info.end_ns < start_ns
        late = end_ns is not None and info.start_ns > end_ns
        return not (early or late) and (not held or not held.isdisjoint(channels))


def _walk_all(data: Bytes) -> tuple[Ints, int]:
    places = np.empty((data.size // 9 + 1, 3), np.int64)
    count, end = walk_records(data, 0, data.size, places, 0)
    return places[:count], int(end)


def _group(content: bytearray, ends: list[int]) -> Group:
    """Chunks behind one another, and where each ends."""
    data = np.frombuffer(content, np.uint8)
    rows = np.empty((data.size // 31 + 1, 6), np.int64)
    chunk_rows = np.zeros(len(ends) + 1, np.int64)
    start = count = 0
    for i, end in enumerate(ends):
        count = int(list_messages(data, start, end, rows, count))
        start = end
        chunk_rows[i + 1] = count
    return Group(data, rows[:count], chunk_rows)
