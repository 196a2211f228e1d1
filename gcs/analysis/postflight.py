"""The post-flight job: from recordings to the result files, the one way for command line, REST and tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gcs.analysis.aircraft import aircraft_json
from gcs.analysis.incomplete import cut_off, naming_cuts, with_warnings
from gcs.analysis.provenance import made
from gcs.analysis.sameflight import repeated, same
from gcs.errors import SignalMapError
from gcs.flights.autopilot_settings import flown, parameters_of
from gcs.flights.forward_flight import forward
from gcs.flights.signals import extract_from, streams_for
from gcs.flights.streams import sender_of
from gcs.recording.joined import by_recording
from gcs.recording.reader import Recording
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.signals.flight import FlightSignals

Progress = Callable[[float, str], None]


def _silent(share: float, text: str) -> None:
    """Report nothing."""


def read_flights(paths: Sequence[Path], vehicle: Vehicle, system: int | None = None) -> list[FlightSignals]:
    """Signals of each recording; files whose names say that they are parts of one count as one.

    Raises GcsError or SysidError in one line where one cannot be read.
    """
    flights = []
    for parts in by_recording(paths):
        recording = Recording(parts)
        sender = sender_of(recording, system)
        if not sender.has_wings:
            raise SignalMapError(
                f"{recording.path.stem}: the log of a {sender.type_name} ({sender.autopilot_name}): there is nothing to"
                " identify without a wing; give the log of a fixed-wing aircraft"
            )
        streams = streams_for(recording, vehicle, system)
        flight = forward(extract_from(recording, vehicle, streams), streams, parameters_of(recording, sender.system)[0])
        flight = replace(flight, sender=sender.to_json())
        cut = cut_off(recording)
        flights.append(replace(flight, warnings=(cut, *flight.warnings)) if cut else flight)
    return flights


def load_flown(
    vehicle: Path,
    paths: Sequence[Path],
    system: int | None = None,
    start: float | None = None,
    stop: float | None = None,
) -> Vehicle:
    """The vehicle of a file, what it leaves out by the parameters of the autopilot that flew the recordings.

    start, stop: s from the flight's first stamp, of the part that counts.

    Raises SimVehicleError for the file, GcsError for a recording that cannot be read.
    """
    craft = load_vehicle(str(vehicle))
    for parts in by_recording(paths):
        recording = Recording(parts)
        sender = sender_of(recording, system).system
        if found := flown(craft, recording, sender, recording.messages(), start, stop):
            return found
    return craft


def senders_of(flights: Sequence[FlightSignals]) -> dict[str, dict[str, object]]:
    """Flight -> who sent it: system, type, MAV_TYPE and autopilot."""
    return {flight.name: dict(flight.sender) for flight in flights}


def identify(
    paths: Sequence[Path],
    vehicle: Path,
    *,
    validate: Sequence[Path] = (),
    structure: Path | None = None,
    prior: Path | None = None,
    method: str = "auto",
    start: float | None = None,
    stop: float | None = None,
    system: int | None = None,
    as_recorded: Sequence[str] = (),
    progress: Progress = _silent,
) -> dict[str, Any]:
    """Identify the model of the vehicle from recordings; the JSON of schema identification/1.

    paths: MCAP recordings, estimated together. validate: recordings the model is judged by. structure, prior: model
    files. start, stop: s from the flight's first stamp. as_recorded: signals that are right whatever seems. Raises
    GcsError, SysidError, SimVehicleError in one line.
    """
    from sysid.identification.compile_ahead import CompileAhead
    from sysid.identification.result_file import result_json
    from sysid.identify import identify as run
    from sysid.signal_check.corrected_faults import require_searched

    craft = load_flown(vehicle, paths, system, start, stop)
    require_searched([*as_recorded, *craft.as_recorded])
    progress(0.0, "reading the recordings")
    with CompileAhead() as compiling:
        flights, judges = read_flights(paths, craft, system), read_flights(validate, craft, system)
        if compiling:
            progress(0.01, "compiling, which the first identification alone takes time for")
        compiling.wait()
    gathered = [line for flight in flights for line in flight.warnings]
    with naming_cuts([*paths, *validate]), with_warnings(gathered):
        found = run(
            flights,
            craft,
            validate_on=judges,
            structure=None if structure is None else read_model(structure),
            prior=None if prior is None else read_model(prior),
            method=method,
            start_s=start,
            stop_s=stop,
            as_recorded=as_recorded,
            progress=progress,
        )
    result = {**result_json(found), "senders": senders_of(flights)}
    result["warnings"] = list(dict.fromkeys([*repeated(flights, judges), *craft.warnings, *result["warnings"]]))
    if result.get("validation") and any(same(judge, flight) for judge in judges for flight in flights):
        # The verdict stands in green beside its reason.
        result["validation"]["reason"] = f"{result['validation']['reason']}, judged on a flight that was fitted"
    settings: dict[str, Any] = {
        "vehicle": craft.name, "method": method, "from": start, "to": stop, "system": system,
        **({"as_recorded": list(as_recorded)} if as_recorded else {}),
    }  # fmt: skip
    models = [path for path in (structure, prior) if path is not None and path.is_file()]
    result["aircraft"] = aircraft_json(craft.path, paths, flights, system)
    result["made"] = made(settings, [*paths, *validate, craft.path, *models])
    return result


def discrepancy(
    paths: Sequence[Path],
    vehicle: Path,
    model: Path,
    *,
    validate: Sequence[Path] = (),
    ruled_out: Sequence[str] = (),
    method: str = "auto",
    start: float | None = None,
    stop: float | None = None,
    system: int | None = None,
    as_recorded: Sequence[str] = (),
    progress: Progress = _silent,
) -> dict[str, Any]:
    """Compare a model file with recordings; the JSON of schema discrepancy/1. Errors as for `identify`.

    ruled_out: effects that are known not to be there. method: auto, map or fe.
    """
    from sysid.discrepancy import discrepancy as run
    from sysid.identification.result_file import finite_json

    craft = load_flown(vehicle, paths, system, start, stop)
    baseline = read_model(model)
    unknown, baseline = baseline.unknown(), baseline.with_starts()
    progress(0.0, "reading the recordings")
    with naming_cuts([*paths, *validate]):
        flights, judges = read_flights(paths, craft, system), read_flights(validate, craft, system)
        found = run(
            flights,
            craft,
            baseline,
            validate_on=judges,
            start_s=start,
            stop_s=stop,
            ruled_out=ruled_out,
            as_recorded=as_recorded,
            method=method,
            progress=progress,
        )
    clean: dict[str, Any] = {**finite_json(found), "senders": senders_of(flights)}
    models = [model] if model.is_file() else []
    lacking = [f"the model has no value of {', '.join(unknown)}: taken as 0, to begin with"] if unknown else []
    said = [*repeated(flights, judges), *lacking, *craft.warnings, *clean.get("warnings", [])]
    clean["warnings"] = list(dict.fromkeys(said))
    clean["made"] = made(
        {
            "vehicle": craft.name,
            "method": method,
            "from": start,
            "to": stop,
            "system": system,
            "rule_out": list(ruled_out),
            **({"as_recorded": list(as_recorded)} if as_recorded else {}),
        },
        [*paths, *validate, craft.path, *models],
    )
    return clean
