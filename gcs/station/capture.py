"""Recording everything that some links bring, without cutting it into flights."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.clock.track import ClockTracker, clock_metadata
from gcs.errors import RecordingError
from gcs.links.datagrams import Batch
from gcs.links.opening import Link
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.frameparts import frame_times
from gcs.mavlink.framing import Framer, Frames
from gcs.mavlink.linkoptions import LinkOptions
from gcs.mavlink.signing import SignatureChecker, SignatureCounts, SignatureMemory
from gcs.recording.parts import Provenance, RecordingParts
from gcs.recording.storage import StorageOptions
from gcs.station.own_sender import StationVoice
from gcs.station.provenance import provenance
from gcs.station.station import Station
from gcs.station.warmup import warm_up

# Held-back bytes of an unfinished frame are taken as they are once the link has been idle this long.
_IDLE_NS = 1_000_000_000
# A clock that steps back by more was set; less may be one datagram that overtook another.
_SET_BACK_NS = 1_000_000_000


@dataclass
class _Source:
    """One source. checker: where there is a key. last_ns: newest time of reception."""

    framer: Framer
    clocks: ClockTracker
    checker: SignatureChecker | None = None
    last_ns: int = 0


class Capture:
    """One recording of several links. Thread-safe; after `close` nothing is taken any more.

    now_ns: UTC of its beginning. key: what signatures are checked with.
    """

    def __init__(
        self,
        path: Path,
        dialect: Dialect,
        storage: StorageOptions | None = None,
        origin: Provenance | None = None,
        now_ns: int = 0,
        key: bytes | None = None,
    ) -> None:
        self._writer = RecordingParts(path, dialect, storage or StorageOptions(), origin or Provenance(), now_ns)
        self._dialect = dialect
        self._key = key
        self._signatures = SignatureMemory()
        self._sources: dict[str, _Source] = {}
        self._ticked_ns = 0
        self._closed = False
        self._lock = threading.Lock()
        self.problem: RecordingError | None = None

    @property
    def messages(self) -> int:
        """MAVLink messages recorded so far."""
        return self._writer.counts.messages - self._writer.lost.messages

    @property
    def parts(self) -> list[Path]:
        """Its files."""
        return self._writer.parts

    @property
    def bytes(self) -> int:
        """Bytes received so far."""
        return self._writer.counts.bytes

    @property
    def signatures(self) -> SignatureCounts:
        """Frames by their signatures, where there is a key to check them with."""
        total = SignatureCounts()
        for source in list(self._sources.values()):
            if source.checker is not None:
                total = total + source.checker.counts
        return total

    def take(self, link: str, batch: Batch) -> None:
        """Record what a link received. A file that cannot be written shows in `problem`."""
        with self._lock:
            if self._closed:
                return
            source = self._sources.setdefault(link, _Source(Framer(self._dialect), ClockTracker(self._dialect)))
            now_ns, before_ns = int(batch.received_ns[0]), source.last_ns
            source.last_ns = int(batch.received_ns.max())
            if now_ns < before_ns - _SET_BACK_NS:
                self._clock_set_back(now_ns)
            held = source.framer.pending
            buffer, frames = source.framer.feed(batch.data)
            times = frame_times(frames, batch.ends, batch.received_ns, held)
            if len(frames):
                source.clocks.add(frames, times)
                if self._key is not None:
                    source.checker = source.checker or SignatureChecker(self._key, self._signatures)
                    source.checker.add(frames, times, int(np.count_nonzero(frames.incompat)))
            self._write(link, buffer, frames, times if len(frames) else int(batch.received_ns[-1]))

    def tick(self, now_ns: int) -> None:
        """Put what waits on disk, the unfinished ends of idle links too."""
        with self._lock:
            if self._closed:
                return
            if now_ns < self._ticked_ns - _SET_BACK_NS:
                self._clock_set_back(now_ns)
            self._ticked_ns = now_ns
            for link, source in self._sources.items():
                if source.framer.pending and abs(now_ns - source.last_ns) > _IDLE_NS:
                    buffer, frames = source.framer.flush()
                    self._write(link, buffer, frames, min(source.last_ns, now_ns))
            try:
                self._writer.tick(now_ns)
            except RecordingError as error:
                self.problem = error

    def _write(
        self, link: str, buffer: NDArray[np.uint8], frames: Frames, received_ns: int | NDArray[np.int64]
    ) -> None:
        try:
            self._writer.write(link, buffer, frames, received_ns)
        except RecordingError as error:
            self.problem = error

    def _clock_set_back(self, now_ns: int) -> None:
        """This computer's clock shows an earlier time than before: within a file the times shall not step back."""
        try:
            if self._writer.newest_ns > now_ns + _SET_BACK_NS:
                self._writer.clock_set_back(now_ns)
        except RecordingError as error:
            self.problem = error

    def close(self, now_ns: int) -> None:
        """Take the unfinished ends of all links and complete the file. Errors show in `problem`."""
        with self._lock:
            self._closed = True
            try:
                for link, source in self._sources.items():
                    buffer, frames = source.framer.flush()
                    if buffer.size:
                        self._writer.write(link, buffer, frames, now_ns)
                counts = self._writer.counts
                numbers = {"messages": counts.messages, "bytes": counts.bytes, "raw_bytes": counts.raw_bytes}
                statistics = {"statistics": {name: str(value) for name, value in numbers.items()}}
                clocks = (clock_metadata(link, source.clocks.states()) for link, source in self._sources.items())
                self._writer.close({**statistics, **{name: value for part in clocks for name, value in part.items()}})
            except RecordingError as error:
                self.problem = self.problem or error


@dataclass(frozen=True)
class CaptureOptions:
    """What to record in, and how. vehicle: vehicle file that goes in too."""

    path: Path
    duration_s: float | None = None
    vehicle: str | None = None
    link: LinkOptions = field(default_factory=LinkOptions)
    storage: StorageOptions = field(default_factory=StorageOptions)


def record(
    links: Sequence[Link],
    options: CaptureOptions,
    progress: Callable[[float, Capture], None],
    listen: Callable[[str, Batch], None] | None = None,
) -> Capture:
    """Record until the duration is over or KeyboardInterrupt; the finished capture.

    progress: called about twice a second with the seconds so far. listen: as of `Station`.
    RecordingError if the disk refuses; what came until then is in the file.
    """
    path = options.path
    if path.exists() and path.stat().st_size > 0:
        raise RecordingError(f"{path} exists already; choose another name, or remove it first")
    dialect = Dialect.load(options.link.dialect)
    warm_up(dialect)
    origin = provenance(dialect, [link.name for link in links], options.vehicle, options.link.dialect)
    capture = Capture(path, dialect, options.storage, origin, time.time_ns(), options.link.key)
    station = Station(links, capture.take, capture.tick, voice=StationVoice(options.link.own_key), listen=listen)
    station.start()
    started = time.monotonic()
    pause = threading.Event()
    duration_s = float("inf") if options.duration_s is None else options.duration_s
    try:
        while (passed := time.monotonic() - started) < duration_s and capture.problem is None:
            progress(passed, capture)
            pause.wait(min(0.5, duration_s - passed))
    except KeyboardInterrupt:
        pass  # being asked to stop is how a recording without a duration ends
    finally:
        station.stop()
        capture.close(time.time_ns())
    if capture.problem is not None:
        raise RecordingError(f"{capture.problem}; {capture.messages} messages until then are in {path}")
    return capture
