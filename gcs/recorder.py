"""The recorder: bytes from every link, cut into flights, one MCAP each; and the catalogue kept up to date.

Frames of two vehicles on one link go to two flights. What belongs to no vehicle (a ground station, a radio, noise)
stays with the flight in whose stream it came, so nothing received is in no file.
"""

from __future__ import annotations

import logging
import shutil
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.catalogue import Catalogue, Flight
from gcs.clocktrack import clock_metadata
from gcs.datagrams import Batch
from gcs.dialect import Dialect
from gcs.errors import CatalogueFileError, DiskFullError, GcsError
from gcs.frameparts import autopilots, frame_times, likely_vehicle, runs_by_vehicle, slice_frames
from gcs.framing import Framer, Frames
from gcs.intake import flight_stamp, unused_id
from gcs.linkstats import LinkStatistics
from gcs.liveflight import LiveFlight
from gcs.recording.parts import Metadata, Provenance, RecordingParts
from gcs.recording.storage import StorageOptions
from gcs.segmentation import FlightSegmenter, Heartbeat, heartbeats
from gcs.sizes import size_text
from gcs.sources import FORWARD

_log = logging.getLogger(__name__)

_CATALOGUE_NS = 1_000_000_000
# Held-back bytes of an unfinished frame are taken as they are once the link has been idle this long.
_IDLE_NS = 1_000_000_000
# After a disk has refused, this long until the next attempt.
_RETRY_NS = 1_000_000_000


@dataclass
class _Source:
    """A source (by name) as the recorder sees it.

    overheard: whether another ground station is behind it.
    flight: where bytes that belong to no vehicle go.
    """

    framer: Framer
    statistics: LinkStatistics
    overheard: bool
    flight: LiveFlight | None = None
    last_ns: int = 0


@dataclass
class RecorderState:
    """What goes wrong, for /api/health: `problem` in words, empty when all is well, and bytes that no file took."""

    problem: str = ""
    unrecorded_bytes: int = 0
    ground_stations: set[int] = field(default_factory=set)
    vehicles: set[int] = field(default_factory=set)


class FlightRecorder:
    """Cuts bytes into flights and writes them. Knows no sockets; time comes with the bytes and with `tick`.

    on_flight_end: called with each flight that has ended, after it is in the catalogue.
    storage, provenance: how recordings are kept, and what stands in each. key: what signatures are
    checked with.
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
        storage: StorageOptions | None = None,
        provenance: Provenance | None = None,
        key: bytes | None = None,
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._dialect = dialect
        self._catalogue = catalogue
        self._silence_ns = round(silence_s * 1e9)
        self._disarm_ns = round(disarm_s * 1e9)
        self._on_flight_end = on_flight_end
        self._storage = storage or StorageOptions()
        self._provenance = provenance or Provenance()
        self._key = key
        self._heard: set[int] = set()
        self._blocked_until_ns = 0
        self._unlisted: dict[str, Flight] = {}
        self._lock = threading.RLock()
        self._sources: dict[str, _Source] = {}
        self._live: list[LiveFlight] = []
        self.state = RecorderState()

    def _source(self, name: str) -> _Source:
        with self._lock:
            if name not in self._sources:
                statistics = LinkStatistics(self._dialect, self._key)
                overheard = name.startswith(FORWARD)
                self._sources[name] = _Source(Framer(self._dialect), statistics, overheard)
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
            self._end_due(now_ns)
            if source.overheard:
                self._overhear(link, frames, received, now_ns)
                return
            beats = heartbeats(frames)
            self._learn(frames, beats)
            for start, stop in runs_by_vehicle(frames, self.state.vehicles):
                self._write_run(link, source, frames, received, (start, stop), beats, now_ns)

    def _overhear(self, link: str, frames: Frames, received: NDArray[np.int64], now_ns: int) -> None:
        """What another ground station says goes into every flight that is going on; it begins and ends none."""
        part = slice_frames(frames, 0, len(frames))
        for live in list(self._live):
            try:
                live.writer.write(link, part.buffer, part, received if received.size else now_ns)
            except (GcsError, OSError) as error:
                self._stop(live, error, now_ns)

    def _learn(self, frames: Frames, beats: Sequence[Heartbeat]) -> None:
        """Who is a vehicle: by its HEARTBEAT, and where one is known already by the first word of an autopilot.

        Else a second vehicle's frames up to its HEARTBEAT would be in the first one's flight.
        """
        for beat in beats:
            if beat.ground_station:
                self.state.ground_stations.add(beat.system)
                self.state.vehicles.discard(beat.system)
            else:
                self.state.vehicles.add(beat.system)
        new = set(frames.systems) - self._heard
        if new:
            self._heard |= new
            if self.state.vehicles:
                self.state.vehicles |= (new & autopilots(frames)) - self.state.ground_stations

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
        part = slice_frames(frames, *run)
        times = received[run[0] : run[1]]
        live = self._flight_for(source, part, int(times[0]) if times.size else now_ns)
        if live is None:
            self.state.unrecorded_bytes += part.consumed
            return
        own = [beat for beat in beats if run[0] <= beat.index < run[1] and not beat.ground_station]
        before_reset = live.segmenter.clock_reset(link, part)
        if before_reset is not None:
            cut = run[0] + before_reset
            if before_reset > 0:
                self._write(link, live, slice_frames(frames, run[0], cut), received[run[0] : cut], own, now_ns)
            if live in self._live:
                self._end(live, "clock reset", now_ns)
            self._write_run(link, source, frames, received, (cut, run[1]), beats, now_ns)
            return
        self._write(link, live, part, times, own, now_ns)

    def _write(
        self,
        link: str,
        live: LiveFlight,
        part: Frames,
        times: NDArray[np.int64],
        beats: Sequence[Heartbeat],
        now_ns: int,
    ) -> None:
        newest = int(times[-1]) if times.size else now_ns
        try:
            live.writer.write(link, part.buffer, part, times if times.size else now_ns)
        except (GcsError, OSError) as error:
            self.state.unrecorded_bytes += part.consumed
            self._stop(live, error, now_ns)
            return
        live.end_ns = max(live.end_ns, newest)
        for beat in beats:
            live.segmenter.heartbeat(beat, newest)
        # Once the vehicle is known, only it keeps its flight going: a radio or ground station may talk for hours.
        if live.segmenter.system is None or live.segmenter.system in part.systems:
            live.segmenter.heard(newest)

    def _flight_for(self, source: _Source, part: Frames, now_ns: int) -> LiveFlight | None:
        """The flight that these frames belong to; a new one if there is none, None where the disk takes none."""
        vehicle = next((system for system in part.systems if system in self.state.vehicles), None)
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
        if now_ns < self._blocked_until_ns:
            return None
        try:
            live = self._begin(vehicle, part, now_ns)
        except (GcsError, OSError) as error:
            self._fail(error, now_ns)
            return None
        source.flight = live
        return live

    def _adopt(self, now_ns: int) -> LiveFlight | None:
        """The flight that was begun a moment before its vehicle was known; an old one without a vehicle is ended."""
        live = next((live for live in self._live if live.segmenter.system is None), None)
        if live is not None and now_ns - live.start_ns > self._silence_ns:
            self._end(live, "no vehicle", now_ns)
            return None
        return live

    def _begin(self, vehicle: int | None, part: Frames, now_ns: int) -> LiveFlight:
        self._check_room()
        flight_id = self._new_id(now_ns, likely_vehicle(part) if vehicle is None else vehicle)
        path = self._folder / f"{flight_id}.mcap"
        segmenter = FlightSegmenter(self._dialect, self._silence_ns, self._disarm_ns)
        segmenter.system = vehicle
        segmenter.heard(now_ns)
        writer = RecordingParts(path, self._dialect, self._storage, self._provenance, now_ns)
        live = LiveFlight(flight_id, writer, segmenter, now_ns, now_ns)
        self._live.append(live)
        self._store(live, "recording", "")
        _log.info("flight %s begins", flight_id)
        if self.state.problem:
            _log.warning("recording again; %d bytes were not recorded so far", self.state.unrecorded_bytes)
            self.state.problem = ""
        return live

    def _check_room(self) -> None:
        """DiskFullError while a new file would soon meet the reserve."""
        free = shutil.disk_usage(self._folder).free
        wanted = self._storage.reserve_bytes * 5 // 4
        if free < wanted:
            raise DiskFullError(
                f"{self._folder}: the disk has {size_text(free)} left, too little to record; free some space"
            )

    def _new_id(self, now_ns: int, system: int) -> str:
        return unused_id(f"{flight_stamp(now_ns)}-{system}", self._folder, self._catalogue)

    def _store(self, live: LiveFlight, state: str, reason: str) -> None:
        """Tell the catalogue how the flight stands."""
        self._list(live.entry(state, reason))
        live.catalogued_ns = live.end_ns

    def _list(self, *flights: Flight) -> None:
        """Put flights into the catalogue; what it cannot take now, it is given again at the next tick."""
        self._unlisted.update({flight.id: flight for flight in flights})
        for flight in list(self._unlisted.values()):
            try:
                self._catalogue.put_flight(flight)
            except CatalogueFileError as error:
                self._say(error)
                return
            del self._unlisted[flight.id]
            if flight.state != "recording":
                self._on_flight_end(flight)

    def _clocks_of(self, live: LiveFlight) -> Metadata:
        found: dict[str, dict[str, str]] = {}
        for name, source in self._sources.items():
            states = source.statistics.clocks(until_ns=live.end_ns)
            found |= clock_metadata(name, [state for state in states if state.system == live.segmenter.system])
        return found

    def _end(self, live: LiveFlight, reason: str, now_ns: int) -> None:
        self._live.remove(live)
        for source in self._sources.values():
            if source.flight is live:
                source.flight = None
        try:
            live.writer.close({**live.statistics(reason), **self._clocks_of(live)})
        except (GcsError, OSError) as error:
            self._fail(error, now_ns)
            reason = f"{reason}; the end is missing: {error}"
        lost = live.writer.lost.bytes
        self.state.unrecorded_bytes += lost
        if lost and live.writer.counts.bytes == lost:
            self._forget(live)
            return
        self._store(live, "complete", reason)
        _log.info("flight %s ends (%s)", live.id, reason)

    def _forget(self, live: LiveFlight) -> None:
        """A flight of which the disk took nothing is none."""
        self._unlisted.pop(live.id, None)
        try:
            for path in live.writer.parts:
                path.unlink(missing_ok=True)
            self._catalogue.remove_flight(live.id)
        except (CatalogueFileError, OSError) as error:
            self._say(error)

    def _end_due(self, now_ns: int) -> None:
        for live in list(self._live):
            reason = live.segmenter.end_reason(now_ns)
            if reason is not None:
                self._end(live, reason, now_ns)

    def _stop(self, live: LiveFlight, error: Exception, now_ns: int) -> None:
        """A file that cannot be written ends its flight, not the service; the next bytes begin another in a while."""
        self._fail(error, now_ns)
        self._end(live, f"recording stopped: {error}", now_ns)

    def _fail(self, error: Exception, now_ns: int) -> None:
        self._blocked_until_ns = now_ns + _RETRY_NS
        self._say(error)

    def _say(self, error: Exception) -> None:
        """Once, until it is over."""
        if not self.state.problem:
            self.state.problem = str(error)
            _log.error("cannot record: %s", error)

    def tick(self, now_ns: int) -> None:
        """Let time pass: write what waits, end what is over. To be called a few times each second."""
        with self._lock:
            for name, source in self._sources.items():
                if source.framer.pending and now_ns - source.last_ns > _IDLE_NS:
                    self._flush(name, source, now_ns)
            for live in list(self._live):
                try:
                    live.writer.tick(now_ns)
                except (GcsError, OSError) as error:
                    self._stop(live, error, now_ns)
                    continue
                if live.end_ns - live.catalogued_ns >= _CATALOGUE_NS:
                    self._store(live, "recording", "")
            self._list()
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
                self._end(live, "service stopped", now_ns)
            self._list()

    def live_flights(self) -> list[str]:
        """Ids of the flights being recorded now."""
        with self._lock:
            return [live.id for live in self._live]

    def statistics(self, link: str, now_ns: int) -> dict[str, object]:
        """Statistics of a link as JSON."""
        return self._source(link).statistics.to_json(now_ns)
