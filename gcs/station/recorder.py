"""The recorder: bytes from every link, cut into flights, one MCAP each; and the catalogue kept up to date.

Frames of two vehicles on one link go to two flights. What belongs to no vehicle (a ground station, a radio, noise)
stays with the flight in whose stream it came, so nothing received is in no file.
"""

from __future__ import annotations

import logging
import shutil
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gcs.catalogue.flight_table import Flight
from gcs.catalogue.intake import flight_stamp, unused_id
from gcs.catalogue.store import Catalogue
from gcs.clock.track import clock_metadata
from gcs.errors import CatalogueFileError, DiskFullError, GcsError
from gcs.links.datagrams import Batch
from gcs.links.sources import FORWARD
from gcs.mavlink.boards import boards
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.frameparts import choose_frames, frame_times, likely_vehicle, runs_by_vehicle, slice_frames
from gcs.mavlink.framing import Framer, Frames
from gcs.mavlink.signing import SignatureMemory
from gcs.recording.parts import Metadata, Provenance, RecordingParts
from gcs.recording.storage import StorageOptions
from gcs.station.flightledger import FlightLedger
from gcs.station.linkstats import LinkStatistics
from gcs.station.liveflight import NOBODY, LiveFlight
from gcs.station.recorderstate import RecorderState
from gcs.station.same_number import SameNumber
from gcs.station.segmentation import DISARMED, RESTARTED, SILENCE, FlightSegmenter, Heartbeat, heartbeats
from gcs.text.sizes import size_text

_log = logging.getLogger(__name__)

_CATALOGUE_NS = 1_000_000_000
# Held-back bytes of an unfinished frame are taken as they are once the link has been idle this long.
_IDLE_NS = 1_000_000_000
# After a disk has refused, this long until the next attempt.
_RETRY_NS = 1_000_000_000
# A clock that steps back by more was set; less may be one datagram that overtook another.
_SET_BACK_NS = 1_000_000_000
# What begins so long after a flight is not recorded behind it.
_BEHIND_NS = 600_000_000_000
# A vehicle does not restart more often in a minute; a clock that does is somebody's who speaks in its name.
_MOST_REBOOTS, _REBOOTS_NS = 2, 60_000_000_000
# Each has a file, a thread and buffers. What further systems say goes with the last flight.
_MOST_FLIGHTS = 32


@dataclass
class _Source:
    """A source (by name) as the recorder sees it.

    overheard: whether another ground station is behind it.
    flight: where bytes that belong to no vehicle go. last_ns: newest time of reception.
    lock: held while bytes go through the framer and on, so that they stay in order; taken before the recorder's own.
    """

    framer: Framer
    statistics: LinkStatistics
    overheard: bool
    flight: LiveFlight | None = None
    last_ns: int = 0
    lock: threading.Lock = field(default_factory=threading.Lock)


@dataclass(frozen=True)
class _Batch:
    """Frames that a source brought at once.

    received: (N,) UTC ns of each. believed: (N,) which of them may name vehicles, move clocks and cut flights, None for
    all. beats: the HEARTBEATs among these.
    """

    link: str
    source: _Source
    frames: Frames
    received: NDArray[np.int64]
    believed: NDArray[np.bool_] | None
    beats: Sequence[Heartbeat]
    now_ns: int

    def part(self, run: tuple[int, int]) -> tuple[Frames, Frames, NDArray[np.int64]]:
        """A range of frames with the bytes around them, those of it that may be believed, and when all came."""
        part = slice_frames(self.frames, *run)
        chosen = None if self.believed is None else self.believed[run[0] : run[1]]
        return part, choose_frames(part, chosen), self.received[run[0] : run[1]]


def _bytes_of(frames: Frames, received: NDArray[np.int64]) -> Batch:
    """Frames as they were received, without what came between them."""
    offsets, lengths = frames.offset.tolist(), frames.length.tolist()
    pieces = [frames.buffer[at : at + size].tobytes() for at, size in zip(offsets, lengths, strict=True)]
    return Batch(b"".join(pieces), np.cumsum(frames.length, dtype=np.int64), received)


class FlightRecorder:
    """Cuts bytes into flights and writes them. Knows no sockets; time comes with the bytes and with `tick`.

    on_flight_end: called with each flight that has ended, after it is in the catalogue.
    storage, provenance: how recordings are kept, and what stands in each, asked for when it begins. key: what
    signatures are checked with. require_signed: whether other frames are recorded only. hear_believed: given, where
    signatures are demanded, what a vehicle's side sent that may be believed, with its source; hear_frames: its frames,
    demanded or not; must return at once.
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
        provenance: Callable[[], Provenance] = Provenance,
        key: bytes | None = None,
        require_signed: bool = False,
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._dialect = dialect
        self._catalogue = catalogue
        self._silence_ns = round(silence_s * 1e9)
        self._disarm_ns = round(disarm_s * 1e9)
        self._storage = storage or StorageOptions()
        self._provenance = provenance
        self._key, self._require_signed = key, require_signed
        self.hear_believed: Callable[[str, Batch], None] | None = None
        self.hear_frames: Callable[[Frames], None] = lambda frames: None
        self._signatures = SignatureMemory()
        self._blocked_until_ns = 0
        self.state = RecorderState()
        self._ledger = FlightLedger(catalogue, on_flight_end, self.state.report, self.state.add_unrecorded)
        self._ticked_ns = 0
        self._closed = False
        self._lock = threading.RLock()
        self._sources: dict[str, _Source] = {}
        self._live: list[LiveFlight] = []
        self._reboots: dict[int | None, deque[int]] = {}
        # By vehicle the last flight that ended, and when, UTC ns; None of those of no vehicle.
        self._landed: str | None = None
        self._silent: str | None = None
        self._before: dict[int | None, tuple[str, int]] = {}

    def _source(self, name: str) -> _Source:
        with self._lock:
            if name not in self._sources:
                statistics = LinkStatistics(
                    self._dialect, self._key, self._signatures, require_signed=self._require_signed
                )
                overheard = name.startswith(FORWARD)
                self._sources[name] = _Source(Framer(self._dialect), statistics, overheard)
            return self._sources[name]

    def feed(self, link: str, batch: Batch) -> None:
        """Record what a link received."""
        source = self._source(link)
        with source.lock:
            now_ns, before_ns = int(batch.received_ns[0]), source.last_ns
            # Before the bytes go in, so that `tick` at no time in between finds the link idle.
            source.last_ns = int(batch.received_ns.max())
            if now_ns < before_ns - _SET_BACK_NS:
                self._clock_set_back(now_ns)
            held = source.framer.pending
            buffer, frames = source.framer.feed(batch.data)
            self._take(link, source, buffer, frames, frame_times(frames, batch.ends, batch.received_ns, held), now_ns)

    def _clock_set_back(self, now_ns: int) -> None:
        """This computer's clock shows an earlier time than before: in no recording the times shall step back."""
        with self._lock:
            self._blocked_until_ns = min(self._blocked_until_ns, now_ns + _RETRY_NS)
            for live in list(self._live):
                if live.end_ns > now_ns + _SET_BACK_NS:
                    self._end(live, "clock set back")

    def _take(
        self,
        link: str,
        source: _Source,
        buffer: NDArray[np.uint8],
        frames: Frames,
        received: NDArray[np.int64],
        now_ns: int,
    ) -> None:
        believed = source.statistics.add(frames, received)
        if self.hear_believed is not None and believed is not None and believed.any() and not source.overheard:
            self.hear_believed(link, _bytes_of(choose_frames(frames, believed), received[believed]))
        if not source.overheard:
            self.hear_frames(choose_frames(frames, believed))
        if buffer.size == 0:
            return
        with self._lock:
            if self._closed:
                self.state.add_unrecorded(buffer.size)
                return
            self._end_due(now_ns)
            if source.overheard:
                self._overhear(link, frames, received, now_ns)
                return
            beats = [beat for beat in heartbeats(frames) if believed is None or believed[beat.index]]
            self.state.learn(choose_frames(frames, believed), beats)
            batch = _Batch(link, source, frames, received, believed, beats, now_ns)
            for run in runs_by_vehicle(frames, self.state.vehicles):
                self._write_run(batch, run)

    def _overhear(self, link: str, frames: Frames, received: NDArray[np.int64], now_ns: int) -> None:
        """What another ground station says goes into every flight that is going on; it begins and ends none."""
        part = slice_frames(frames, 0, len(frames))
        for live in list(self._live):
            try:
                live.writer.write(link, part.buffer, part, received if received.size else now_ns)
            except (GcsError, OSError) as error:
                self._stop(live, error, now_ns)

    def _write_run(self, batch: _Batch, run: tuple[int, int]) -> None:
        """Write one range of frames, and the bytes around them, to the flight they belong to."""
        part, believed, times = batch.part(run)
        live = self._flight_for(batch.source, believed, int(times[0]) if times.size else batch.now_ns)
        if live is None:
            self.state.add_unrecorded(part.consumed)
            return
        cut = self._reboot(live, batch, run)
        if cut is not None:
            if cut > run[0]:
                self._write(batch, live, (run[0], cut))
            if live in self._live:
                self._end(live, RESTARTED)
            self._write_run(batch, (cut, run[1]))
            return
        self._write(batch, live, run)

    def _reboot(self, live: LiveFlight, batch: _Batch, run: tuple[int, int]) -> int | None:
        """Index of the first frame behind a reboot of the autopilot, None where there is none to cut at."""
        at = np.arange(*run) if batch.believed is None else run[0] + np.flatnonzero(batch.believed[run[0] : run[1]])
        if at.size == 0:
            return None
        frames, received = batch.part(run)[1], batch.received[at]
        sender = live.segmenter.system or 0, live.segmenter.component
        if live.same_number.add(batch.link, frames, received, sender):
            self.state.double(live.same_number.words, batch.now_ns)
        index = live.segmenter.clock_reset(batch.link, frames, received)
        if index is None:
            return None
        if not self._may_cut(live.segmenter.system, batch.now_ns):
            live.segmenter.forget_clock(batch.link)
            return None
        return int(at[index])

    def _may_cut(self, system: int | None, now_ns: int) -> bool:
        """Whether a clock that starts again is the vehicle's; said where it starts again too often for that."""
        times = self._reboots.setdefault(system, deque(maxlen=_MOST_REBOOTS + 1))
        times.append(now_ns)
        if len(times) <= _MOST_REBOOTS or abs(now_ns - times[0]) > _REBOOTS_NS:
            return True
        self.state.suspect(system, now_ns)
        return False

    def _write(self, batch: _Batch, live: LiveFlight, run: tuple[int, int]) -> None:
        part, believed, times = batch.part(run)
        newest = int(times[-1]) if times.size else batch.now_ns
        try:
            live.writer.write(batch.link, part.buffer, part, times if times.size else batch.now_ns)
        except (GcsError, OSError) as error:
            self.state.add_unrecorded(part.consumed)
            self._stop(live, error, batch.now_ns)
            return
        live.end_ns = max(live.end_ns, newest)
        if live.segmenter.system is not None:
            live.board = boards(believed).get(live.segmenter.system, live.board)
        if live.follows is not None and live.segmenter.system is not None:
            live.look_for_motion(believed, newest)
        unknown = live.segmenter.system is None
        for beat in batch.beats:
            if run[0] <= beat.index < run[1] and not beat.ground_station:
                live.segmenter.heartbeat(beat, newest)
        if live.follows is not None and unknown and live.segmenter.system is not None:
            live.follows = self._flight_before(live.segmenter.system, live.start_ns)  # not that of another vehicle
        if live.segmenter.armed:
            live.follows = None
        # Once the vehicle is known, only it keeps its flight going: a radio or ground station may talk for hours.
        if live.segmenter.system is None or live.segmenter.system in believed.systems:
            live.segmenter.heard(newest)

    def _flight_for(self, source: _Source, believed: Frames, now_ns: int) -> LiveFlight | None:
        """The flight that these frames belong to; a new one if there is none, None where the disk takes none."""
        vehicle = next((system for system in believed.systems if system in self.state.vehicles), None)
        if vehicle is None:
            live = source.flight if source.flight in self._live else (self._live[-1] if self._live else None)
            if live is not None:
                return live
        else:
            live = next((live for live in self._live if live.segmenter.system == vehicle), None)
            if live is None:
                live = self._adopt(now_ns)
            if live is None and len(self._live) >= _MOST_FLIGHTS:
                live = self._live[-1]
            if live is not None:
                source.flight = live
                return live
        if now_ns < self._blocked_until_ns:
            return None
        try:
            live = self._begin(vehicle, believed, now_ns)
        except (GcsError, OSError) as error:
            self._fail(error, now_ns)
            return None
        source.flight = live
        return live

    def _adopt(self, now_ns: int) -> LiveFlight | None:
        """The flight that was begun a moment before its vehicle was known; an old one without a vehicle is ended."""
        live = next((live for live in self._live if live.segmenter.system is None), None)
        if live is not None and now_ns - live.start_ns > self._silence_ns:
            self._end(live, "no vehicle")
            return None
        return live

    def _begin(self, vehicle: int | None, part: Frames, now_ns: int) -> LiveFlight:
        self._check_room()
        flight_id = self._new_id(now_ns, likely_vehicle(part) if vehicle is None else vehicle)
        path = self._folder / f"{flight_id}.mcap"
        segmenter = FlightSegmenter(self._dialect, self._silence_ns, self._disarm_ns)
        segmenter.system = vehicle
        segmenter.heard(now_ns)
        writer = RecordingParts(path, self._dialect, self._storage, self._provenance(), now_ns)
        follows = self._flight_before(vehicle, now_ns)
        if follows is None and vehicle is None and self._require_signed:
            follows = NOBODY
        live = LiveFlight(
            flight_id, writer, segmenter, now_ns, now_ns, same_number=SameNumber(self._dialect), follows=follows
        )
        self._live.append(live)
        self._list(live)
        _log.info("flight %s begins", flight_id)
        self.state.recovered()
        return live

    def _flight_before(self, vehicle: int | None, now_ns: int) -> str | None:
        """The flight of the vehicle that ended a short time ago; of anybody, where it is not known who sends."""
        known = [self._before[vehicle]] if vehicle in self._before else []
        if vehicle is None:
            known = list(self._before.values())
        flight, ended_ns = known[-1] if known else ("", 0)
        return flight if flight and now_ns - ended_ns < _BEHIND_NS else None

    def _check_room(self) -> None:
        """DiskFullError while a new file would soon meet the reserve."""
        free = shutil.disk_usage(self._folder).free
        wanted = self._storage.reserve_bytes * 5 // 4
        if free < wanted:
            raise DiskFullError(
                f"{self._folder}: the disk has {size_text(free)} left, too little to record; free some space"
            )

    def _new_id(self, now_ns: int, system: int) -> str:
        stem = f"{flight_stamp(now_ns)}-{system}"
        try:
            return unused_id(stem, self._folder, self._catalogue)
        except CatalogueFileError as error:
            self.state.report(error)
            return stem  # recording does without the catalogue

    def _list(self, live: LiveFlight) -> None:
        """Write to the catalogue how the flight stands."""
        self._ledger.put(live.entry("recording", ""))
        live.catalogued_ns = live.end_ns

    def _end(self, live: LiveFlight, reason: str) -> None:
        self._live.remove(live)
        if live.follows is None:
            self._landed = live.id if reason == DISARMED else None
            self._silent = live.id if reason == SILENCE and live.segmenter.armed else None
            self._before.pop(live.segmenter.system, None)
            if reason != RESTARTED or not live.segmenter.armed:  # else it restarted in flight
                self._before[live.segmenter.system] = (live.id, live.end_ns)  # the newest is the last one
        sources = list(self._sources.items())
        for _, source in sources:
            if source.flight is live:
                source.flight = None

        def ending() -> Metadata:
            clocks: dict[str, dict[str, str]] = {}
            for name, source in sources:
                states = source.statistics.clocks(until_ns=live.end_ns)
                clocks |= clock_metadata(name, [state for state in states if state.system == live.segmenter.system])
            return {**live.statistics(reason), **clocks}

        self._ledger.end(live, reason, ending)

    def _end_due(self, now_ns: int) -> None:
        for live in list(self._live):
            reason = live.segmenter.end_reason(now_ns)
            if reason is not None:
                self._end(live, reason)

    def _stop(self, live: LiveFlight, error: Exception, now_ns: int) -> None:
        """A file that cannot be written ends its flight, not the service; the next bytes begin another in a while."""
        self._fail(error, now_ns)
        self._end(live, f"recording stopped: {error}")

    def _fail(self, error: Exception, now_ns: int) -> None:
        self._blocked_until_ns = now_ns + _RETRY_NS
        self.state.report(error)

    def tick(self, now_ns: int) -> None:
        """Let time pass: write what waits, end what is over. To be called a few times each second."""
        if now_ns < self._ticked_ns - _SET_BACK_NS:
            self._clock_set_back(now_ns)
        self._ticked_ns = now_ns
        self.state.calm(now_ns)
        for name, source in self._known_sources():
            with source.lock:
                if source.framer.pending and abs(now_ns - source.last_ns) > _IDLE_NS:
                    self._flush(name, source, now_ns)
        with self._lock:
            for live in list(self._live):
                try:
                    live.writer.tick(now_ns)
                except (GcsError, OSError) as error:
                    self._stop(live, error, now_ns)
                    continue
                if live.end_ns - live.catalogued_ns >= _CATALOGUE_NS:
                    self._list(live)
            self._end_due(now_ns)

    def _known_sources(self) -> list[tuple[str, _Source]]:
        with self._lock:
            return list(self._sources.items())

    def _flush(self, name: str, source: _Source, now_ns: int) -> None:
        buffer, frames = source.framer.flush()
        times = np.full(len(frames), min(source.last_ns, now_ns), np.int64)
        self._take(name, source, buffer, frames, times, now_ns)

    def end_flights(self, now_ns: int, reason: str = "service stopped") -> None:
        """End every flight, and wait until it is complete and listed."""
        for name, source in self._known_sources():
            with source.lock:
                self._flush(name, source, now_ns)
        with self._lock:
            for live in list(self._live):
                self._end(live, reason)
        self.settle()

    def settle(self) -> None:
        """Wait until the flights that have ended are complete, and the catalogue knows how all stand."""
        self._ledger.settle()

    def close(self, now_ns: int) -> None:
        """End every flight: the service stops. What is fed after it is counted as not recorded."""
        self.end_flights(now_ns)
        with self._lock:
            self._closed = True
            for live in list(self._live):  # begun in between
                self._end(live, "service stopped")
        self._ledger.close()

    def live_flights(self) -> list[str]:
        """Ids of the flights being recorded now."""
        with self._lock:
            return [live.id for live in self._live]

    def landed(self) -> str | None:
        """The flight whose vehicle was disarmed last, while nobody flies; None else."""
        with self._lock:
            return None if any(live.follows is None for live in self._live) else self._landed

    def silent(self) -> str | None:
        """The flight that ended last, by silence of an armed vehicle, while nobody flies; None else."""
        with self._lock:
            return None if any(live.follows is None for live in self._live) else self._silent

    def live_vehicles(self) -> dict[str, int | None]:
        """The flights being recorded now, oldest first, and the system that flies each, None while it is not known.

        What is recorded on the ground behind a flight is none.
        """
        with self._lock:
            return {live.id: live.segmenter.system for live in self._live if live.follows is None}

    def is_disarmed(self, system: int) -> bool:
        """Whether a vehicle is being recorded, and its last HEARTBEAT says that it is disarmed."""
        with self._lock:
            of_it = [live.segmenter for live in self._live if live.segmenter.system == system]
        return any(one.component for one in of_it) and not any(one.armed for one in of_it)

    def live_systems(self) -> set[int]:
        """Vehicles that are being recorded, on the ground behind a flight too."""
        with self._lock:
            return {live.segmenter.system for live in self._live if live.segmenter.system is not None}

    def board_of(self, system: int | None) -> str | None:
        """The autopilot board of a vehicle that is being recorded, None while it has not said it."""
        with self._lock:
            known = (live.board for live in self._live if live.segmenter.system == system)
            return next((board for board in known if board is not None), None)

    def boards_to_ask(self, now_ns: int) -> list[int]:
        """Vehicles being recorded that are to be asked now which autopilot board they have."""
        with self._lock:
            due = {live.segmenter.system for live in self._live if live.is_to_ask(now_ns)}
        return sorted(system for system in due if system is not None)

    def statistics(self, link: str, now_ns: int) -> dict[str, object]:
        """Statistics of a link as JSON."""
        return self._source(link).statistics.to_json(now_ns)
