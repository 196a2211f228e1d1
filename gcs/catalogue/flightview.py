"""Reading one flight for people and plots: its summary and its signals, kept in memory while they are asked for."""

from __future__ import annotations

import threading
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np

from gcs.catalogue.decimate import decimate
from gcs.catalogue.flight_table import Flight
from gcs.errors import CatalogueError, GcsError, SignalMapError
from gcs.recording.reader import Recording
from gcs.recording.repair import COMPLETED
from gcs.settings import Settings
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.errors import SysidError
from sysid.signals.flight import FlightSignals, Signal

_KEPT_FLIGHTS = 4
_KEPT_SUMMARIES = 64
#: Name, size and time of change of each file of a recording.
_Version = tuple[tuple[str, int, int], ...]


class FlightViewer:
    """Summaries and signals of recordings in the data folder. Thread-safe; keeps the last few flights' signals."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._lock = threading.Lock()
        self._kept: OrderedDict[tuple[str, int], FlightSignals] = OrderedDict()
        self._contents: OrderedDict[_Version, dict[str, Any]] = OrderedDict()

    def summary(self, flight: Flight) -> dict[str, Any]:
        """Messages per topic, losses, damage, and the names that `series` accepts.

        Of a flight that is being recorded it gives what is on disk already.
        """
        try:
            contents = self._contents_of(flight.kept_files(self._settings.flights))
        except CatalogueError:
            raise
        except GcsError as error:
            return {"topics": {}, "lost": 0, "damage": [str(error)], "signals": [], "warnings": []}
        names: list[str] = []
        warnings: list[str] = []
        if flight.state != "recording":
            try:
                signals = self.signals(flight)
                names, warnings = list(signals.signals), list(signals.warnings)
            except (GcsError, SysidError, SimVehicleError) as error:
                warnings = [str(error)]
        return {**contents, "signals": names, "warnings": warnings}

    def _contents_of(self, paths: list[Path]) -> dict[str, Any]:
        """Topics, losses and damage of a recording; its files are read again only when they have changed."""
        version = tuple((path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in paths)
        with self._lock:
            if version in self._contents:
                self._contents.move_to_end(version)
                return self._contents[version]
        recording = Recording(paths)
        completed = recording.metadata().get(COMPLETED)
        cut = [] if completed is None else [f"cut off before it was taken in; {completed.get('notes', '')}"]
        found = {
            "topics": recording.counts(),
            "lost": sum(recording.lost().values()),
            "damage": [*recording.damage.notes, *cut],
        }
        with self._lock:
            self._contents[version] = found
            while len(self._contents) > _KEPT_SUMMARIES:
                self._contents.popitem(last=False)
        return found

    def signals(self, flight: Flight) -> FlightSignals:
        """All signals of a flight by the configured vehicle file; SignalMapError without one."""
        if self._settings.vehicle is None:
            raise SignalMapError("signals need a vehicle file; start the service with --vehicle FILE")
        from gcs.flights.signals import extract

        paths = flight.kept_files(self._settings.flights)
        key = (flight.file, sum(path.stat().st_size for path in paths))
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        found = extract(Recording(paths), load_vehicle(self._settings.vehicle), flight.system)
        with self._lock:
            self._kept[key] = found
            while len(self._kept) > _KEPT_FLIGHTS:
                self._kept.popitem(last=False)
        return found

    def series(
        self, flight: Flight, names: list[str], start_s: float | None, end_s: float | None, points: int
    ) -> dict[str, dict[str, Any]]:
        """Decimated signals by name; SignalMapError naming what the flight does not have."""
        found = self.signals(flight)
        missing = [name for name in names if name not in found.signals]
        if missing or not names:
            raise SignalMapError(
                f"no signal {', '.join(missing) or 'named'}; this flight has {', '.join(found.signals)}"
            )
        return {name: _series(found.signals[name], start_s, end_s, points) for name in names}


def _series(signal: Signal, start_s: float | None, end_s: float | None, points: int) -> dict[str, Any]:
    time = signal.time_s
    first = 0 if start_s is None else int(np.searchsorted(time, start_s, side="left"))
    last = time.size if end_s is None else int(np.searchsorted(time, end_s, side="right"))
    time, values = decimate(time[first:last], signal.values[first:last], points)
    return {
        "unit": signal.unit,
        "source": signal.source,
        "time": time.tolist(),
        "value": [value if np.isfinite(value) else None for value in values.tolist()],
    }
