"""The running station: a thread for each link, one that keeps time, the heartbeat, and the passing on of bytes."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Literal

from pymavlink.dialects.v20 import common

from gcs.clock import timesync
from gcs.errors import JobError, in_words
from gcs.flights.timeline import NOTE
from gcs.links.allowance import BYTES_PER_S
from gcs.links.datagrams import Batch
from gcs.links.opening import Link
from gcs.links.sources import FORWARD
from gcs.mavlink.boards import version_request
from gcs.mavlink.dialect import Dialect
from gcs.station.boardfiles import BoardFiles
from gcs.station.forwarding import Forwarder
from gcs.station.forwardrules import ForwardRule
from gcs.station.linkstats import merged
from gcs.station.own_sender import StationVoice
from gcs.station.recorder import FlightRecorder
from gcs.station.recorderstate import RecorderState

_RECEIVE_TIMEOUT_S = 0.25
_TICK_S = 0.25
_HEARTBEAT_S = 1.0
_STOP_TIMEOUT_S = 5.0
_DRAIN_S = 1.0
_LAST_LOOK_S = 0.01
_AFTER_ERROR_S = 0.01
_MOST_ERRORS = 100
# A thread that has not looked at the clock for so long does so no more; a slow disk may hold it up for a while.
_LATE_S = 30.0
_TEXT_BYTES = 50  # of STATUSTEXT

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class LinkState:
    """Whether a link is up, why bytes cannot flow, and who is behind it."""

    name: str
    role: Literal["vehicle", "forward"]
    up: bool
    problem: str


def _say_once() -> Callable[[Exception], None]:
    """Logs each error in a line, but not one that was logged before."""
    said: set[str] = set()

    def say(error: Exception) -> None:
        words = in_words(error)
        if words not in said and len(said) < _MOST_ERRORS:
            said.add(words)
            _log.error("the station goes on after an error: %s", words)

    return say


class Station:
    """Links in, bytes to `take`, frames on to the links of `forward` and what these say back to the vehicles.

    take: called with (source name, batch) from the thread of that link; the sources of forward links have names that
    begin with `forward:`. tick: called a few times a second with UTC ns. voice: what the station says itself. report:
    called with an error that nobody thought of; the threads go on behind it. listen: called like `take`, behind it,
    with what the vehicles' links brought; must return at once. rules, forward_key: of the `Forwarder`.
    """

    def __init__(
        self,
        links: Sequence[Link],
        take: Callable[[str, Batch], None],
        tick: Callable[[int], None],
        forward: Sequence[Link] = (),
        clock: Callable[[], int] = time.time_ns,
        *,
        voice: StationVoice | None = None,
        dialect: Dialect | None = None,
        report: Callable[[Exception], None] | None = None,
        listen: Callable[[str, Batch], None] | None = None,
        rules: Mapping[str, ForwardRule] | None = None,
        forward_key: bytes | None = None,
    ) -> None:
        self.links = tuple(links)
        self.forward = tuple(forward)
        self._report = report or _say_once()
        several = len(self.links) + len(self.forward) > 1
        for link in (*links, *forward):
            # Else what gathers on one link would be recorded behind what came later on another.
            link.immediate = several
            link.watched = listen is not None
        self.voice = voice or StationVoice()
        self._forwarder = (
            Forwarder(self.links, self.forward, dialect or Dialect.load(), rules, forward_key) if forward else None
        )
        self._take = take
        self._listen = listen
        self._tick = tick
        self._clock = clock
        self._stopping = threading.Event()
        self._looked_s = time.monotonic()
        self._threads = [
            *(threading.Thread(target=self._receive, args=(link,), daemon=True) for link in self.links),
            *(threading.Thread(target=self._answer, args=(link,), daemon=True) for link in self.forward),
            threading.Thread(target=self._keep_time, daemon=True),
        ]

    def start(self) -> None:
        """Begin to receive."""
        if self._forwarder is not None:
            self._forwarder.start()
        self._looked_s = time.monotonic()
        for thread in self._threads:
            thread.start()

    @property
    def alive(self) -> bool:
        """Whether all of its threads are there, and the one that keeps time does."""
        there = all(thread.is_alive() for thread in self._threads)
        return there and time.monotonic() - self._looked_s < _LATE_S

    def link_states(self) -> list[LinkState]:
        """Whether each link is up, those to other ground stations behind the others."""
        return [
            *(LinkState(link.name, "vehicle", link.up, link.problem) for link in self.links),
            *(LinkState(link.name, "forward", link.up, link.problem) for link in self.forward),
        ]

    def stop(self) -> None:
        """End the threads, then give the links back."""
        self._stopping.set()
        for thread in self._threads:
            if thread.ident is not None:
                thread.join(_STOP_TIMEOUT_S)
        if self._forwarder is not None:
            self._forwarder.stop(_STOP_TIMEOUT_S)
        for link in (*self.links, *self.forward):
            link.close()

    def _receive(self, link: Link) -> None:
        while not self._stopping.is_set():
            self._take_from(link, _RECEIVE_TIMEOUT_S, "")
        # What had arrived when the station was asked to stop was received.
        deadline = time.monotonic() + _DRAIN_S
        while self._take_from(link, _LAST_LOOK_S, "") and time.monotonic() < deadline:
            pass

    def _answer(self, link: Link) -> None:
        """What another ground station behind a forward link says."""
        while not self._stopping.is_set():
            self._take_from(link, _RECEIVE_TIMEOUT_S, FORWARD)

    def _take_from(self, link: Link, timeout_s: float, prefix: str) -> bool:
        try:
            batch = link.receive(timeout_s)
            if batch is None:
                return False
            source = prefix + (batch.source or link.name)
            try:
                self._take(source, batch)
            finally:
                if self._forwarder is not None:
                    self._forwarder.offer(source, batch, from_vehicle=not prefix)
                if self._listen is not None and not prefix:
                    self._listen(source, batch)
        except Exception as error:
            self._report(error)
            self._stopping.wait(_AFTER_ERROR_S)  # it may come back at once, for ever
        return True

    def _keep_time(self) -> None:
        next_heartbeat = time.monotonic()
        while not self._stopping.wait(_TICK_S):
            self._looked_s = time.monotonic()
            try:
                self._tick(self._clock())
                if time.monotonic() >= next_heartbeat:
                    next_heartbeat = max(next_heartbeat + _HEARTBEAT_S, time.monotonic())
                    self._say_hello()
            except Exception as error:
                self._report(error)

    def _say_hello(self) -> None:
        """What the station says once a second."""
        self._say(self.voice.heartbeat())
        self._say(self.voice.frame(timesync.request(self._clock())))

    def send_to_stations(self, frames: Sequence[bytes]) -> None:
        """Send something of this station's own to the other ground stations; nothing of it is passed on from here."""
        if self._forwarder is None or not frames:
            return
        for frame in frames:
            self._forwarder.note_own(frame)
        for link in self.forward:
            link.send_frames(list(frames))

    def _say(self, frame: bytes) -> None:
        if self._forwarder is not None:
            self._forwarder.note_own(frame)
        for link in self.links:
            link.send(frame)


class RecordingStation(Station):
    """A station that records what its links bring, cut into flights."""

    def __init__(
        self,
        links: Sequence[Link],
        recorder: FlightRecorder,
        forward: Sequence[Link] = (),
        clock: Callable[[], int] = time.time_ns,
        *,
        voice: StationVoice | None = None,
        dialect: Dialect | None = None,
        listen: Callable[[str, Batch], None] | None = None,
        rules: Mapping[str, ForwardRule] | None = None,
        forward_key: bytes | None = None,
    ) -> None:
        super().__init__(
            links,
            recorder.feed,
            recorder.tick,
            forward,
            clock,
            voice=voice,
            dialect=dialect,
            report=recorder.state.report,
            listen=listen,
            rules=rules,
            forward_key=forward_key,
        )
        self._recorder = recorder
        self._notes = 0
        # What is said to vehicles beside it would be gaps in the recording.
        self._scribe = self.voice.apart()
        self._files = BoardFiles(self.voice, self._say)
        recorder.hear_frames = self._files.hear
        for link in self.links:
            link.watched = link.watched or recorder.hear_believed is not None

    def _say_hello(self) -> None:
        super()._say_hello()
        for system in self._recorder.boards_to_ask(self._clock()):
            self._say(self.voice.frame(version_request(system)))

    def stop(self) -> None:
        """End the threads, then every flight."""
        super().stop()
        self._recorder.close(self._clock())

    @property
    def state(self) -> RecorderState:
        """What went wrong, and who was heard."""
        return self._recorder.state

    @property
    def problem(self) -> str:
        """What goes wrong now, in words; empty when all is well."""
        passing = self._forwarder.problem if self._forwarder is not None else ""
        trust = self.state.suspicion or self.state.doubled
        return self.state.problem or passing or trust or self._refused_link() or self._too_fast()

    def _refused_link(self) -> str:
        """Of a link that this computer refuses, why; where a peer is only waited for there is nothing to say."""
        broken = (link for link in (*self.links, *self.forward) if link.broken)
        return next((f"link {link.name}: {link.problem}" for link in broken), "")

    def _too_fast(self) -> str:
        """Of a peer that sends more than one may, who it is."""
        peers = (source for link in (*self.links, *self.forward) for source in link.sources.too_fast())
        return next(
            (
                f"{source.address} sends more than {BYTES_PER_S / 1e6:g} MB a second over {source.name};"
                f" what is beyond is not recorded ({source.refused / 1e6:.1f} MB so far)"
                for source in peers
            ),
            "",
        )

    def live_flights(self) -> list[str]:
        """Ids of the flights being recorded now."""
        return self._recorder.live_flights()

    def landed(self) -> str | None:
        """The flight whose vehicle was disarmed last, while nobody flies; None else."""
        return self._recorder.landed()

    def silent(self) -> str | None:
        """The flight that ended last, by silence of an armed vehicle, while nobody flies; None else."""
        return self._recorder.silent()

    def note(self, text: str) -> list[str]:
        """Keep a text, as STATUSTEXT of this station, in every flight that is going on; their ids.

        Raises JobError where there is none.
        """
        flights = self._recorder.live_flights()
        if not flights:
            raise JobError("no flight is being recorded that a note could be kept in")
        pieces = [b""]
        for letter in f"{NOTE}{text}":  # none is cut in two
            data = letter.encode()
            if len(pieces[-1]) + len(data) > _TEXT_BYTES:
                pieces.append(b"")
            pieces[-1] += data
        self._notes = self._notes % 65535 + 1
        number = self._notes if len(pieces) > 1 else 0
        now_ns = self._clock()
        frames = [
            self._scribe.frame(common.MAVLink_statustext_message(common.MAV_SEVERITY_NOTICE, piece, number, i))
            for i, piece in enumerate(pieces)
        ]
        self._recorder.feed(f"{FORWARD}notes", Batch.of([(frame, now_ns) for frame in frames]))
        return flights

    def put_file(self, system: int, path: str, content: bytes, board: str | None) -> None:
        """Write a file to the card of a vehicle that stands on the ground. Raises JobError, in words.

        board: which the vehicle must have, None where that is not known.
        """
        if system not in self._recorder.live_systems():
            raise JobError(f"no vehicle with system id {system} is heard; switch it on, and ask again")
        if not self._recorder.is_disarmed(system):
            raise JobError("the vehicle is armed: files are written to it on the ground alone; disarm it first")
        there = self._recorder.board_of(system)
        if board is not None and there is not None and there != board:
            raise JobError(f"the vehicle with system id {system} is another than the one of this flight: another board")
        self._files.put(system, path, content, lambda: self._recorder.is_disarmed(system))

    def live_vehicles(self) -> dict[str, int | None]:
        """As of the recorder: the flights being recorded now, and the system that flies each."""
        return self._recorder.live_vehicles()

    def link_status(self) -> list[dict[str, object]]:
        """State, counters and statistics of every link, those to other ground stations behind the others, as JSON."""
        now = self._clock()
        return [
            {**link.status(), "role": role, **self._statistics(prefix, link, now)}
            for role, prefix, links in (("vehicle", "", self.links), ("forward", FORWARD, self.forward))
            for link in links
        ]

    def forwarding(self) -> dict[str, int] | None:
        """What was passed on, as JSON; None where there is nobody to pass it on to."""
        return None if self._forwarder is None else asdict(self._forwarder.counts)

    def _statistics(self, prefix: str, link: Link, now_ns: int) -> dict[str, object]:
        names = dict.fromkeys((link.name, *(source.name for source in link.sources.all())))
        return merged([(name, self._recorder.statistics(prefix + name, now_ns)) for name in names])
