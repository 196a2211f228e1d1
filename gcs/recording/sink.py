"""The file that a recording goes to: a thread of its own compresses closed chunks and writes them, in order.

The thread that receives only hands buffers over, so it waits neither for the compressor nor for the disk. What the
disk refuses ends the file: it is cut back to its last whole record and completed as far as there is room.
"""

from __future__ import annotations

import contextlib
import errno
import os
import queue
import threading
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from numpy.typing import NDArray

from gcs.errors import DiskFullError, RecordingError
from gcs.portable import free_bytes
from gcs.recording import build as kernel
from gcs.recording import records
from gcs.recording.records import ChunkInfo, packed
from gcs.recording.storage import SyncPolicy
from gcs.text.sizes import size_text

CHUNK_BYTES = 1 << 20
INDEX_ENTRIES = CHUNK_BYTES // (kernel.RECORD_HEADER + 1)
_OUT_BYTES = CHUNK_BYTES + (1 << 16)
_NICENESS = 5
_FULL = (errno.ENOSPC, errno.EDQUOT)

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


class ChunkBuffer:
    """Room for one chunk: its records, and (channel, log time, place) of each of its messages."""

    def __init__(self) -> None:
        self.out: Bytes = np.empty(_OUT_BYTES, np.uint8)
        self.index: Ints = np.empty((INDEX_ENTRIES, 3), np.int64)


@dataclass(frozen=True)
class ClosedChunk:
    """A chunk that is full or old enough: `size` bytes of `buffer.out`, `count` rows of `buffer.index`.

    wire: further rows, of the links' accounts. start, end: log times, ns. stream_bytes: bytes of all links in it.
    """

    buffer: ChunkBuffer
    size: int
    count: int
    wire: Sequence[tuple[int, int, int]]
    start: int
    end: int
    channels: int
    stream_bytes: int


@dataclass(frozen=True)
class Lost:
    """What a failing disk did not take: bytes of the links, and MAVLink messages."""

    bytes: int = 0
    messages: int = 0


def _compressor(name: str) -> tuple[str, Callable[[memoryview], bytes]]:
    if name == "zstd":
        return "zstd", zstandard.ZstdCompressor(level=1).compress
    if name == "lz4":
        return "lz4", lambda data: bytes(lz4.frame.compress(data))
    if name == "none":
        return "", bytes
    raise RecordingError(f"unknown compression {name!r}; use zstd, lz4 or none")


class RecordingSink:
    """One MCAP file being written.

    compression: zstd, lz4 or none. sync: when the disk must have it. reserve_bytes: free space that chunks leave, for
    the index of this file and for others. waiting: chunks that may wait for the disk before `take_buffer` blocks.
    RecordingError if the file cannot be created.
    """

    def __init__(self, path: Path, compression: str, sync: SyncPolicy, reserve_bytes: int, waiting: int) -> None:
        self.path = path
        self._compression, self._compress = _compressor(compression)
        self._sync = sync
        self._reserve = reserve_bytes
        self.position = 0
        self.lost = Lost()
        self._error: RecordingError | None = None
        self._raised = False
        self._checksum = 0
        self._counts = np.zeros(64, np.int64)
        self._first_log: int | None = None
        self._last_log = 0
        self._chunk_index: list[bytes] = []
        self._attachment_index: list[bytes] = []
        self._metadata_index: list[bytes] = []
        self._unsynced_since: float | None = None
        self._name_lasts = False
        self._free: queue.SimpleQueue[ChunkBuffer] = queue.SimpleQueue()
        self._may_wait = threading.Semaphore(waiting + 1)
        self._orders: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        try:
            # What another recording left is never written over; a name that was only reserved is taken.
            reserved = path.is_file() and not path.is_symlink() and path.stat().st_size == 0
            self._file = open(path, "wb" if reserved else "xb", buffering=0)  # noqa: SIM115 (closed by the thread)
        except FileExistsError:
            raise RecordingError(f"{path} exists already; choose another name, or remove it first") from None
        except OSError as error:
            raise self._named(error) from None
        try:
            self._put(records.MAGIC + packed(Header("ros2", records.LIBRARY)))
        except OSError as error:
            self._file.close()
            with contextlib.suppress(OSError):
                path.unlink()  # nothing is in it
            raise self._named(error) from None

    # What the writing thread of the program calls.

    def take_buffer(self) -> ChunkBuffer:
        """An empty buffer; waits while too many chunks wait for the disk."""
        self._may_wait.acquire()
        try:
            return self._free.get_nowait()
        except queue.Empty:
            return ChunkBuffer()

    def put_chunk(self, chunk: ClosedChunk) -> None:
        """Have a chunk compressed and written; its buffer is the sink's from now on."""
        self._order(lambda: self._store_chunk(chunk))

    def copy_chunk(self, data: bytes, info: ChunkInfo, index: Ints, channels: int) -> None:
        """Have the record of another file's chunk written as it is. index, channels: as of `index_of_chunk`."""
        self._order(lambda: self._store_copy(data, info, index, channels))

    def put_attachment(self, attachment: Attachment) -> None:
        """Have a file inside the recording written."""
        self._order(lambda: self._store_attachment(attachment))

    def put_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Have named pairs of text written."""
        content = packed(Metadata(name, dict(values)))
        self._order(lambda: self._store_metadata(name, content))

    def flush(self) -> None:
        """Wait until all that was put is in the file, or lost; `check` says which."""
        done = threading.Event()
        self._order(done.set)
        done.wait()

    def finish(self, schemas: Sequence[Schema], channels: Sequence[Channel]) -> None:
        """Have the file completed; `wait` waits for it. Nothing can be put after it."""
        definitions = (tuple(schemas), tuple(channels))
        self._order(lambda: self._complete(*definitions))
        self._orders.put(None)

    def wait(self) -> None:
        """Wait until the file is complete and closed."""
        if self._thread is not None:
            self._thread.join()

    def check(self) -> None:
        """Raise what went wrong in the meantime, once."""
        if self._error is not None and not self._raised:
            self._raised = True
            raise self._error

    # What the sink's thread does.

    def _order(self, work: Callable[[], None]) -> None:
        if self._thread is None:
            thread = threading.Thread(target=self._run, name=f"recording {self.path.name}", daemon=True)
            try:
                thread.start()
            except RuntimeError as error:
                raise RecordingError(f"{self.path} cannot be written: {error}") from None
            self._thread = thread
        self._orders.put(work)

    def _run(self) -> None:
        """Carry out the orders. Nothing that goes wrong ends the thread, for the one that receives waits for it."""
        _give_way()
        try:
            while True:
                try:
                    work = self._next()
                    if work is None:
                        return
                    work()
                except RecordingError as error:
                    self._error = self._error or error
                except Exception as error:
                    self._fail(error)
        finally:
            self._file.close()
            self._free = queue.SimpleQueue()

    def _next(self) -> Callable[[], None] | None:
        """The next order; what was written is forced to disk in the meantime when its time has come."""
        while True:
            due = self._sync_due()
            try:
                return self._orders.get(timeout=None if due is None else max(due - time.monotonic(), 0.0))
            except queue.Empty:
                self._synchronise()

    def _sync_due(self) -> float | None:
        if self._unsynced_since is None or self._sync.every_s is None:
            return None
        return self._unsynced_since + self._sync.every_s

    def _synchronise(self) -> None:
        self._unsynced_since = None
        try:
            os.fdatasync(self._file.fileno())
            if not self._name_lasts:
                _sync_folder(self.path.parent)
                self._name_lasts = True
        except OSError as error:
            self._fail(error)

    def _named(self, error: Exception) -> RecordingError:
        if not isinstance(error, OSError):
            return RecordingError(f"{self.path} cannot be written: {type(error).__name__}: {error}")
        kind = DiskFullError if error.errno in _FULL else RecordingError
        return kind(f"{self.path} cannot be written: {error.strerror}")

    def _fail(self, error: Exception) -> None:
        """Keep what is whole; everything put from now on is lost."""
        self._error = self._error or self._named(error)
        with contextlib.suppress(OSError):
            os.ftruncate(self._file.fileno(), self.position)
            os.lseek(self._file.fileno(), self.position, os.SEEK_SET)

    def _put(self, data: bytes) -> None:
        """Write whole records."""
        view = memoryview(data)
        while view:
            view = view[self._file.write(view) :]
        self.position += len(data)
        self._checksum = zlib.crc32(data, self._checksum)
        if self._unsynced_since is None:
            self._unsynced_since = time.monotonic()

    def _store_chunk(self, chunk: ClosedChunk) -> None:
        stored = False
        try:
            if self._error is None:
                self._write_chunk(chunk)
                stored = True
        finally:
            if not stored:
                self.lost = Lost(self.lost.bytes + chunk.stream_bytes, self.lost.messages + chunk.count)
            if chunk.buffer.out.size == _OUT_BYTES and self._free.qsize() < 2:
                self._free.put(chunk.buffer)
            self._may_wait.release()
        due = self._sync_due()
        if stored and due is not None and time.monotonic() >= due:
            self._synchronise()

    def _write_chunk(self, chunk: ClosedChunk) -> None:
        content = memoryview(chunk.buffer.out.data)[: chunk.size]
        compressed = self._compress(content)
        data = records.chunk_record(chunk.start, chunk.end, content, self._compression, compressed)
        index = chunk.buffer.index[: chunk.count]
        if chunk.wire:
            index = np.concatenate((index, np.array(chunk.wire, np.int64)))
        info = ChunkInfo(
            self.position, len(data), chunk.start, chunk.end, self._compression, len(compressed), chunk.size
        )
        self._put_indexed(data, info, index, chunk.channels)

    def _put_indexed(self, data: bytes, info: ChunkInfo, index: Ints, channels: int) -> None:
        """Write a chunk's record and behind it the index of its messages."""
        offsets, index_data = index_of_chunk(index, channels, self.position + len(data))
        self._leave_reserve(len(data) + len(index_data))
        self._put(data + index_data)
        self._chunk_index.append(_chunk_index_record(info, offsets, len(index_data)))
        if channels >= self._counts.size:
            self._counts = np.concatenate((self._counts, np.zeros(channels, np.int64)))
        self._counts += np.bincount(index[:, 0], minlength=self._counts.size)
        if len(index):
            self._last_log = max(self._last_log, info.end_ns)
            if self._first_log is None:
                self._first_log = info.start_ns

    def _store_copy(self, data: bytes, info: ChunkInfo, index: Ints, channels: int) -> None:
        if self._error is None:
            self._put_indexed(data, replace(info, offset=self.position), index, channels)

    def _leave_reserve(self, size: int) -> None:
        """DiskFullError if writing `size` bytes would leave less than the reserve."""
        if not self._reserve:
            return
        free = free_bytes(self._file, self.path)
        if free is not None and free < self._reserve + size:
            raise DiskFullError(
                f"{self.path} is not written further: the disk has {size_text(free)} left, and"
                f" {size_text(self._reserve)} are kept in reserve; free some space"
            )

    def _store_attachment(self, attachment: Attachment) -> None:
        if self._error is None:
            content = packed(attachment)
            self._leave_reserve(len(content))
            entry = AttachmentIndex(
                offset=self.position,
                length=len(content),
                log_time=attachment.log_time,
                create_time=attachment.create_time,
                data_size=len(attachment.data),
                name=attachment.name,
                media_type=attachment.media_type,
            )
            self._put(content)
            self._attachment_index.append(packed(entry))

    def _store_metadata(self, name: str, content: bytes) -> None:
        if self._error is None:
            entry = packed(MetadataIndex(self.position, len(content), name))
            self._put(content)
            self._metadata_index.append(entry)

    def _complete(self, schemas: Sequence[Schema], channels: Sequence[Channel]) -> None:
        """The end of the data, the summary and the footer. Where there is no room for it, readers do without."""
        tail = packed(DataEnd(self._checksum))
        self._put(tail + records.summary_section(self._summary(schemas, channels), self.position + len(tail)))
        if self._sync.at_close:
            self._synchronise()

    def _summary(self, schemas: Sequence[Schema], channels: Sequence[Channel]) -> list[bytes]:
        counts = {
            channel.id: int(self._counts[channel.id]) if channel.id < self._counts.size else 0 for channel in channels
        }
        statistics = Statistics(
            message_count=sum(counts.values()),
            schema_count=len(schemas),
            channel_count=len(counts),
            attachment_count=len(self._attachment_index),
            metadata_count=len(self._metadata_index),
            chunk_count=len(self._chunk_index),
            message_start_time=self._first_log or 0,
            message_end_time=self._last_log,
            channel_message_counts=counts,
        )
        indexes = (self._chunk_index, self._attachment_index, self._metadata_index)
        return [packed(*schemas), packed(*channels), packed(statistics), *map(b"".join, indexes)]


def _chunk_index_record(chunk: ChunkInfo, index_offsets: dict[int, int], index_length: int) -> bytes:
    """index_offsets: channel -> place in the file of its message index record."""
    return packed(
        ChunkIndex(
            message_start_time=chunk.start_ns,
            message_end_time=chunk.end_ns,
            chunk_start_offset=chunk.offset,
            chunk_length=chunk.length,
            message_index_offsets=index_offsets,
            message_index_length=index_length,
            compression=chunk.compression,
            compressed_size=chunk.compressed_size,
            uncompressed_size=chunk.uncompressed_size,
        )
    )


def index_of_chunk(index: Ints, channels: int, base: int) -> tuple[dict[int, int], bytes]:
    """Message index records of a chunk, and where each channel's begins in the file.

    index: (N, 3) channel, log time, place in the chunk. channels: largest channel number. base: place in the file
    of the first index record.
    """
    places = np.empty(channels + 1, np.int64)
    out = np.empty(16 * len(index) + 15 * places.size, np.uint8)
    length = int(kernel.index_records(index, len(index), places.size, places, out))
    offsets = {channel: base + int(places[channel]) for channel in np.flatnonzero(places >= 0).tolist()}
    return offsets, out[:length].tobytes()


def _give_way() -> None:
    """Let the threads that receive go before this one: what waits for the disk is not lost, a full socket's bytes are.

    On Linux a priority is that of one thread (setpriority(2), "C library/kernel differences").
    """
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)


def _sync_folder(folder: Path) -> None:
    """Make the file's name last as well, where the file system can; that it cannot is no reason to stop recording."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
