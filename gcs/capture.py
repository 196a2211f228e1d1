"""Recording everything that some links bring into one file, without cutting it into flights."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from gcs.datagrams import Batch
from gcs.dialect import Dialect
from gcs.errors import RecordingError
from gcs.frameparts import frame_times
from gcs.framing import Framer
from gcs.links import Link
from gcs.recording.writer import McapWriter
from gcs.station import Station


class Capture:
    """One MCAP of several links. Thread-safe; after `close` nothing is taken any more."""

    def __init__(self, path: Path, dialect: Dialect) -> None:
        self._writer = McapWriter(path, dialect)
        self._dialect = dialect
        self._framers: dict[str, Framer] = {}
        self._lock = threading.Lock()
        self.problem: RecordingError | None = None

    @property
    def messages(self) -> int:
        """MAVLink messages recorded so far."""
        return self._writer.counts.messages

    @property
    def bytes(self) -> int:
        """Bytes received so far."""
        return self._writer.counts.bytes

    def take(self, link: str, batch: Batch) -> None:
        """Record what a link received. A file that cannot be written shows in `problem`."""
        with self._lock:
            framer = self._framers.setdefault(link, Framer(self._dialect))
            held = framer.pending
            buffer, frames = framer.feed(batch.data)
            times: np.ndarray[tuple[int], np.dtype[np.int64]] | int
            times = frame_times(frames, batch, held) if len(frames) else int(batch.received_ns[-1])
            try:
                self._writer.write(link, buffer, frames, times)
            except RecordingError as error:
                self.problem = error

    def tick(self, now_ns: int) -> None:
        """Put what waits on disk."""
        with self._lock:
            try:
                self._writer.tick(now_ns)
            except RecordingError as error:
                self.problem = error

    def close(self, now_ns: int) -> None:
        """Take the unfinished ends of all links and complete the file."""
        with self._lock:
            for link, framer in self._framers.items():
                buffer, frames = framer.flush()
                if buffer.size:
                    self._writer.write(link, buffer, frames, now_ns)
            self._writer.close()


def record(
    links: Sequence[Link],
    path: Path,
    duration_s: float | None,
    progress: Callable[[float, Capture], None],
) -> Capture:
    """Record until `duration_s` is over or KeyboardInterrupt; the finished capture. Raises RecordingError.

    progress: called about twice a second with the seconds so far.
    """
    if path.exists() and path.stat().st_size > 0:
        raise RecordingError(f"{path} exists already; choose another name, or remove it first")
    capture = Capture(path, Dialect.load())
    station = Station(links, capture.take, capture.tick)
    station.start()
    started = time.monotonic()
    pause = threading.Event()
    try:
        while (passed := time.monotonic() - started) < (duration_s if duration_s is not None else float("inf")):
            if capture.problem is not None:
                raise capture.problem
            progress(passed, capture)
            pause.wait(0.5 if duration_s is None else min(0.5, duration_s - passed))
    except KeyboardInterrupt:
        pass  # being told to stop is how a recording without a duration ends
    finally:
        station.stop()
        capture.close(time.time_ns())
    return capture
