"""What the recorder knows of its surroundings: who was heard, what goes wrong, what could not be recorded."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence

from gcs.errors import CatalogueBusyError, in_words
from gcs.mavlink.frameparts import autopilots
from gcs.mavlink.framing import Frames
from gcs.station.segmentation import Heartbeat

_log = logging.getLogger(__name__)

_SUSPECT_NS, _DOUBLED_NS = 120_000_000_000, 10_000_000_000


class RecorderState:
    """`problem`: what goes wrong, in words for /api/health, empty when all is well. `unrecorded_bytes`: in no file.

    ground_stations, vehicles: the systems heard. suspicion: that somebody speaks in a vehicle's name; doubled: that two
    vehicles have one number; empty for none.
    """

    def __init__(self) -> None:
        self.problem = self.suspicion = self.doubled = ""
        self.unrecorded_bytes = self._suspected_ns = self._doubled_ns = 0
        self.ground_stations: set[int] = set()
        self.vehicles: set[int] = set()
        self._heard: set[int] = set()
        self._lock = threading.Lock()

    def report(self, error: Exception) -> None:
        """Say what goes wrong, once until it is over."""
        if isinstance(error, CatalogueBusyError):  # the catalogue says it itself, for as long as it lasts
            _log.warning("%s", error)
            return
        with self._lock:
            if not self.problem:
                self.problem = in_words(error)
                _log.error("cannot record: %s", self.problem)

    def recovered(self) -> None:
        """Bytes are recorded again."""
        with self._lock:
            if self.problem:
                _log.warning("recording again; %d bytes were not recorded so far", self.unrecorded_bytes)
                self.problem = ""

    def suspect(self, system: int | None, now_ns: int) -> None:
        """Say, once until it is over, that the clock of a vehicle starts again more often than the vehicle can."""
        with self._lock:
            self._suspected_ns = now_ns
            said = (
                f"the clock of system {system} starts again and again: does somebody else send in its name? It cuts no"
                " flight any more; --require-signed believes the vehicle alone"
            )
            if self.suspicion != said:
                self.suspicion = said
                _log.warning("%s", said)

    def double(self, said: str, now_ns: int) -> None:
        """Say, once until it is over, that two vehicles have one number."""
        with self._lock:
            if not self.doubled:
                _log.warning("%s", said)
            self.doubled, self._doubled_ns = said, now_ns

    def calm(self, now_ns: int) -> None:
        """Take back what nothing has given cause for for a while."""
        with self._lock:
            if self.doubled and abs(now_ns - self._doubled_ns) > _DOUBLED_NS:
                self.doubled = ""
            if self.suspicion and abs(now_ns - self._suspected_ns) > _SUSPECT_NS:
                self.suspicion = ""

    def add_unrecorded(self, count: int) -> None:
        """Count bytes that no file took."""
        with self._lock:
            self.unrecorded_bytes += count

    def learn(self, frames: Frames, beats: Sequence[Heartbeat]) -> None:
        """Who is a vehicle: by its HEARTBEAT, and where one is known already by the first word of an autopilot.

        Else a second vehicle's frames up to its HEARTBEAT would be in the first one's flight.
        """
        for beat in beats:
            if beat.ground_station:
                self.ground_stations.add(beat.system)
                self.vehicles.discard(beat.system)
            else:
                self.vehicles.add(beat.system)
        new = set(frames.systems) - self._heard
        if new:
            self._heard |= new
            if self.vehicles:
                self.vehicles |= (new & autopilots(frames)) - self.ground_stations
