"""What the catalogue says of a recording, and recordings that a crash left behind."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import count
from pathlib import Path

import numpy as np

from gcs.catalogue.flight_duration import vehicle_seconds
from gcs.catalogue.flight_table import Flight
from gcs.catalogue.store import Catalogue
from gcs.errors import RecordingError, in_words
from gcs.flights.sender import GCS
from gcs.mavlink.boards import board_of
from gcs.mavlink.frameparts import AUTOPILOT
from gcs.recording.joined import by_recording
from gcs.recording.parts import part_of
from gcs.recording.reader import Recording
from gcs.recording.repair import UNFINISHED, complete
from gcs.settings import Settings
from gcs.text.utctext import LAST_NS

_log = logging.getLogger(__name__)


def flight_stamp(ns: int) -> str:
    """UTC as it stands in a flight's id: sorts by time, and needs no escaping in a URL."""
    return f"{datetime.fromtimestamp(ns // 1_000_000_000, UTC):%Y%m%dT%H%M%S}.{ns // 1_000_000 % 1000:03d}Z"


def describe(paths: list[Path], flight_id: str, name: str, source: str, state: str) -> Flight:
    """The catalogue's entry of a recording, all its files; RecordingError if it cannot be opened."""
    recording = Recording(paths)
    if recording.end_ns > LAST_NS:
        raise RecordingError(f"{paths[0]}: its messages came after the year 2262; was the clock that stamped them set?")
    system = vehicle_of(recording)
    return Flight(
        id=flight_id,
        file=paths[0].name,
        name=name,
        source=source,
        state=state,
        system=system,
        start_ns=recording.start_ns,
        end_ns=recording.end_ns,
        messages=sum(recording.counts().values()),
        bytes=sum(path.stat().st_size for path in paths),
        vehicle_s=vehicle_seconds(paths, system),
        board=_board(recording, system),
    )


def _board(recording: Recording, system: int | None) -> str | None:
    """The autopilot board that flew it, the one that was said last; None where it did not say."""
    said = [
        board_of(np.asarray([uid], "<u8").tobytes(), np.asarray(uid2, np.uint8).tobytes())
        for columns in recording.columns("AUTOPILOT_VERSION")
        if (columns.system, columns.component) == (system, AUTOPILOT)
        for uid, uid2 in zip(columns["uid"], columns["uid2"], strict=True)
    ]
    return next((board for board in reversed(said) if board is not None), None)


def vehicle_of(recording: Recording) -> int | None:
    """The system whose HEARTBEAT is not a ground station's, the one most often heard if there are several."""
    beats: dict[int, int] = {}
    for columns in recording.columns("HEARTBEAT"):
        count = int(np.count_nonzero(columns["type"] != GCS))
        beats[columns.system] = beats.get(columns.system, 0) + count
    heard = [system for system, count in beats.items() if count]
    return max(heard, key=lambda system: beats[system]) if heard else None


def unused_id(stem: str, folder: Path, catalogue: Catalogue) -> str:
    """`stem`, or with a number behind it if a flight or file of that name exists."""
    free = (name for name in numbered_ids(stem) if not (folder / f"{name}.mcap").exists())
    return next(name for name in free if not catalogue.has_flight(name))


def numbered_ids(stem: str) -> Iterator[str]:
    """`stem`, then with 2, 3, … behind it."""
    yield stem
    for number in count(2):
        yield f"{stem}-{number}"


@dataclass(frozen=True)
class Leftover:
    """A flight that the last run of the service did not end, or that the catalogue does not know.

    paths: its files, none where they are gone. known: its entry in the catalogue.
    """

    flight_id: str
    paths: tuple[Path, ...]
    known: Flight | None


def leftovers(settings: Settings, catalogue: Catalogue) -> list[Leftover]:
    """What there is to recover, at once. To be asked before anything is recorded, or that would be among it."""
    settings.flights.mkdir(parents=True, exist_ok=True)
    for unfinished in settings.flights.glob(f"*{UNFINISHED}"):
        unfinished.unlink()
    known = {flight.id: flight for flight in catalogue.unfinished_flights()}
    left = []
    for paths in by_recording(sorted(path for path in settings.flights.glob("*.mcap") if not path.is_symlink())):
        flight_id, _ = part_of(paths[0])
        if flight_id in known or not catalogue.has_flight(flight_id):
            left.append(Leftover(flight_id, tuple(paths), known.pop(flight_id, None)))
    return [*left, *(Leftover(flight.id, (), flight) for flight in known.values())]


def recover(settings: Settings, catalogue: Catalogue) -> list[Flight]:
    """Recover all leftovers; the flights listed anew."""
    found = (recover_one(left, catalogue) for left in leftovers(settings, catalogue))
    return [flight for flight in found if flight is not None]


def recover_one(left: Leftover, catalogue: Catalogue) -> Flight | None:
    """Complete a flight's files and list it; None if there is no recording. Raises CatalogueFileError."""
    if left.paths:
        return _complete_and_list(left.flight_id, list(left.paths), left.known, catalogue)
    assert left.known is not None
    if left.known.source == "upload":  # stopped before its file had its place
        catalogue.remove_flight(left.flight_id)
        return None
    reason = "its recording is gone from the data folder"
    _log.warning("flight %s: %s", left.flight_id, reason)
    catalogue.put_flight(replace(left.known, state="recovered", end_reason=reason))
    return None


class Recovery:
    """Recovers leftovers in a thread of its own, so that links open at once, however much there is to complete.

    then: called with each flight listed anew. problem: what could not be recovered, in words for /api/health, empty
    when all is well.
    """

    def __init__(self, left: Sequence[Leftover], catalogue: Catalogue, then: Callable[[Flight], None]) -> None:
        self._left = tuple(left)
        self._catalogue = catalogue
        self._then = then
        self.problem = ""
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recovery", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """Begin nothing more; what is not done then is done at the next start. Returns at once."""
        self._stopping.set()

    def _run(self) -> None:
        for left in self._left:
            if self._stopping.is_set():
                return
            try:
                flight = recover_one(left, self._catalogue)
                if flight is not None:
                    self._then(flight)
            except Exception as error:
                if not self._stopping.is_set():  # the catalogue is closed then
                    self.problem = f"flight {left.flight_id} is not recovered yet: {in_words(error)}"
                    _log.error("%s", self.problem)


def _complete_and_list(flight_id: str, paths: list[Path], known: Flight | None, catalogue: Catalogue) -> Flight:
    if known is not None and known.source == "upload":  # its file is whole: it took its place in one step
        flight = replace(known, state="complete")
        catalogue.put_flight(flight)
        return flight
    reasons = [f"{path.name} {reason}" for path in paths if (reason := complete(path))]
    name = f"{flight_id}.mcap"
    try:
        flight = describe(paths, flight_id, name, "live", "recovered")
    except RecordingError as error:
        start = known.start_ns if known else paths[0].stat().st_mtime_ns
        size = sum(path.stat().st_size for path in paths)
        system = known.system if known else None
        flight = Flight(flight_id, name, name, "live", "recovered", system, start, start, 0, size)
        reasons = [str(error)]
    number = max(part_of(path)[1] for path in paths)
    reason = "; ".join(reasons) or "the service stopped before its end"
    flight = replace(flight, file=name, end_reason=reason, parts=number)
    _log.warning("flight %s recovered: %s", flight_id, reason)
    catalogue.put_flight(flight)
    return flight
