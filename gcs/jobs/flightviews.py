"""What a flight holds, for people and plots. Recordings are read by a worker; here are only its summaries and arrays.

Of a flight that is over the worker leaves a folder beside the recordings: a summary, and for each signal its samples in
files of numpy, of which a request reads what it shows.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import re
import shutil
import sys
import tempfile
import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gcs.catalogue.flight_table import Flight
from gcs.errors import (
    BusyError,
    CatalogueError,
    CatalogueFileError,
    RecordingDeletedError,
    RecordingError,
    ServiceError,
    SignalMapError,
    in_words,
)
from gcs.jobs.keptsignal import KeptSignal
from gcs.jobs.limits import memory_limit
from gcs.jobs.one_shot_process import AskedOnce
from gcs.settings import Settings
from gcs.version import VERSION
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.vehicle.vehicle_file import load_vehicle

_log = logging.getLogger(__name__)

_SUMMARY = "summary.json"
# Of the folders: what an earlier one left is read anew.
_FORMAT = 3
_NOTHING: Mapping[str, Any] = {
    "topics": {}, "lost": 0, "damage": [], "signals": [], "warnings": [], "modes": [], "texts": [], "fields": {},
}  # fmt: skip
_KEPT_SUMMARIES = 64
_LONGEST_S = 300.0
# All folders together; those not looked at for longest go. An hour's flight takes 100 MB.
_MOST_BYTES = 2_000_000_000
# Most samples of one answer, and so many requests for a flight that nobody has read yet wait at a time.
_MOST_SAMPLES = 500_000
_MOST_SPECTRA, _MOST_SPECTROGRAMS, _MOST_MESSAGES = 20, 6, 8
# A field of a message, as SCALED_IMU.xacc or DEBUG_FLOAT_ARRAY.data[3].
_FIELD = re.compile(r"[A-Z][A-Z0-9_]{0,60}\.[a-z0-9_]{1,60}(\[[0-9]{1,3}\])?")
_MOST_WAITING = 8
_MOST_PREPARED = 100


class FlightViews:
    """Summaries and signals of recordings in the data folder. Thread-safe.

    worker: the command that reads a recording. longest_s, memory_bytes: what that may take. vehicle_of: the vehicle
    file of a flight, None where nobody knows its aircraft; without it the one that the service was started with.
    outlined: called with what of a flight that was read a list shows.
    """

    def __init__(
        self,
        settings: Settings,
        worker: Sequence[str] = (sys.executable, "-m", "gcs.jobs.viewworker"),
        longest_s: float = _LONGEST_S,
        memory_bytes: int | None = None,
        vehicle_of: Callable[[Flight], Path | None] | None = None,
        outlined: Callable[[str, dict[str, Any]], None] = lambda flight_id, outline: None,
    ) -> None:
        self._settings = settings
        self._vehicle_of = vehicle_of or (lambda flight: Path(settings.vehicle) if settings.vehicle else None)
        self._outlined = outlined
        self._reader = AskedOnce(worker, longest_s)
        self._memory_bytes = memory_bytes or memory_limit()
        self._lock = threading.Lock()
        self._room = threading.Lock()
        self._unreadable: OrderedDict[str, str] = OrderedDict()
        self._places = threading.BoundedSemaphore(_MOST_WAITING)
        self._kept: OrderedDict[str, dict[str, Any]] = OrderedDict()
        self._turns: dict[str, threading.Lock] = {}
        self._to_prepare: deque[Flight] = deque(maxlen=_MOST_PREPARED)
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._prepare, name="views", daemon=True)

    def prepare(self, flight: Flight) -> None:
        """Have a flight that is over read before anybody asks for it; returns at once."""
        with self._changed:
            if self._thread.ident is None:
                self._thread.start()
            self._to_prepare.append(flight)
            self._changed.notify()

    def close(self) -> None:
        """End what is being read; nothing more is."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._reader.close()

    def summary(self, flight: Flight) -> dict[str, Any]:
        """Messages per topic, losses, damage, and the names that `series` accepts.

        Of a flight that is being recorded it gives what is on disk already, of one that cannot be read why, as damage,
        of one that cannot be read now why, as a warning. Raises CatalogueError.
        """
        try:
            return {**_NOTHING, **{key: value for key, value in self._view(flight)[0].items() if key != "series"}}
        except (RecordingError, RecordingDeletedError) as error:
            return {**_NOTHING, "damage": [str(error)]}
        except ServiceError as error:  # its jobs and results can be seen all the same
            return {**_NOTHING, "warnings": [str(error)]}

    def series(
        self, flight: Flight, names: list[str], start_s: float | None, end_s: float | None, points: int
    ) -> dict[str, dict[str, Any]]:
        """Decimated signals by name; SignalMapError naming what the flight does not have."""
        if len(names) * points > _MOST_SAMPLES:
            raise SignalMapError(
                f"{len(names)} signals of {points} points are too many for one answer; it has {_MOST_SAMPLES} at most"
            )
        return self._of_each(flight, names, lambda one: one.series(start_s, end_s, points))

    def spectra(
        self, flight: Flight, names: list[str], start_s: float | None, end_s: float | None
    ) -> dict[str, dict[str, Any]]:
        """Power spectral densities of a stretch by name; SignalMapError naming what the flight does not have."""
        if len(names) > _MOST_SPECTRA:
            raise SignalMapError(f"{len(names)} spectra are too many for one answer; it has {_MOST_SPECTRA} at most")
        return self._of_each(flight, names, lambda one: one.spectrum(start_s, end_s))

    def spectrograms(
        self, flight: Flight, names: list[str], start_s: float | None, end_s: float | None
    ) -> dict[str, dict[str, Any]]:
        """Spectra over time of a stretch by name; SignalMapError naming what the flight does not have."""
        if len(names) > _MOST_SPECTROGRAMS:
            raise SignalMapError(
                f"{len(names)} spectrograms are too many for one answer; it has {_MOST_SPECTROGRAMS} at most"
            )
        return self._of_each(flight, names, lambda one: one.spectrogram(start_s, end_s))

    def _of_each(
        self, flight: Flight, names: list[str], read: Callable[[KeptSignal], dict[str, Any]]
    ) -> dict[str, dict[str, Any]]:
        found, folder = self._view(flight)
        entries = {entry["name"]: entry for entry in found["series"]}
        try:
            for message in self._asked(names, found["fields"]):
                entries |= {entry["name"]: entry for entry in self._fields(flight, folder, message)}
        except (OSError, ValueError) as error:  # another flight took the room of this one, or a list was cut off
            self._forget(folder)
            raise CatalogueError(f"the plots of flight {flight.id} are made anew ({error}); ask again") from error
        missing = [name for name in names if name not in entries]
        if missing or not names:
            if not entries and found["warnings"]:
                raise SignalMapError(found["warnings"][0])
            raise SignalMapError(f"no signal {', '.join(missing) or 'named'}; this flight has {', '.join(entries)}")
        try:
            return {name: read(KeptSignal(folder, entries[name])) for name in names}
        except (OSError, ValueError, EOFError) as error:
            self._forget(folder)
            raise CatalogueError(f"the plots of flight {flight.id} are made anew ({error}); ask again") from error

    @staticmethod
    def _asked(names: Sequence[str], there: Mapping[str, Any]) -> list[str]:
        """Messages whose fields are named. SignalMapError of those that the flight has not, and of too many."""
        messages = list(dict.fromkeys(name.split(".")[0] for name in names if _FIELD.fullmatch(name)))
        unknown = [message for message in messages if message not in there]
        if unknown:
            raise SignalMapError(f"the vehicle sent no {unknown[0]} in this flight")
        if len(messages) > _MOST_MESSAGES:
            raise SignalMapError(f"fields of {len(messages)} messages are too many for one answer; {_MOST_MESSAGES} go")
        return messages

    def _fields(self, flight: Flight, folder: Path, message: str) -> list[dict[str, str]]:
        """The fields of one message, which a worker reads when they are first asked for. SignalMapError if none."""
        listed = folder / f"{message}.json"
        if not listed.is_file():
            if flight.state == "recording":
                raise SignalMapError("fields of messages can be seen when the flight is over")
            with (
                self._place(),
                self._turn(flight.id),
                tempfile.TemporaryDirectory(prefix="reading-", dir=self._settings.views) as made,
            ):
                if listed.is_file():  # read by somebody else meanwhile
                    return list(json.loads(listed.read_text(encoding="utf-8")))
                self._require_room()
                target = Path(made) / "fields"
                target.mkdir()
                order = {
                    "recordings": flight.kept_files(self._settings.flights),
                    "message": message,
                    "system": flight.system,
                    "target": target,
                    "memory_bytes": self._memory_bytes,
                }
                found = self._reader.ask(order, Path(made), f"flight {flight.id}", SignalMapError)
                for path in target.iterdir():
                    path.rename(folder / path.name)
                unfinished = target / listed.name
                unfinished.write_text(json.dumps(found["series"]), encoding="utf-8")
                unfinished.rename(listed)
        return list(json.loads(listed.read_text(encoding="utf-8")))

    def _prepare(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: bool(self._to_prepare) or self._closed)
                if self._closed:
                    return
                flight = self._to_prepare.popleft()
            try:
                self._view(flight)
            except Exception as error:  # who asks for it hears why
                _log.info("flight %s is not read for its plots yet: %s", flight.id, in_words(error))

    def _view(self, flight: Flight) -> tuple[dict[str, Any], Path]:
        """The summary of a flight as its files are now, and the folder of its signals."""
        paths = flight.kept_files(self._settings.flights)
        over = flight.state != "recording"
        key = self._key(flight, paths, over)
        folder = self._settings.views / f"{flight.id}-{key}"
        found = self._remembered(key, folder)
        if found is None:
            with self._place(), self._turn(flight.id):
                found = self._remembered(key, folder) or self._read_once(key, flight, paths, folder, over)
            with self._lock:
                self._kept[key] = found
                while len(self._kept) > _KEPT_SUMMARIES:
                    self._kept.popitem(last=False)
        return found, folder

    @contextmanager
    def _place(self) -> Iterator[None]:
        """Held by each thread that reads a flight or waits for its turn. BusyError where so many do."""
        if not self._places.acquire(blocking=False):
            raise BusyError("other flights are being read; ask again in a minute")
        try:
            yield
        finally:
            self._places.release()

    def _turn(self, flight_id: str) -> threading.Lock:
        """Held while a flight is read, so that those who ask for it meanwhile read it once."""
        with self._lock:
            return self._turns.setdefault(flight_id, threading.Lock())

    def _key(self, flight: Flight, paths: Sequence[Path], over: bool) -> str:
        """A name for what the recording and the vehicle file are now."""
        seen = [_state(path) for path in paths]
        vehicle = self._vehicle_of(flight) if over else None
        if vehicle is not None:
            seen += _states_of_vehicle(vehicle)
        return hashlib.sha256(repr((VERSION, _FORMAT, flight.system, over, seen)).encode()).hexdigest()[:16]

    def _remembered(self, key: str, folder: Path) -> dict[str, Any] | None:
        with self._lock:
            found = self._kept.get(key)
            if found is not None:
                self._kept.move_to_end(key)
        if found is not None and (not found["series"] or folder.is_dir()):
            return found
        summary = folder / _SUMMARY
        if not summary.is_file():
            return None
        try:
            found = json.loads(summary.read_text(encoding="utf-8"))
            os.utime(summary)  # somebody looks at it
            return {**found, "series": list(found["series"])}
        except (OSError, ValueError, KeyError, TypeError):  # cut off by a power failure, or just removed
            shutil.rmtree(folder, ignore_errors=True)
            return None

    def _forget(self, folder: Path) -> None:
        """Have a flight read anew when it is asked for next."""
        with self._lock:
            self._kept.pop(folder.name.rpartition("-")[2], None)
        shutil.rmtree(folder, ignore_errors=True)

    def _read_once(self, key: str, flight: Flight, paths: Sequence[Path], folder: Path, over: bool) -> dict[str, Any]:
        """As `_read`; a recording that cannot be read is not tried again while it stays as it is."""
        if key in self._unreadable:
            raise RecordingError(self._unreadable[key])
        try:
            return self._read(flight, paths, folder, over)
        except RecordingError as error:
            with self._lock:
                self._unreadable[key] = str(error)
                while len(self._unreadable) > _KEPT_SUMMARIES:
                    self._unreadable.popitem(last=False)
            raise

    def _read(self, flight: Flight, paths: Sequence[Path], folder: Path, over: bool) -> dict[str, Any]:
        """Have the worker read a recording."""
        views = self._settings.views
        views.mkdir(parents=True, exist_ok=True)
        if over:
            self._make_room(flight)
        with tempfile.TemporaryDirectory(prefix="reading-", dir=views) as made:
            target = Path(made) / "view"
            target.mkdir()
            order = {
                "recordings": list(paths),
                "vehicle": self._vehicle_of(flight) if over else None,
                "system": flight.system,
                "target": target if over else None,
                "memory_bytes": self._memory_bytes,
            }
            found = self._reader.ask(order, Path(made), f"flight {flight.id}", RecordingError)
            if over:
                with (target / _SUMMARY).open("w", encoding="utf-8") as file:
                    json.dump(found, file)
                    file.flush()
                    os.fsync(file.fileno())
                target.rename(folder)
                if found.get("outline"):
                    try:
                        self._outlined(flight.id, found["outline"])
                    except CatalogueFileError as error:  # the plots are there all the same
                        _log.warning("how flight %s went is not in the list: %s", flight.id, error)
        return found

    def _make_room(self, flight: Flight) -> None:
        """Remove what is old of this flight, and what was not looked at for longest. ServiceError on a full disk."""
        views = self._settings.views
        for old in views.glob(f"{flight.id}-*"):
            if _flight_of(old) == flight.id:
                shutil.rmtree(old, ignore_errors=True)
        with self._room:
            there = [folder for folder in views.iterdir() if (folder / _SUMMARY).is_file()]
            sizes = {folder: sum(path.stat().st_size for path in folder.iterdir()) for folder in there}
            total = sum(sizes.values())
            for folder in sorted(there, key=lambda one: (one / _SUMMARY).stat().st_mtime):
                if total <= _MOST_BYTES:
                    break
                shutil.rmtree(folder, ignore_errors=True)
                total -= sizes[folder]
        self._require_room()

    def _require_room(self) -> None:
        """ServiceError on a disk that what is recorded needs."""
        reserve = self._settings.storage.reserve_bytes
        if shutil.disk_usage(self._settings.views).free < 2 * reserve:
            raise ServiceError("the disk has too little room to show a flight beside what is recorded; free some space")


def _state(path: Path) -> tuple[str, int, int]:
    status = path.stat()
    return path.name, status.st_size, status.st_mtime_ns


def _states_of_vehicle(name: Path) -> list[tuple[str, int, int]]:
    """Of a vehicle file and its bench tables; of one that cannot be read, why."""
    try:
        vehicle = load_vehicle(str(name))  # by its bare name, one that comes with the package
        tables = (entry.points for entry in vehicle.calibration.values())
        return [_state(path) for path in (vehicle.path, *tables) if isinstance(path, Path)]
    except (SimVehicleError, OSError) as error:  # the worker says it as a warning of the flight
        return [(str(error), 0, 0)]


def _flight_of(folder: Path) -> str:
    return folder.name.rpartition("-")[0]
