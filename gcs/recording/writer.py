"""Writing recordings: frames and the bytes between them, as they came, into an indexed MCAP file.

MCAP as in mcap.dev/spec: chunks with message indexes, and at the end a summary. A chunk is closed when it is full or
after `chunk_seconds`, so a file cut off at any byte lacks at most that much. Compressing and writing it is left to
the thread of `gcs.recording.sink`.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np
from mcap.records import Attachment, Channel, Message, Schema
from numpy.typing import NDArray

from gcs.errors import RecordingError
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import Frames
from gcs.mavlink.sequence import sequence_states
from gcs.recording import build as kernel
from gcs.recording.records import packed
from gcs.recording.sink import CHUNK_BYTES, INDEX_ENTRIES, ChunkBuffer, ClosedChunk, Lost, RecordingSink
from gcs.recording.storage import SyncPolicy
from gcs.recording.wire import WIRE_SCHEMA, WIRE_SCHEMA_NAME, WIRE_TOPIC, encode_wire

_log = logging.getLogger(__name__)

_LARGEST_CHUNK_SECONDS = 4.0  # run times are 32-bit nanoseconds
# Components, and messages of theirs, that a recording keeps apart: a network of vehicles has some hundreds, and of more
# the summary of a file is read for minutes. Frames of further ones are kept as bytes, as those of unknown id are; but
# nothing that others send takes the messages of the first components.
_MOST_COMPONENTS, _MOST_CHANNELS, _FIRST_COMPONENTS = 1024, 8192, 64
# Chunks after which all channels are described again; more where there are more channels, so that it stays cheap.
_DESCRIBED_EVERY = 32

Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class Counts:
    """What has been written: MAVLink messages, stream bytes of all links, those in no frame, frames kept as bytes."""

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
        self.form = np.empty(INDEX_ENTRIES, np.uint8)
        self.runs = np.empty((INDEX_ENTRIES, 4), np.int64)
        self.run_bytes = np.empty(CHUNK_BYTES, np.uint8)
        self.state = np.zeros(kernel.LINK_STATE, np.int64)
        self.first_byte = 0

    @property
    def has_account(self) -> bool:
        return bool(self.state[kernel.FORM_COUNT] or self.state[kernel.RUN_COUNT_])


class McapWriter:
    """Writer of one recording.

    path: file to create. compression: zstd, lz4 or none. chunk_seconds: longest span of one chunk, at most 4 s.
    sync: when the disk must have what was written. reserve_bytes: free space on the disk that chunks must leave.
    waiting: closed chunks that may wait for the disk before `write` waits too.
    RecordingError if the file cannot be created. What goes wrong later is raised once, by the next call.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        dialect: Dialect,
        *,
        compression: str = "zstd",
        chunk_seconds: float = 1.0,
        sync: SyncPolicy | None = None,
        reserve_bytes: int = 0,
        waiting: int = 2,
    ) -> None:
        if not 0.0 < chunk_seconds <= _LARGEST_CHUNK_SECONDS:
            raise RecordingError(f"a chunk of {chunk_seconds} s is not possible; use more than 0 and at most 4 s")
        self._dialect = dialect

        def open_file(file: Path) -> RecordingSink:
            return RecordingSink(file, compression, sync or SyncPolicy(), reserve_bytes, waiting)

        self._open = open_file
        self._sink = open_file(Path(path))
        self._ending: list[RecordingSink] = []
        self._closed = False
        self._links: dict[str, _Link] = {}
        self._schemas: dict[str, Schema] = {}
        self._channels: list[Channel] = []
        self._components = 0
        self._channel_of = np.full((4, len(dialect.messages)), -1, np.int32)
        self._sequences = sequence_states(4)
        self._channel_state = np.zeros((64, 4), np.int64)
        self._wire_counts: dict[int, int] = {}
        self._buffer: ChunkBuffer = self._sink.take_buffer()
        self._chunk = np.zeros(kernel.CHUNK_STATE, np.int64)
        self._chunk[kernel.CHUNK_START] = -1
        self._chunk[kernel.PERIOD] = round(chunk_seconds * 1e9)
        self._chunk_seconds = chunk_seconds
        self._opened: float | None = None
        self._undescribed = 0
        self._is_full = False

    def __enter__(self) -> McapWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def path(self) -> Path:
        """The file being written."""
        return self._sink.path

    @property
    def size(self) -> int:
        """Bytes in the file so far."""
        return self._sink.position

    @property
    def newest_ns(self) -> int:
        """Newest time of reception in the file, UTC; 0 before the first."""
        return int(self._chunk[kernel.LAST_LOG])

    @property
    def lost(self) -> Lost:
        """What the disk did not take, of all files; final after `close`."""
        sinks = (*self._ending, self._sink)
        return Lost(sum(sink.lost.bytes for sink in sinks), sum(sink.lost.messages for sink in sinks))

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
        RecordingError if an earlier chunk could not be written; nothing of this call is taken then.
        """
        self._check()
        if self._undescribed >= max(_DESCRIBED_EVERY, len(self._channels)):
            self._describe()
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
                self._buffer.out,
                self._buffer.index,
                account.form,
                account.runs,
                account.run_bytes,
                chunk,
                account.state,
            )
            if status == kernel.DONE:
                if self._opened is None and chunk[kernel.CHUNK_START] >= 0:
                    self._opened = time.monotonic()
                return
            if status == kernel.CHUNK_FULL:
                self._close_chunk()
            else:
                self._add_channel(account, frames, int(chunk[kernel.FRAME]))

    def tick(self, now_ns: int) -> None:
        """Close the open chunk if it is old enough: call now and then, so that an idle link is on disk too.

        It is old enough by `now_ns`, or by a clock that nobody sets.
        """
        self._check()
        start = int(self._chunk[kernel.CHUNK_START])
        waited = 0.0 if self._opened is None else time.monotonic() - self._opened
        if start >= 0 and (now_ns - start >= int(self._chunk[kernel.PERIOD]) or waited >= self._chunk_seconds):
            self._close_chunk()

    def flush(self) -> None:
        """Close the open chunk and wait until all that was written is in the file."""
        self._close_open_chunk()
        self._sink.flush()
        self._check()

    def attach(self, name: str, media_type: str, data: bytes, log_time: int | None = None) -> None:
        """Put a file into the recording, as the vehicle file that a flight was flown with.

        log_time: UTC in ns, by default that of the newest message.
        """
        self._close_open_chunk()
        at = max(int(self._chunk[kernel.LAST_LOG]), 0) if log_time is None else log_time
        self._sink.put_attachment(Attachment(at, at, name, media_type, data))

    def metadata(self, name: str, mapping: Mapping[str, str]) -> None:
        """Put named pairs of text into the recording."""
        self._close_open_chunk()
        self._sink.put_metadata(name, mapping)

    def roll(self, path: str | os.PathLike[str], *, new_time: bool = False) -> None:
        """Complete this file and go on in another, as if it were one: counters and places in the streams go on.

        new_time: times may step back there, since this computer's clock was set back.
        RecordingError if the other cannot be created; the first is then still being written.
        """
        following = self._open(Path(path))
        self._close_open_chunk()
        self._sink.finish(tuple(self._schemas.values()), self._channels)
        self._ending.append(self._sink)
        self._sink = following
        self._buffer = following.take_buffer()
        self._wire_counts = dict.fromkeys(self._wire_counts, 0)
        if new_time:
            self._chunk[kernel.LAST_LOG] = 0
        self._describe()

    def close(self) -> None:
        """Write what is open, the summary and the footer, and wait for it. Closing twice does nothing."""
        if self._closed:
            return
        self._closed = True
        self._close_open_chunk()
        self._sink.finish(tuple(self._schemas.values()), self._channels)
        for sink in (*self._ending, self._sink):
            sink.wait()
        self._check()

    def _check(self) -> None:
        """Raise what went wrong in the background."""
        for sink in (*self._ending, self._sink):
            sink.check()

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
        full = len(self._channels) >= _MOST_CHANNELS
        if number < 0 and self._components >= (_FIRST_COMPONENTS if full else _MOST_COMPONENTS):
            link.component_of[system << 8 | component] = kernel.KEPT_AS_BYTES
            self._say_that_it_is_full()
            return
        if number < 0:
            number = self._components
            self._components += 1
            link.component_of[system << 8 | component] = number
            if number == self._channel_of.shape[0]:
                self._channel_of = np.concatenate((self._channel_of, np.full_like(self._channel_of, -1)))
                self._sequences = np.concatenate((self._sequences, sequence_states(number)))
        if full and number >= _FIRST_COMPONENTS:
            self._channel_of[number, int(frames.message[i])] = kernel.KEPT_AS_BYTES
            self._say_that_it_is_full()
            return
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

    def _say_that_it_is_full(self) -> None:
        if not self._is_full:
            self._is_full = True
            text = "%s: more than %d components or %d messages of theirs; what further ones send is kept as bytes"
            _log.warning(text, self.path.name, _MOST_COMPONENTS, _MOST_CHANNELS)

    def _schema(self, name: str, text: str) -> Schema:
        schema = self._schemas.get(name)
        if schema is None:
            schema = Schema(len(self._schemas) + 1, text.encode(), "ros2msg", name)
            self._schemas[name] = schema
            self._append(packed(schema))
        return schema

    def _register(self, schema: Schema, topic: str, metadata: dict[str, str]) -> int:
        number = len(self._channels) + 1
        channel = Channel(number, topic, "cdr", metadata, schema.id)
        self._channels.append(channel)
        if number == self._channel_state.shape[0]:
            self._channel_state = np.concatenate((self._channel_state, np.zeros_like(self._channel_state)))
        self._append(packed(channel))
        return number

    def _describe(self) -> None:
        """Say what all channels are, so that the file can be read without the chunk that said it first."""
        for entry in (*self._schemas.values(), *self._channels):
            self._append(packed(entry))
        self._undescribed = 0

    def _append(self, content: bytes) -> None:
        """Put a record into the open chunk, which grows if it must."""
        start = int(self._chunk[kernel.OUT_POS])
        if start + len(content) > self._buffer.out.size:
            more = np.empty(max(len(content), CHUNK_BYTES), np.uint8)
            self._buffer.out = np.concatenate((self._buffer.out, more))
        self._buffer.out[start : start + len(content)] = np.frombuffer(content, np.uint8)
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
        self._append(packed(Message(link.wire_channel, log, data, log, sequence)))
        self._wire_counts[link.wire_channel] = sequence + 1
        link.first_byte = int(state[kernel.STREAM_BYTES])
        state[kernel.FORM_COUNT] = state[kernel.RUN_COUNT_] = state[kernel.RUN_BYTES] = 0
        return entry

    def _close_open_chunk(self) -> None:
        if int(self._chunk[kernel.CHUNK_START]) >= 0 or int(self._chunk[kernel.OUT_POS]) > 0:
            self._close_chunk()

    def _close_chunk(self) -> None:
        chunk = self._chunk
        accounts = [link for link in self._links.values() if link.has_account]
        stream_bytes = sum(int(link.state[kernel.STREAM_BYTES]) - link.first_byte for link in accounts)
        entries = [self._append_wire(link) for link in accounts]
        start = max(int(chunk[kernel.CHUNK_START]), 0)
        self._sink.put_chunk(
            ClosedChunk(
                self._buffer,
                int(chunk[kernel.OUT_POS]),
                int(chunk[kernel.INDEX_COUNT]),
                entries,
                start,
                int(chunk[kernel.LAST_LOG]) if entries else start,
                len(self._channels),
                stream_bytes,
            )
        )
        self._buffer = self._sink.take_buffer()
        chunk[kernel.OUT_POS] = chunk[kernel.INDEX_COUNT] = 0
        chunk[kernel.CHUNK_START] = -1
        self._opened = None
        self._undescribed += 1


__all__ = ["Counts", "Lost", "McapWriter"]
