"""What becomes of the data folder with time: recordings deleted to make room, deleted flights erased, backups made.

To make room the oldest recordings go of those that have been worked on; a flight's entry, results and models stay.
Never deleted so: a flight that is being recorded, one with no identification that is done or was skipped (unless no
vehicle speaks in it), one that a waiting or running job needs, an upload.
"""

from __future__ import annotations

import logging
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gcs.catalogue.backup import Backups
from gcs.catalogue.flight_table import Flight
from gcs.catalogue.store import Catalogue
from gcs.errors import CatalogueBusyError, CatalogueError, RecordingError, in_words
from gcs.mavlink.frameparts import AUTOPILOT, LAST_VEHICLE
from gcs.recording.reader import Recording
from gcs.text.sizes import size_text

_log = logging.getLogger(__name__)

_DAY_NS = 86_400_000_000_000
_PERIOD_S = 60.0
_STOP_TIMEOUT_S = 5.0


@dataclass(frozen=True)
class RetentionRule:
    """keep_days: age by the end of the flight beyond which its recording goes. keep_bytes: size that all may have."""

    keep_days: float | None = None
    keep_bytes: int | None = None

    def __bool__(self) -> bool:
        return self.keep_days is not None or self.keep_bytes is not None


class Retention:
    """Looks after the data folder once a minute, in a thread of its own. `clock` gives UTC in ns.

    backups: folder for those of the catalogue, None for none. problem: what cannot be done, in words for /api/health,
    empty when all is well.
    """

    def __init__(
        self,
        folder: Path,
        catalogue: Catalogue,
        rule: RetentionRule,
        clock: Callable[[], int] = time.time_ns,
        backups: Path | None = None,
    ) -> None:
        self._folder = folder
        self._catalogue = catalogue
        self._rule = rule
        self._clock = clock
        self._backups = None if backups is None else Backups(backups, catalogue, clock)
        self.problem = ""
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="retention", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._stopping.set()
        if self._thread.ident is not None:
            self._thread.join(_STOP_TIMEOUT_S)

    def _run(self) -> None:
        try:
            for flight in self._catalogue.deleted_flights():
                self._unlink(flight)  # the service may have been stopped between the note and the deed
        except Exception as error:
            self._report(error)
        while not self._stopping.is_set():
            try:
                self.apply()
                self.erase()
                if self._backups is not None:
                    self._backups.make_if_due()
                self.problem = ""
            except Exception as error:  # the thread goes on whatever happens
                self._report(error)
            self._stopping.wait(_PERIOD_S)

    def _report(self, error: Exception) -> None:
        problem = f"the data folder cannot be looked after: {in_words(error)}"
        _log.error("%s", problem)
        # That others write the catalogue it says itself, for as long as they do.
        self.problem = "" if isinstance(error, CatalogueBusyError) else problem

    def apply(self) -> list[str]:
        """Delete what the rule says now; the ids of the flights. Raises CatalogueFileError, OSError."""
        if not self._rule:
            return []
        kept = self._catalogue.kept_flights()
        identified = self._catalogue.identified_flights()
        total = sum(flight.bytes for flight in kept)
        deleted = []
        for flight in kept:
            if not _is_processed(flight, identified):
                continue
            old = self._rule.keep_days is not None and self._age_ns(flight) > self._rule.keep_days * _DAY_NS
            crowded = self._rule.keep_bytes is not None and total > self._rule.keep_bytes
            seen_to = flight.id in identified or flight.follows is not None
            if not (old or crowded) or (not seen_to and self._may_hold_a_vehicle(flight)):
                continue
            if not self._catalogue.mark_deleted(flight.id):
                continue
            self._unlink(flight)
            total -= flight.bytes
            deleted.append(flight.id)
            why = "its age" if old else "the size of all"
            _log.info("recording of flight %s deleted for %s (%s)", flight.id, why, size_text(flight.bytes))
        return deleted

    def erase(self) -> None:
        """Erase flights that somebody deleted, once that cannot be taken back. Raises CatalogueFileError, OSError."""
        for flight in self._catalogue.flights_to_erase():
            if not self._catalogue.erase_flight(flight.id):
                continue
            self._unlink(flight)
            for view in self._folder.with_name("views").glob(f"{flight.id}-*"):
                if view.name.rpartition("-")[0] == flight.id:
                    shutil.rmtree(view, ignore_errors=True)
            _log.info("flight %s erased a day after it was deleted", flight.id)

    def _age_ns(self, flight: Flight) -> int:
        return self._clock() - flight.end_ns

    def _may_hold_a_vehicle(self, flight: Flight) -> bool:
        """Whether an autopilot speaks in the recording, though no HEARTBEAT announced one; also if it is unreadable."""
        try:
            heard = Recording(flight.kept_files(self._folder)).systems()
        except (RecordingError, CatalogueError, OSError):
            return True
        return any(component == AUTOPILOT and system <= LAST_VEHICLE for system, component in heard)

    def _unlink(self, flight: Flight) -> None:
        for path in flight.files(self._folder):
            path.unlink(missing_ok=True)


def _is_processed(flight: Flight, identified: set[str]) -> bool:
    """Whether nothing is to be had from the recording any more; where no vehicle was heard there never was."""
    if flight.state == "recording" or flight.source == "upload":
        return False
    if flight.follows is not None:
        return flight.follows in identified
    return flight.id in identified or (flight.system is None and flight.state == "complete")
