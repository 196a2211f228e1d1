"""Recordings that come into the catalogue other than over a link: uploads, and files a crash left behind."""

from __future__ import annotations

import logging
import os
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from gcs.catalogue import Catalogue, Flight
from gcs.conversion import import_file
from gcs.errors import ImportFileError, RecordingError
from gcs.recording.joined import by_recording
from gcs.recording.parts import part_of
from gcs.recording.reader import Recording
from gcs.recording.repair import UNFINISHED, complete
from gcs.settings import Settings

_log = logging.getLogger(__name__)
_MAX_NAME = 200
MAV_TYPE_GCS = 6


def flight_stamp(ns: int) -> str:
    """UTC as it stands in a flight's id: sorts by time, and needs no escaping in a URL."""
    return f"{datetime.fromtimestamp(ns // 1_000_000_000, UTC):%Y%m%dT%H%M%S}.{ns // 1_000_000 % 1000:03d}Z"


def describe(paths: list[Path], flight_id: str, name: str, source: str, state: str) -> Flight:
    """The catalogue's entry of a recording, all its files; RecordingError if it cannot be opened."""
    recording = Recording(paths)
    return Flight(
        id=flight_id,
        file=paths[0].name,
        name=name,
        source=source,
        state=state,
        system=vehicle_of(recording),
        start_ns=recording.start_ns,
        end_ns=recording.end_ns,
        messages=sum(recording.counts().values()),
        bytes=sum(path.stat().st_size for path in paths),
    )


def vehicle_of(recording: Recording) -> int | None:
    """The system whose HEARTBEAT is not a ground station's, the one most often heard if there are several."""
    beats: dict[int, int] = {}
    for columns in recording.columns("HEARTBEAT"):
        count = int(np.count_nonzero(columns["type"] != MAV_TYPE_GCS))
        beats[columns.system] = beats.get(columns.system, 0) + count
    heard = [system for system, count in beats.items() if count]
    return max(heard, key=lambda system: beats[system]) if heard else None


def take_in(upload: Path, original_name: str, settings: Settings, catalogue: Catalogue) -> Flight:
    """Turn an uploaded file into a flight of the catalogue. The original name is shown, never used as a path.

    Raises ImportFileError or RecordingError when it is no recording; nothing is left behind then.
    """
    shown = original_name.replace("\\", "/").rpartition("/")[2][:_MAX_NAME] or "upload.mcap"
    converted = upload.with_name("converted.mcap")
    import_file(upload, converted, Path(shown).suffix)
    entry = describe([converted], "", shown, "upload", "complete")
    if entry.messages == 0:
        raise ImportFileError(f"{shown} holds no MAVLink message; nothing to take in")
    stem = f"{flight_stamp(entry.start_ns)}-{entry.system or 0}"
    flight_id = unused_id(stem, settings.flights, catalogue)
    path = settings.flights / f"{flight_id}.mcap"
    os.replace(converted, path)
    flight = describe([path], flight_id, shown, "upload", "complete")
    catalogue.put_flight(flight)
    return flight


def unused_id(stem: str, folder: Path, catalogue: Catalogue) -> str:
    """`stem`, or with a number behind it if a flight or file of that name exists."""
    flight_id, number = stem, 1
    while catalogue.has_flight(flight_id) or (folder / f"{flight_id}.mcap").exists():
        number += 1
        flight_id = f"{stem}-{number}"
    return flight_id


def recover(settings: Settings, catalogue: Catalogue) -> list[Flight]:
    """List what the last run of the service left unfinished, and recordings the catalogue does not know.

    Files that were cut off are completed. The flights listed anew.
    """
    settings.flights.mkdir(parents=True, exist_ok=True)
    for leftover in settings.flights.glob(f"*{UNFINISHED}"):
        leftover.unlink()
    unfinished = {flight.id: flight for flight in catalogue.unfinished_flights()}
    recovered = []
    for paths in by_recording(sorted(settings.flights.glob("*.mcap"))):
        flight_id, _ = part_of(paths[0])
        if flight_id in unfinished or not catalogue.has_flight(flight_id):
            recovered.append(_recover_one(flight_id, paths, unfinished.pop(flight_id, None), catalogue))
    for flight in unfinished.values():
        reason = "its recording is gone from the data folder"
        _log.warning("flight %s: %s", flight.id, reason)
        catalogue.put_flight(replace(flight, state="recovered", end_reason=reason))
    return recovered


def _recover_one(flight_id: str, paths: list[Path], known: Flight | None, catalogue: Catalogue) -> Flight:
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
