"""What a result keeps of the aircraft that flew, so that what follows from the model needs no other file."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from gcs.errors import GcsError, SettingsError
from gcs.flights.autopilot_settings import filled, parameters_of
from gcs.flights.streams import sender_of
from gcs.recording.joined import by_recording
from gcs.recording.reader import Recording
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.vehicle.vehicle_file import Vehicle, vehicle_from_tables
from sysid.signals.flight import FlightSignals

# Bench points are in files of their own, and say nothing of how the aircraft flies.
_LEFT_OUT = ("calibration",)


def aircraft_json(
    vehicle: Path, paths: Sequence[Path], flights: Sequence[FlightSignals], system: int | None
) -> dict[str, Any]:
    """The vehicle file's tables, the autopilot's parameters, and the message that airspeed came from, "" for none.

    Parameters are those of the first recording that holds some. Raises GcsError for a recording that cannot be read.
    """
    tables = tomllib.loads(vehicle.read_text(encoding="utf-8"))
    parameters: dict[str, float] = {}
    for parts in by_recording(paths):
        recording = Recording(parts)
        parameters = parameters_of(recording, sender_of(recording, system).system)[0]
        if parameters:
            break
    airspeed = {flight.signals["airspeed"].source for flight in flights if "airspeed" in flight.signals}
    return {
        "file": {key: table for key, table in tables.items() if key not in _LEFT_OUT},
        "parameters": parameters,
        "airspeed": airspeed.pop() if len(airspeed) == 1 else "",
    }


@contextmanager
def well_formed(result: Any) -> Iterator[None]:
    """Raise SettingsError in one line for what is no result of an identification, and for one that does not hold what
    its schema says, wherever the block meets that.
    """
    if not isinstance(result, dict) or result.get("schema") != "identification/1":
        raise SettingsError("this is no result of gcs identify: give the file that gcs identify -o wrote")
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, ArithmeticError) as error:
        said = " ".join(f"{type(error).__name__}: {error}".split())
        raise SettingsError(
            f"the result does not hold what schema identification/1 says ({said}): make it again with gcs identify"
        ) from error


def aircraft_of(result: Mapping[str, Any]) -> tuple[Vehicle, dict[str, float], str]:
    """The vehicle, what its file leaves out by the autopilot's parameters; those; where airspeed came from.

    Raises SettingsError in one line for a result that does not hold them, as those of older versions do not.
    """
    kept = result.get("aircraft")
    with suppress(KeyError, TypeError, AttributeError, ValueError, GcsError, SimVehicleError):
        parameters = {str(name): float(value) for name, value in kept["parameters"].items()}  # type: ignore[index]
        name = str(result["made"]["settings"]["vehicle"])
        vehicle = vehicle_from_tables(kept["file"], Path(f"{name}.toml"))  # type: ignore[index]
        return filled(vehicle, parameters), parameters, str(kept["airspeed"])  # type: ignore[index]
    raise SettingsError("the result does not hold the aircraft that flew: make it again with gcs identify")
