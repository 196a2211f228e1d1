"""A plan of the next flight as a job makes it: the errors to expect, and what a simulator or a board can fly of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from gcs.design.ardupilot import lua_script
from gcs.design.prediction import Request, design
from gcs.errors import GcsError
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.design.simulated_flight import RATE_HZ


def planned(
    vehicle: Path, model: Path, asked: Mapping[str, Any], progress: Callable[[float, str], None]
) -> dict[str, Any]:
    """The JSON of schema design/1 with `files`: plan.json for the simulator and plan.lua for ArduPilot Plane.

    asked: manoeuvres, duration [s], gusts [m/s], limits [deg, airspeed in per cent], each as it is or absent. A file
    that cannot be made for this aircraft is left out, and a warning says why. Raises GcsError, SimVehicleError,
    SysidError.
    """
    from gcs.text.jsontext import dumps

    names = [str(name) for name in asked.get("manoeuvres") or ()]
    known = read_model(model)
    unknown = known.refused()
    request = Request(
        manoeuvres=names or ["multisine"],
        duration=asked.get("duration"),
        gusts=float(asked.get("gusts") or 0.0),
        limits=[f"{name}={value}" for name, value in (asked.get("limits") or {}).items()],
        # What no flight has shown yet is what a next one is for: it takes part, and is flown as if it were not there.
        settings=[f"{name}=0" for name in unknown],
    )
    made = design(load_vehicle(vehicle), known, request, progress)
    files, warnings = {"plan.json": dumps(made.plan_json(), indent=2)}, list(made.result["warnings"])
    if unknown:
        warnings.append(f"the model does not know {', '.join(unknown)}: flown as 0, and planned to be found")
    try:
        files["plan.lua"] = lua_script(made.vehicle, made.model, made.plan, RATE_HZ)
    except (GcsError, SimVehicleError) as error:
        warnings.append(f"no script for ArduPilot: {error}")
    return {**made.result, "warnings": warnings, "files": files}
