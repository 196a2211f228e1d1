"""Passing frames on between the vehicles' links and other ground stations.

What a vehicle sends goes to every other ground station, and what one of these says goes to the vehicles where it may
(`gcs.station.forwardrules`); never from one ground station to another, and never back to where it came from. Frames are
passed on whole and byte for byte as they came, those with a foreign signature or of an unknown id too; nothing is
decoded, encoded or signed. Bytes that are no frame stay here.

All this happens in a thread of its own behind a queue of bounded size. When it cannot keep up, bytes are
not passed on, nor after 5 s, and counted; reception and recording never wait for it.
"""

from __future__ import annotations

import logging
import re
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gcs.errors import in_words
from gcs.links.datagrams import Batch
from gcs.links.link import Link
from gcs.links.outbox import STALE_S
from gcs.links.sources import FORWARD
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import SIGNED, Framer
from gcs.mavlink.signing import SignatureChecker, SignatureMemory
from gcs.station.forwardrules import ForwardRule

_log = logging.getLogger(__name__)

_QUEUE_BYTES = 4 * 1024 * 1024
# An unfinished frame that nothing follows is let go: what noise in front of good frames had hidden is passed on.
_IDLE_S = 1.0
# Well above what a frame may take round a ring of stations, each of which passes nothing on that is stale.
_MEMORY_S = 30.0
_MEMORY_FRAMES = 32768
_OWN = "own"
_NUMBER = re.compile(r"#\d+$")  # of a further source of a link
_MAVLINK_2 = 0xFD


@dataclass(frozen=True)
class ForwardingCounts:
    """What was passed on, what was not as it had come by another way before, and what there was no time for.

    refused: frames of which the link's rule or a missing signature says that they are not to be passed on.
    """

    frames: int = 0
    copies: int = 0
    dropped_bytes: int = 0
    refused: int = 0


@dataclass(frozen=True)
class _First:
    """Who brought a frame first, from which side, and when."""

    source: str
    from_vehicle: bool
    time_s: float


class _Memory:
    """Which source brought a frame first: the same frame from another one soon after is a copy.

    So a vehicle heard over two links is passed on once, and a ring of stations that forward to each other does
    not go round for ever. A source may repeat itself. What a ground station says for itself is no copy of anything from
    the vehicles' side: there somebody may have sent every frame that it could be, to keep a command from the vehicle.
    """

    def __init__(self) -> None:
        self._first: OrderedDict[int, _First] = OrderedDict()
        self._stations: set[int] = set()  # systems that have said something of their own from the stations' side

    def is_copy(self, frame: bytes, source: str, now: float, *, from_vehicle: bool) -> bool:
        key, system = hash(frame), frame[5] if frame[0] == _MAVLINK_2 else frame[3]
        first = self._first.get(key)
        repeated = first is not None and first.source != source and now - first.time_s < _MEMORY_S
        if repeated and not (first and first.from_vehicle and not from_vehicle and system in self._stations):
            return True
        if not repeated and not from_vehicle:
            self._stations.add(system)
        self._first[key] = _First(source, from_vehicle, now)
        self._first.move_to_end(key)
        if len(self._first) > _MEMORY_FRAMES:
            self._first.popitem(last=False)
        return False


@dataclass
class _Source:
    """Where frames come from, and where they go. rule: what of them may."""

    framer: Framer
    targets: Sequence[Link]
    heard: float
    rule: ForwardRule
    signatures: SignatureChecker | None


class Forwarder:
    """Carries frames from `vehicles` to `stations` and back. Bytes are handed in by `offer`.

    rules: by the name of a link of `stations`, what may come from there; everything where none stands. key: of the
    signatures that frames must have to be passed on, None where they need none.
    problem: why the last of them were not passed on, empty when all is well.
    """

    def __init__(
        self,
        vehicles: Sequence[Link],
        stations: Sequence[Link],
        dialect: Dialect,
        rules: Mapping[str, ForwardRule] | None = None,
        key: bytes | None = None,
    ) -> None:
        self._vehicles = tuple(vehicles)
        self._stations = tuple(stations)
        self._dialect = dialect
        self._rules = dict(rules or {})
        self._key, self._signatures = key, SignatureMemory()
        self._sources: dict[str, _Source] = {}
        self._memory = _Memory()
        self._queue: deque[tuple[str, bool, bytes, float]] = deque()
        self._queued_bytes = 0
        self._changed = threading.Condition()
        self._stopping = False
        self._frames = self._copies = self._dropped = self._refused = 0
        self.problem = ""
        self._thread = threading.Thread(target=self._run, daemon=True)

    @property
    def counts(self) -> ForwardingCounts:
        """What was done so far."""
        return ForwardingCounts(self._frames, self._copies, self._dropped, self._refused)

    def start(self) -> None:
        """Begin."""
        Framer(self._dialect).flush()  # loads compiled code, for which nothing shall wait later
        self._thread.start()

    def stop(self, timeout_s: float) -> None:
        """Pass on what waits, then end."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        if self._thread.ident is not None:
            self._thread.join(timeout_s)

    def offer(self, source: str, batch: Batch, *, from_vehicle: bool) -> None:
        """Queue what a source brought; returns at once."""
        with self._changed:
            if self._queued_bytes + len(batch.data) > _QUEUE_BYTES:
                self._dropped += len(batch.data)
                return
            self._queue.append((source, from_vehicle, batch.data, time.monotonic()))
            self._queued_bytes += len(batch.data)
            self._changed.notify()

    def note_own(self, frame: bytes) -> None:
        """A frame that the station says itself to the vehicles: where it comes back, it is not passed on."""
        with self._changed:
            self._queue.append((_OWN, True, frame, time.monotonic()))
            self._queued_bytes += len(frame)
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                if not self._queue and not self._stopping:
                    self._changed.wait(_IDLE_S)
                if not self._queue and self._stopping:
                    return
                taken = self._queue.popleft() if self._queue else None
                if taken is not None:
                    self._queued_bytes -= len(taken[2])
            now = time.monotonic()
            try:
                if taken is not None:
                    self._pass_on(*taken, now)
                self._let_go(now)
            except Exception as error:  # the thread goes on whatever happens
                if not self.problem:
                    _log.error("frames are not passed on: %s", in_words(error))
                self.problem = f"frames are not passed on: {in_words(error)}"

    def _pass_on(self, name: str, from_vehicle: bool, data: bytes, offered: float, now: float) -> None:
        if name == _OWN:
            self._memory.is_copy(data, name, now, from_vehicle=False)
            return
        if now - offered > STALE_S:
            self._dropped += len(data)
            return
        source = self._sources.get(name)
        if source is None:
            source = self._sources[name] = self._new_source(name, from_vehicle, now)
        source.heard = now
        _, frames = source.framer.feed(data)
        self._send(name, source, [frames.frame(i) for i in range(len(frames))], now)

    def _new_source(self, name: str, from_vehicle: bool, now: float) -> _Source:
        targets = self._stations if from_vehicle else self._vehicles
        link = _NUMBER.sub("", name.removeprefix(FORWARD))
        # Where there are rules, a link without one passes nothing.
        usual = ForwardRule(speaks=not self._rules)
        rule = ForwardRule() if from_vehicle else self._rules.get(link, usual)
        signatures = None if self._key is None else SignatureChecker(self._key, self._signatures)
        return _Source(Framer(self._dialect), targets, now, rule, signatures)

    def _let_go(self, now: float) -> None:
        for name, source in self._sources.items():
            if source.framer.pending and now - source.heard > _IDLE_S:
                _, frames = source.framer.flush()
                self._send(name, source, [frames.frame(i) for i in range(len(frames))], now)

    def _send(self, name: str, source: _Source, frames: list[bytes], now: float) -> None:
        side = source.targets is self._stations
        allowed = [frame for frame in frames if source.rule.passes(frame) and _is_signed(frame, source.signatures)]
        self._refused += len(frames) - len(allowed)
        fresh = [frame for frame in allowed if not self._memory.is_copy(frame, name, now, from_vehicle=side)]
        self._copies += len(allowed) - len(fresh)
        if not fresh:
            return
        self._frames += len(fresh)
        for link in source.targets:
            link.send_frames(fresh)
        self.problem = ""


def _is_signed(frame: bytes, checker: SignatureChecker | None) -> bool:
    """Whether a frame has the signature that it needs."""
    if checker is None:
        return True
    return frame[0] == _MAVLINK_2 and frame[2] == SIGNED and checker.judge(frame, time.time_ns())
