"""Writing recordings: frames and the bytes between them, as they came, into an indexed MCAP file.

MCAP as in mcap.dev/spec: chunks with message indexes, and at the end a summary. A chunk is closed when it is full or
after `chunk_seconds`, so a file cut off at any byte lacks at most that much.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import lz4.frame
import numpy as np
import zstandard
from numpy.typing import NDArray

from gcs.dialect import Dialect
from gcs.errors import RecordingError
from gcs.framing import Frames
from gcs.recording import build as kernel
from gcs.recording import records
from gcs.recording.records import Attachment, Channel, ChunkInfo, Schema
from gcs.recording.wire import WIRE_SCHEMA, WIRE_SCHEMA_NAME, WIRE_TOPIC, encode_wire

CHUNK_BYTES = 1 << 20
_INDEX_ENTRIES = CHUNK_BYTES // (kernel.RECORD_HEADER + 1)
_LARGEST_CHUNK_SECONDS = 4.0  # run times are 32-bit nanoseconds
_LAST_CHANNEL = 65535

Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class Counts:
    """What has been written: MAVLink messages, stream bytes of all links, those in no frame, frames of unknown id."""

    messages: int
    bytes: int
    raw_bytes: int
    unknown_frames: int


class _Link:
    """The account of one link's stream within the open chunk, and the components heard on it."""

    def __init__(self, name: str, wire_channel: int) -> None:
        self.name = name
        self.wire_channel = wire_channel
        self.component_of = np.full(65536, -1, np.int32)
        self.form = np.empty(_INDEX_ENTRIES, np.uint8)
        self.runs = np.empty((_INDEX_ENTRIES, 4), np.int64)
        self.run_bytes = np.empty(CHUNK_BYTES, np.uint8)
        self.state = np.zeros(kernel.LINK_STATE, np.int64)
        self.first_byte = 0

    @property
    def has_account(self) -> bool:
        return bool(self.state[kernel.FORM_COUNT] or self.state[kernel.RUN_COUNT_])


def _compressor(name: str) -> tuple[str, Callable[[memoryview], bytes]]:
    if name == "zstd":
        return "zstd", zstandard.ZstdCompressor(level=1).compress
    if name == "lz4":
        return "lz4", lambda data: bytes(lz4.frame.compress(data))
    if name == "none":
        return "", bytes
    raise RecordingError(f"unknown compression {name!r}; use zstd, lz4 or none")


class McapWriter:
    """Writer of one recording.

    path: file to create. compression: zstd, lz4 or none. chunk_seconds: longest span of one chunk, at most 4 s.
    durable: also wait, at every chunk, until the disk has it (a power cut then costs at most a chunk).
    RecordingError if the file cannot be created or written.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        dialect: Dialect,
        *,
        compression: str = "zstd",
        chunk_seconds: float = 1.0,
        durable: bool = False,
    ) -> None:
        if not 0.0 < chunk_seconds <= _LARGEST_CHUNK_SECONDS:
            raise RecordingError(f"a chunk of {chunk_seconds} s is not possible; use more than 0 and at most 4 s")
        self._path = Path(path)
        self._dialect = dialect
        self._compression, self._compress = _compressor(compression)
        self._durable = durable
        try:
            self._file = open(self._path, "wb", buffering=0)  # noqa: SIM115 (closed by close)
        except OSError as error:
            raise RecordingError(f"{self._path} cannot be written: {error.strerror}") from None
        self._position = 0
        self._checksum = 0
        self._closed = False
        self._links: dict[str, _Link] = {}
        self._schemas: dict[str, Schema] = {}
        self._channels: list[Channel] = []
        self._components = 0
        self._channel_of = np.full((4, len(dialect.messages)), -1, np.int32)
        self._sequences = np.full(4, -1, np.int64)
        self._channel_state = np.zeros((64, 4), np.int64)
        self._out = np.empty(CHUNK_BYTES + (1 << 16), np.uint8)
        self._index = np.empty((_INDEX_ENTRIES, 3), np.int64)
        self._chunk = np.zeros(kernel.CHUNK_STATE, np.int64)
        self._chunk[kernel.CHUNK_START] = -1
        self._chunk[kernel.PERIOD] = round(chunk_seconds * 1e9)
        self._chunk_index: list[bytes] = []
        self._attachment_index: list[bytes] = []
        self._metadata_index: list[bytes] = []
        self._wire_counts: dict[int, int] = {}
        self._first_log: int | None = None
        self._put(records.MAGIC + records.header_record("ros2"))

    def __enter__(self) -> McapWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def path(self) -> Path:
        """The file being written."""
        return self._path

    @property
    def size(self) -> int:
        """Bytes in the file so far."""
        return self._position

    @property
    def counts(self) -> Counts:
        """What has been handed in so far, the open chunk included."""
        states = [link.state for link in self._links.values()]
        return Counts(
            messages=int(self._channel_state[:, kernel.MESSAGE_COUNT].sum()),
            bytes=sum(int(state[kernel.STREAM_BYTES]) for state in states),
            raw_bytes=sum(int(state[kernel.RAW_BYTES]) for state in states),
            unknown_frames=sum(int(state[kernel.UNKNOWN_FRAMES]) for state in states),
        )

    def write(self, link: str, buffer: Bytes, frames: Frames, received_ns: int | NDArray[np.int64]) -> None:
        """Append what one link received.

        buffer: the consumed bytes, exactly, that `frames` were found in (as `Framer.feed` gives them).
        received_ns: UTC of reception, one for all or one per frame; bytes between frames count with the frame behind.
        """
        account = self._links.get(link) or self._add_link(link)
        times = self._times(frames, received_ns)
        chunk = self._chunk
        chunk[kernel.BUFFER_POS] = chunk[kernel.FRAME] = 0
        while True:
            status = kernel.build(
                buffer,
                frames.consumed,
                frames.offset,
                frames.length,
                frames.message,
                frames.kind,
                times,
                self._dialect.table,
                self._channel_of,
                account.component_of,
                self._sequences,
                self._channel_state,
                self._out,
                self._index,
                account.form,
                account.runs,
                account.run_bytes,
                chunk,
                account.state,
            )
            if status == kernel.DONE:
                return
            if status == kernel.CHUNK_FULL:
                self._close_chunk()
            else:
                self._add_channel(account, frames, int(chunk[kernel.FRAME]))

    def tick(self, now_ns: int) -> None:
        """Close the open chunk if it is old enough: call now and then, so that an idle link is on disk too."""
        start = int(self._chunk[kernel.CHUNK_START])
        if start >= 0 and now_ns - start >= int(self._chunk[kernel.PERIOD]):
            self._close_chunk()

    def flush(self) -> None:
        """Close the open chunk: all that was written is in the file."""
        if int(self._chunk[kernel.CHUNK_START]) >= 0 or int(self._chunk[kernel.OUT_POS]) > 0:
            self._close_chunk()

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Put a file into the recording, as the vehicle file that a flight was flown with."""
        self.flush()
        attachment = Attachment(name, media_type, max(int(self._chunk[kernel.LAST_LOG]), 0), data)
        content = records.attachment_record(attachment)
        self._attachment_index.append(records.attachment_index_record(self._position, len(content), attachment))
        self._put(content)

    def metadata(self, name: str, mapping: Mapping[str, str]) -> None:
        """Put named pairs of text into the recording."""
        self.flush()
        content = records.metadata_record(name, mapping)
        self._metadata_index.append(records.metadata_index_record(self._position, len(content), name))
        self._put(content)

    def close(self) -> None:
        """Write what is open, the summary and the footer. Closing twice does nothing."""
        if self._closed:
            return
        self._closed = True
        try:
            self.flush()
            self._put(records.record(records.DATA_END, struct.pack("<I", self._checksum)))
            self._put(records.summary_section(self._summary_groups(), self._position))
        finally:
            self._file.close()

    def _summary_groups(self) -> list[tuple[int, bytes]]:
        counts = {}
        for channel in self._channels:
            messages = int(self._channel_state[channel.id, kernel.MESSAGE_COUNT])
            counts[channel.id] = self._wire_counts.get(channel.id, messages)
        statistics = records.statistics_record(
            len(self._schemas),
            len(self._attachment_index),
            len(self._metadata_index),
            len(self._chunk_index),
            self._first_log or 0,
            int(self._chunk[kernel.LAST_LOG]),
            counts,
        )
        return [
            (records.SCHEMA, b"".join(map(records.schema_record, self._schemas.values()))),
            (records.CHANNEL, b"".join(map(records.channel_record, self._channels))),
            (records.STATISTICS, statistics),
            (records.CHUNK_INDEX, b"".join(self._chunk_index)),
            (records.ATTACHMENT_INDEX, b"".join(self._attachment_index)),
            (records.METADATA_INDEX, b"".join(self._metadata_index)),
        ]

    def _times(self, frames: Frames, received_ns: int | NDArray[np.int64]) -> NDArray[np.int64]:
        if not isinstance(received_ns, np.ndarray):
            return np.array((received_ns,), np.int64)
        if received_ns.shape != (len(frames),):
            raise ValueError(f"{received_ns.size} times of reception for {len(frames)} frames")
        last = received_ns[-1:] if len(frames) else self._chunk[kernel.LAST_LOG : kernel.LAST_LOG + 1]
        # One entry alone would mean one time for all, which for no frames at all is just what is wanted.
        return np.concatenate((received_ns.astype(np.int64), last))

    def _add_link(self, name: str) -> _Link:
        schema = self._schema(WIRE_SCHEMA_NAME, WIRE_SCHEMA)
        channel = self._register(schema, WIRE_TOPIC, {"link": name, "dialect": self._dialect.name})
        self._wire_counts[channel] = 0
        self._links[name] = _Link(name, channel)
        return self._links[name]

    def _add_channel(self, link: _Link, frames: Frames, i: int) -> None:
        """Register the channel of frame i, and its component if it is heard for the first time on the link."""
        at = int(frames.offset[i]) + (5 if frames.buffer[frames.offset[i]] == 0xFD else 3)
        system, component = int(frames.buffer[at]), int(frames.buffer[at + 1])
        number = int(link.component_of[system << 8 | component])
        if number < 0:
            number = self._components
            self._components += 1
            link.component_of[system << 8 | component] = number
            if number == self._channel_of.shape[0]:
                self._channel_of = np.concatenate((self._channel_of, np.full_like(self._channel_of, -1)))
                self._sequences = np.concatenate((self._sequences, np.full_like(self._sequences, -1)))
        message = self._dialect.messages[frames.message[i]]
        schema = self._schema(message.schema_name, message.layout.ros2msg)
        metadata = {
            "dialect": self._dialect.name,
            "link": link.name,
            "system": str(system),
            "component": str(component),
            "message": message.name,
            "message_id": str(message.id),
            "crc_extra": str(message.crc_extra),
            "base_length": str(message.base_length),
            "text_fields": ",".join(message.text_fields),
        }
        topic = f"/mavlink/{system}/{component}/{message.name}"
        self._channel_of[number, int(frames.message[i])] = self._register(schema, topic, metadata)

    def _schema(self, name: str, text: str) -> Schema:
        schema = self._schemas.get(name)
        if schema is None:
            schema = Schema(len(self._schemas) + 1, name, "ros2msg", text)
            self._schemas[name] = schema
            self._append(records.schema_record(schema))
        return schema

    def _register(self, schema: Schema, topic: str, metadata: Mapping[str, str]) -> int:
        number = len(self._channels) + 1
        if number > _LAST_CHANNEL:
            raise RecordingError(
                f"{self._path} has {_LAST_CHANNEL} channels, the most an MCAP file holds; start another"
            )
        channel = Channel(number, schema.id, topic, "cdr", metadata)
        self._channels.append(channel)
        if number == self._channel_state.shape[0]:
            self._channel_state = np.concatenate((self._channel_state, np.zeros_like(self._channel_state)))
        self._append(records.channel_record(channel))
        return number

    def _append(self, content: bytes) -> None:
        """Put a record into the open chunk, which grows if it must."""
        start = int(self._chunk[kernel.OUT_POS])
        if start + len(content) > self._out.size:
            self._out = np.concatenate((self._out, np.empty(max(len(content), CHUNK_BYTES), np.uint8)))
        self._out[start : start + len(content)] = np.frombuffer(content, np.uint8)
        self._chunk[kernel.OUT_POS] = start + len(content)

    def _append_wire(self, link: _Link) -> tuple[int, int, int]:
        """Put the link's account into the open chunk; its entry for the message index."""
        state = link.state
        log = int(self._chunk[kernel.LAST_LOG])
        data = encode_wire(
            link.first_byte,
            int(self._chunk[kernel.CHUNK_START]),
            link.form[: state[kernel.FORM_COUNT]],
            link.runs[: state[kernel.RUN_COUNT_]],
            link.run_bytes[: state[kernel.RUN_BYTES]],
        )
        entry = (link.wire_channel, log, int(self._chunk[kernel.OUT_POS]))
        sequence = self._wire_counts[link.wire_channel]
        self._append(
            records.record(records.MESSAGE, struct.pack("<HIQQ", link.wire_channel, sequence, log, log) + data)
        )
        self._wire_counts[link.wire_channel] = sequence + 1
        link.first_byte = int(state[kernel.STREAM_BYTES])
        state[kernel.FORM_COUNT] = state[kernel.RUN_COUNT_] = state[kernel.RUN_BYTES] = 0
        return entry

    def _close_chunk(self) -> None:
        chunk = self._chunk
        entries = [self._append_wire(link) for link in self._links.values() if link.has_account]
        start = max(int(chunk[kernel.CHUNK_START]), 0)
        end = int(chunk[kernel.LAST_LOG]) if entries else start
        content = memoryview(self._out.data)[: int(chunk[kernel.OUT_POS])]
        stored = self._compress(content)
        data = records.chunk_record(start, end, content, self._compression, stored)
        info = ChunkInfo(self._position, len(data), start, end, self._compression, len(stored), len(content))
        index = np.concatenate((self._index[: chunk[kernel.INDEX_COUNT]], np.array(entries, np.int64).reshape(-1, 3)))
        places = np.empty(len(self._channels) + 1, np.int64)
        index_data = np.empty(16 * len(index) + 15 * places.size, np.uint8)
        length = int(kernel.index_records(index, len(index), places.size, places, index_data))
        base = self._position + len(data)
        offsets = {channel: base + int(places[channel]) for channel in np.flatnonzero(places >= 0).tolist()}
        self._chunk_index.append(records.chunk_index_record(info, offsets, length))
        self._put(data + index_data[:length].tobytes())
        if entries and self._first_log is None:
            self._first_log = start
        chunk[kernel.OUT_POS] = chunk[kernel.INDEX_COUNT] = 0
        chunk[kernel.CHUNK_START] = -1

    def _put(self, data: bytes) -> None:
        """Write to the file itself, whole, and keep the checksum of the data section."""
        view = memoryview(data)
        try:
            while view:
                view = view[self._file.write(view) :]
            if self._durable:
                os.fdatasync(self._file.fileno())
        except OSError as error:
            raise RecordingError(f"{self._path} cannot be written: {error.strerror}") from None
        self._position += len(data)
        self._checksum = zlib.crc32(data, self._checksum)


__all__ = ["Counts", "McapWriter"]
