"""One recording read for people and plots, in a process of its own: what a hostile file does stays there."""

from __future__ import annotations

import itertools
import json
import sys
import threading
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs.errors import GcsError, SignalMapError
from gcs.flights.streams import VehicleStreams
from gcs.flights.timeline import array_elements, modes, raw_fields, texts
from gcs.jobs.limits import NICENESS_WAITED_FOR, stand_back
from gcs.jobs.worker import end_with_service, report
from gcs.mavlink.dialect import Dialect, MessageType
from gcs.recording.parts import WARNINGS
from gcs.recording.reader import Recording
from gcs.recording.repair import COMPLETED
from gcs.text.sizes import size_text
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.errors import SysidError
from sysid.signals.flight import FlightSignals, Signal

# Of a recording with more topics those with most messages; and so many bytes of samples are kept for plots.
_MOST_TOPICS = 2000
_MOST_BYTES = 1_000_000_000
_MOST_NOTES, _LONGEST_NOTE = 200, 500
_MOST_MESSAGES = 300
_OUTLINED, _OUTLINE_POINTS = ("height", "altitude", "airspeed", "V"), 60
_NO_VEHICLE = "which aircraft this was is not known, so no deflection of a surface is shown, and no calibrated channel"


def main() -> int:
    """Read an order (`gcs.jobs.flightviews`), leave the signals' samples where it says, answer with the summary."""
    order = json.loads(sys.stdin.readline())
    threading.Thread(target=end_with_service, daemon=True).start()
    stand_back(order["memory_bytes"], NICENESS_WAITED_FOR)
    try:
        report(**(fields(order) if order.get("message") else summary(order)))
    except GcsError as error:
        report(error=str(error))
    except MemoryError:
        report(error=f"it takes more memory to read than {size_text(order['memory_bytes'])}")
    return 0


def summary(order: dict[str, Any]) -> dict[str, Any]:
    """What the recording holds. Raises RecordingError, MemoryError."""
    recording = Recording([Path(path) for path in order["recordings"]])
    completed = recording.metadata().get(COMPLETED)
    cut = [] if completed is None else [f"cut off before it was taken in; {completed.get('notes', '')}"]
    found: dict[str, Any] = {
        "topics": dict(itertools.islice(_most_first(recording.counts()), _MOST_TOPICS)),
        "lost": sum(recording.lost().values()),
        "damage": [note[:_LONGEST_NOTE] for note in [*cut, *recording.damage.notes][:_MOST_NOTES]],
        "signals": [],
        "warnings": [],
        "series": [],
        "modes": [],
        "texts": [],
        "fields": {},
    }
    if order["target"] is not None:
        try:
            signals, streams = _signals(recording, order["vehicle"], order["system"])
            found["series"] = _save(signals.signals, Path(order["target"]))
            found |= {"signals": list(signals.signals), "warnings": list(signals.warnings)}
            found["outline"] = outline(signals.signals)
            found |= {
                "modes": [asdict(one) for one in modes(recording, streams)],
                "texts": [asdict(one) for one in texts(recording, streams)],
                "fields": _fields_of(recording, streams.sender.system),
            }
        except (GcsError, SysidError, SimVehicleError) as error:
            found["warnings"] = [str(error)]
    known = [words[:_LONGEST_NOTE] for words in recording.metadata().get(WARNINGS, {}).values()]
    found["warnings"] = [*known[:_MOST_NOTES], *found["warnings"]]
    return found


def outline(signals: Mapping[str, Signal]) -> dict[str, Any] | None:
    """Height, or else airspeed, as means of even stretches; None where it has neither, and in one without a value."""
    name = next((one for one in _OUTLINED if one in signals and np.isfinite(signals[one].values).any()), None)
    if name is None:
        return None
    signal = signals[name]
    good = np.isfinite(signal.values)
    edges = np.linspace(signal.time_s[good][0], signal.time_s[good][-1], _OUTLINE_POINTS + 1)
    place = np.clip(np.searchsorted(edges, signal.time_s[good], side="right") - 1, 0, _OUTLINE_POINTS - 1)
    counts = np.bincount(place, minlength=_OUTLINE_POINTS)
    sums = np.bincount(place, signal.values[good], _OUTLINE_POINTS)
    values = [round(total / count, 2) if count else None for total, count in zip(sums, counts, strict=True)]
    return {"name": name, "unit": signal.unit, "values": values}


def fields(order: dict[str, Any]) -> dict[str, Any]:
    """Every number of one message as it was sent, as samples like those of signals. Raises SignalMapError."""
    from gcs.flights.signals import streams_for

    recording, message = Recording([Path(path) for path in order["recordings"]]), order["message"]
    found = raw_fields(recording, streams_for(recording, Vehicle.unknown(), order["system"]), message)
    if not found:
        raise SignalMapError(f"the vehicle sent no {message} in this flight")
    units = Dialect.load().by_name[message].units if message in Dialect.load().by_name else {}
    made = {
        one.name: Signal(one.time_s, one.values, units.get(one.name.split(".")[1].split("[")[0], ""), message)
        for one in found
    }
    return {"series": _save(made, Path(order["target"]), f"{message}-")}


def _fields_of(recording: Recording, system: int) -> dict[str, list[str]]:
    """Names of the messages that the vehicle sent, and of their fields that are numbers, as the dialect has them."""
    known = Dialect.load().by_name
    sent = {topic.rsplit("/", 1)[1] for topic in recording.counts() if topic.startswith(f"/mavlink/{system}/")}
    return {name: list(_numbers_of(known[name])) for name in sorted(sent & known.keys())[:_MOST_MESSAGES]}


def _numbers_of(message: MessageType) -> Iterator[str]:
    for field in message.layout.fields:
        if field.name not in message.text_fields:
            yield from array_elements(field.name, field.count)


def _most_first(counts: dict[str, int]) -> Iterable[tuple[str, int]]:
    """Topics as they stand; where there are too many to show, those with most messages first."""
    return counts.items() if len(counts) <= _MOST_TOPICS else sorted(counts.items(), key=lambda one: -one[1])


def _signals(recording: Recording, vehicle: str | None, system: int | None) -> tuple[FlightSignals, VehicleStreams]:
    from gcs.flights.signals import extract_from, streams_for

    craft = Vehicle.unknown() if vehicle is None else load_vehicle(vehicle)
    streams = streams_for(recording, craft, system)
    found = extract_from(recording, craft, streams)
    if vehicle is None:
        found = replace(found, warnings=(*found.warnings, _NO_VEHICLE))
    return found, streams


def _save(signals: Mapping[str, Signal], folder: Path, before: str = "") -> list[dict[str, str]]:
    """Write every signal's samples; stamps that several signals share are written once. before: of the files' names."""
    stamps: dict[int, str] = {}
    written, entries = 0, []
    for number, (name, signal) in enumerate(signals.items()):
        time_file = stamps.get(id(signal.time_s))
        values_file = f"{before}{number}.npy"
        arrays = {values_file: signal.values}
        if time_file is None:
            time_file = stamps[id(signal.time_s)] = f"{before}{number}-time.npy"
            arrays[time_file] = signal.time_s
        written += sum(array.nbytes for array in arrays.values())
        if written > _MOST_BYTES:
            raise SignalMapError(f"its signals take more than {size_text(_MOST_BYTES)}; export a part of the flight")
        for file, array in arrays.items():
            np.save(folder / file, array, allow_pickle=False)
        entries.append(
            {"name": name, "unit": signal.unit, "source": signal.source, "time": time_file, "values": values_file}
        )
    return entries


if __name__ == "__main__":
    sys.exit(main())
