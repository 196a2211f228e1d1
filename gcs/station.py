"""The running station: a thread for each link, one that keeps time, the heartbeat, and the passing on of bytes."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence

from pymavlink.dialects.v20 import common

from gcs.datagrams import Batch
from gcs.links import Link
from gcs.linkstats import merged
from gcs.recorder import FlightRecorder, RecorderState

_RECEIVE_TIMEOUT_S = 0.25
_TICK_S = 0.25
_HEARTBEAT_S = 1.0
_STOP_TIMEOUT_S = 5.0
SYSTEM = 255
COMPONENT = common.MAV_COMP_ID_MISSIONPLANNER


class GroundStationHeartbeat:
    """HEARTBEAT of a ground station, by which a vehicle knows that one is there."""

    def __init__(self) -> None:
        self._sender = common.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)
        self._message = common.MAVLink_heartbeat_message(
            common.MAV_TYPE_GCS, common.MAV_AUTOPILOT_INVALID, 0, 0, common.MAV_STATE_ACTIVE, 3
        )

    def next(self) -> bytes:
        """The next frame, its counter one up."""
        frame = bytes(self._message.pack(self._sender))
        self._sender.seq = (self._sender.seq + 1) % 256
        return frame


class Station:
    """Links in, bytes to `take`, bytes on to the links of `forward` and their answers back to the vehicle.

    take: called with (source name, batch) from the thread of that link. tick: called a few times a second with UTC ns.
    """

    def __init__(
        self,
        links: Sequence[Link],
        take: Callable[[str, Batch], None],
        tick: Callable[[int], None],
        forward: Sequence[Link] = (),
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        self.links = tuple(links)
        self.forward = tuple(forward)
        self._take = take
        self._tick = tick
        self._clock = clock
        self._stopping = threading.Event()
        self._threads = [
            *(threading.Thread(target=self._receive, args=(link,), daemon=True) for link in self.links),
            *(threading.Thread(target=self._answer, args=(link,), daemon=True) for link in self.forward),
            threading.Thread(target=self._keep_time, daemon=True),
        ]

    def start(self) -> None:
        """Begin to receive."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """End the threads, then give the links back."""
        self._stopping.set()
        for thread in self._threads:
            if thread.ident is not None:
                thread.join(_STOP_TIMEOUT_S)
        for link in (*self.links, *self.forward):
            link.close()

    def _receive(self, link: Link) -> None:
        while not self._stopping.is_set():
            batch = link.receive(_RECEIVE_TIMEOUT_S)
            if batch is None:
                continue
            self._take(batch.source or link.name, batch)
            for other in self.forward:
                for chunk in batch.chunks():
                    other.send(chunk)

    def _answer(self, link: Link) -> None:
        """What another ground station behind a forward link says goes to the vehicle."""
        while not self._stopping.is_set():
            batch = link.receive(_RECEIVE_TIMEOUT_S)
            if batch is None:
                continue
            for other in self.links:
                for chunk in batch.chunks():
                    other.send(chunk)

    def _keep_time(self) -> None:
        heartbeat = GroundStationHeartbeat()
        next_heartbeat = time.monotonic()
        while not self._stopping.wait(_TICK_S):
            self._tick(self._clock())
            if time.monotonic() >= next_heartbeat:
                next_heartbeat = max(next_heartbeat + _HEARTBEAT_S, time.monotonic())
                frame = heartbeat.next()
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
    ) -> None:
        super().__init__(links, recorder.feed, recorder.tick, forward, clock)
        self._recorder = recorder

    def stop(self) -> None:
        """End the threads, then every flight."""
        super().stop()
        self._recorder.close(self._clock())

    @property
    def state(self) -> RecorderState:
        """What went wrong, and who was heard."""
        return self._recorder.state

    def live_flights(self) -> list[str]:
        """Ids of the flights being recorded now."""
        return self._recorder.live_flights()

    def link_status(self) -> list[dict[str, object]]:
        """State, counters and statistics of every link, as JSON."""
        now = self._clock()
        return [{**link.status(), **self._statistics(link, now)} for link in self.links]

    def _statistics(self, link: Link, now_ns: int) -> dict[str, object]:
        names = dict.fromkeys((link.name, *(source.name for source in link.sources.all())))
        return merged([(name, self._recorder.statistics(name, now_ns)) for name in names])
