"""The recorder: bytes from every link, cut into flights, one MCAP each; and the catalogue kept up to date.

Frames of two vehicles on one link go to two flights. What belongs to no vehicle (a ground station, a radio, noise)
stays with the flight in whose stream it came, so nothing received is in no file.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.catalogue import Catalogue, Flight
from gcs.datagrams import Batch
from gcs.dialect import Dialect
from gcs.errors import GcsError
from gcs.framing import Framer, Frames
from gcs.intake import flight_stamp, unused_id
from gcs.linkstats import LinkStatistics
from gcs.recording.writer import McapWriter
from gcs.segmentation import FlightSegmenter, Heartbeat, heartbeats

_log = logging.getLogger(__name__)

_CATALOGUE_NS = 1_000_000_000
# Held-back bytes of an unfinished frame are taken as they are once the link has been idle this long.
_IDLE_NS = 1_000_000_000


@dataclass
class _Live:
    """A flight that is being recorded."""

    id: str
    path: Path
    writer: McapWriter
    segmenter: FlightSegmenter
    system: int
    start_ns: int
    end_ns: int
    catalogued_ns: int = 0


@dataclass
class _Source:
    """A link (by name) as the recorder sees it. `flight`: where bytes that belong to no vehicle go."""

    framer: Framer
    statistics: LinkStatistics
    flight: _Live | None = None
    last_ns: int = 0


@dataclass
class RecorderState:
    """Counts of what went wrong, for /api/health."""

    problem: str = ""
    unrecorded_bytes: int = 0
    ground_stations: set[int] = field(default_factory=set)
    vehicles: set[int] = field(default_factory=set)


class FlightRecorder:
    """Cuts bytes into flights and writes them. Knows no sockets; time comes with the bytes and with `tick`.

    on_flight_end: called with each flight that has ended, after it is in the catalogue.
    """

    def __init__(
        self,
        folder: Path,
        dialect: Dialect,
        catalogue: Catalogue,
        *,
        silence_s: float = 10.0,
        disarm_s: float = 2.0,
        on_flight_end: Callable[[Flight], None] = lambda flight: None,
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._dialect = dialect
        self._catalogue = catalogue
        self._silence_ns = round(silence_s * 1e9)
        self._disarm_ns = round(disarm_s * 1e9)
        self._on_flight_end = on_flight_end
        self._lock = threading.RLock()
        self._sources: dict[str, _Source] = {}
        self._live: list[_Live] = []
        self.state = RecorderState()

    def _source(self, name: str) -> _Source:
        with self._lock:
            if name not in self._sources:
                self._sources[name] = _Source(Framer(self._dialect), LinkStatistics(self._dialect))
            return self._sources[name]

    def feed(self, link: str, batch: Batch) -> None:
        """Record what a link received."""
        source = self._source(link)
        held = source.framer.pending
        buffer, frames = source.framer.feed(batch.data)
        received = frame_times(frames, batch, held)
        source.last_ns = int(batch.received_ns[-1])
        self._take(link, source, buffer, frames, received, int(batch.received_ns[0]))

    def _take(
        self,
        link: str,
        source: _Source,
        buffer: NDArray[np.uint8],
        frames: Frames,
        received: NDArray[np.int64],
        now_ns: int,
    ) -> None:
        source.statistics.add(frames, received)
        if buffer.size == 0:
            return
        with self._lock:
            try:
                self._end_due(now_ns)
                beats = heartbeats(frames)
                self._learn(beats)
                for start, stop in self._runs(source, frames):
                    self._write_run(link, source, frames, received, (start, stop), beats, now_ns)
                self.state.problem = ""
            except (GcsError, OSError) as error:
                self._abandon(source, buffer.size, error)

    def _learn(self, beats: Sequence[Heartbeat]) -> None:
        for beat in beats:
            if beat.ground_station:
                self.state.ground_stations.add(beat.system)
            else:
                self.state.vehicles.add(beat.system)

    def _runs(self, source: _Source, frames: Frames) -> list[tuple[int, int]]:
        """Ranges of frames that belong together: one, unless several vehicles share the link."""
        count = len(frames)
        if count == 0:
            return [(0, 0)]
        systems = frames.sysid
        if (systems == systems[0]).all():
            return [(0, count)]
        owner = np.where(np.isin(systems, list(self.state.vehicles)), systems.astype(np.int64), -1)
        seen = np.flatnonzero(owner >= 0)
        if seen.size == 0 or (owner[seen] == owner[seen[0]]).all():
            return [(0, count)]
        # A frame of no vehicle stays with the one before it.
        last = np.maximum.accumulate(np.where(owner >= 0, np.arange(count), -1))
        owner = np.where(last >= 0, owner[np.maximum(last, 0)], owner[seen[0]])
        cuts = np.flatnonzero(np.diff(owner)) + 1
        return list(zip([0, *cuts.tolist()], [*cuts.tolist(), count], strict=True))

    def _write_run(
        self,
        link: str,
        source: _Source,
        frames: Frames,
        received: NDArray[np.int64],
        run: tuple[int, int],
        beats: Sequence[Heartbeat],
        now_ns: int,
    ) -> None:
        """Write one range of frames, and the bytes around them, to the flight they belong to."""
        part = _slice(frames, *run)
        times = received[run[0] : run[1]]
        live = self._flight_for(source, part, int(times[0]) if times.size else now_ns)
        own = [beat for beat in beats if run[0] <= beat.index < run[1] and not beat.ground_station]
        before_reset = live.segmenter.clock_reset(link, part)
        if before_reset is not None:
            cut = run[0] + before_reset
            if before_reset > 0:
                self._write(link, live, _slice(frames, run[0], cut), received[run[0] : cut], own, now_ns)
            self._end(live, "clock reset")
            self._write_run(link, source, frames, received, (cut, run[1]), beats, now_ns)
            return
        self._write(link, live, part, times, own, now_ns)

    def _write(
        self,
        link: str,
        live: _Live,
        part: Frames,
        times: NDArray[np.int64],
        beats: Sequence[Heartbeat],
        now_ns: int,
    ) -> None:
        newest = int(times[-1]) if times.size else now_ns
        live.writer.write(link, part.buffer, part, times if times.size else now_ns)
        live.end_ns = max(live.end_ns, newest)
        for beat in beats:
            live.segmenter.heartbeat(beat, newest)
        # Once the vehicle is known, only it keeps its flight going: a radio or ground station may talk for hours.
        if live.segmenter.system is None or (part.sysid == live.segmenter.system).any():
            live.segmenter.heard(newest)

    def _flight_for(self, source: _Source, part: Frames, now_ns: int) -> _Live:
        """The flight that these frames belong to; a new one if there is none."""
        vehicle = next((s for s in part.sysid.tolist() if s in self.state.vehicles), None)
        if vehicle is None:
            live = source.flight if source.flight in self._live else (self._live[-1] if self._live else None)
            if live is not None:
                return live
        else:
            live = next((live for live in self._live if live.segmenter.system == vehicle), None)
            if live is None:
                live = self._adopt(now_ns)
            if live is not None:
                source.flight = live
                return live
        live = self._begin(vehicle, part, now_ns)
        source.flight = live
        return live

    def _adopt(self, now_ns: int) -> _Live | None:
        """The flight that was begun a moment before its vehicle was known; an old one without a vehicle is ended."""
        live = next((live for live in self._live if live.segmenter.system is None), None)
        if live is not None and now_ns - live.start_ns > self._silence_ns:
            self._end(live, "no vehicle")
            return None
        return live

    def _begin(self, vehicle: int | None, part: Frames, now_ns: int) -> _Live:
        system = vehicle if vehicle is not None else int(part.sysid[0]) if len(part) else 0
        flight_id = self._new_id(now_ns, system)
        path = self._folder / f"{flight_id}.mcap"
        segmenter = FlightSegmenter(self._dialect, self._silence_ns, self._disarm_ns)
        segmenter.system = vehicle
        segmenter.heard(now_ns)
        live = _Live(flight_id, path, McapWriter(path, self._dialect), segmenter, system, now_ns, now_ns)
        self._live.append(live)
        self._store(live, "recording", "")
        _log.info("flight %s begins", flight_id)
        return live

    def _new_id(self, now_ns: int, system: int) -> str:
        return unused_id(f"{flight_stamp(now_ns)}-{system}", self._folder, self._catalogue)

    def _store(self, live: _Live, state: str, reason: str) -> Flight:
        flight = Flight(
            id=live.id,
            file=live.path.name,
            name=live.path.name,
            source="live",
            state=state,
            system=live.segmenter.system,
            start_ns=live.start_ns,
            end_ns=live.end_ns,
            messages=live.writer.counts.messages,
            bytes=live.writer.size,
            end_reason=reason,
        )
        self._catalogue.put_flight(flight)
        live.catalogued_ns = live.end_ns
        return flight

    def _end(self, live: _Live, reason: str) -> None:
        self._live.remove(live)
        for source in self._sources.values():
            if source.flight is live:
                source.flight = None
        try:
            live.writer.close()
        except (GcsError, OSError) as error:
            self._fail(error)
        flight = self._store(live, "complete", reason)
        _log.info("flight %s ends (%s)", live.id, reason)
        self._on_flight_end(flight)

    def _end_due(self, now_ns: int) -> None:
        for live in list(self._live):
            reason = live.segmenter.end_reason(now_ns)
            if reason is not None:
                self._end(live, reason)

    def _abandon(self, source: _Source, lost_bytes: int, error: Exception) -> None:
        """A file that cannot be written must not end the service: say so, and try a new file with the next bytes."""
        self._fail(error)
        self.state.unrecorded_bytes += lost_bytes
        live, source.flight = source.flight, None
        if live is not None and live in self._live:
            self._discard(live)

    def _fail(self, error: Exception) -> None:
        self.state.problem = str(error)
        _log.error("cannot record: %s", error)

    def _discard(self, live: _Live) -> None:
        """Give up a file that cannot be written; what is in it is found again at the next start."""
        self._live.remove(live)
        with contextlib.suppress(GcsError, OSError):
            live.writer.close()

    def tick(self, now_ns: int) -> None:
        """Let time pass: write what waits, end what is over. To be called a few times each second."""
        with self._lock:
            for name, source in self._sources.items():
                if source.framer.pending and now_ns - source.last_ns > _IDLE_NS:
                    self._flush(name, source, now_ns)
            for live in list(self._live):
                try:
                    live.writer.tick(now_ns)
                    if live.end_ns - live.catalogued_ns >= _CATALOGUE_NS:
                        self._store(live, "recording", "")
                except (GcsError, OSError) as error:
                    self._fail(error)
                    self._discard(live)
            self._end_due(now_ns)

    def _flush(self, name: str, source: _Source, now_ns: int) -> None:
        buffer, frames = source.framer.flush()
        self._take(name, source, buffer, frames, np.full(len(frames), source.last_ns, np.int64), now_ns)

    def close(self, now_ns: int) -> None:
        """End every flight: the service stops."""
        with self._lock:
            for name, source in self._sources.items():
                self._flush(name, source, now_ns)
            for live in list(self._live):
                self._end(live, "service stopped")

    def live_flights(self) -> list[str]:
        """Ids of the flights being recorded now."""
        with self._lock:
            return [live.id for live in self._live]

    def statistics(self, link: str, now_ns: int) -> dict[str, object]:
        """Statistics of a link as JSON."""
        return self._source(link).statistics.to_json(now_ns)


def _slice(frames: Frames, start: int, stop: int) -> Frames:
    """Frames start..stop-1 with the bytes up to the next frame; the first range also takes the bytes in front."""
    begin = 0 if start == 0 else int(frames.offset[start])
    end = frames.consumed if stop == len(frames) else int(frames.offset[stop])
    part = slice(start, stop)
    return Frames(
        frames.buffer[begin:end],
        frames.offset[part] - begin,
        frames.length[part],
        frames.msgid[part],
        frames.message[part],
        frames.kind[part],
        consumed=end - begin,
        bad_crc=0,
    )


def frame_times(frames: Frames, batch: Batch, held: int) -> NDArray[np.int64]:
    """(N,) UTC ns at which the last byte of each frame came. held: bytes in front of the batch's own."""
    last_byte = frames.offset + frames.length - 1 - held
    index = np.searchsorted(batch.ends, last_byte, side="right")
    return batch.received_ns[np.minimum(index, batch.ends.size - 1)]
