"""A plan of the next flight as a job makes it: the errors to expect, and what a simulator or a board can fly of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from gcs.design.ardupilot import lua_script
from gcs.design.prediction import Design, Request, design
from gcs.errors import GcsError, SettingsError
from gcs.text.intervals import of_the_flight
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.design.simulated_flight import RATE_HZ, rehearse
from sysid.errors import SysidError
from sysid.identify import identify

_SEED = 1  # of noise and gusts in the rehearsal


def planned(
    vehicle: Path, model: Path, asked: Mapping[str, Any], progress: Callable[[float, str], None]
) -> dict[str, Any]:
    """The JSON of schema design/1 with `files`: plan.json for the simulator and plan.lua for ArduPilot Plane.

    asked: manoeuvres, duration [s], gusts [m/s], limits [deg, airspeed in per cent], method (that which identified the
    flight before), each as it is or absent. A file that cannot be made for this aircraft is left out, and a warning
    says why. Raises GcsError, SimVehicleError, SysidError.
    """
    from gcs.text.jsontext import dumps

    names = [str(name) for name in asked.get("manoeuvres") or ()]
    known = read_model(model)
    unknown = known.unknown()
    request = Request(
        manoeuvres=names or ["multisine"],
        duration=asked.get("duration"),
        gusts=float(asked.get("gusts") or 0.0),
        limits=[f"{name}={value}" for name, value in (asked.get("limits") or {}).items()],
        # What no flight has shown yet is what a next one is for: it takes part, and is flown as if it were not there.
        settings=[f"{name}=0" for name in unknown],
    )
    try:
        made = design(load_vehicle(vehicle), known, request, progress)
    except SimVehicleError as error:
        if not unknown:
            raise
        raise SettingsError(
            f"{error}; the model has no value of {', '.join(unknown)}: identify a flight that shows them, with measured"
            " moments of inertia, and plan behind that"
        ) from error
    result = made.result
    if asked.get("method") == "map":
        progress(0.6, "flying the plan in the simulator, and identifying it as the flight before")
        try:
            result = {**result, **_as_identified(made, request.gusts)}
        except SysidError as error:
            doubt = f"the plan, flown in the simulator, could not be identified ({error}): these are the lowest bounds"
            result = {**result, "warnings": [*result["warnings"], doubt]}
    files, warnings = {"plan.json": dumps(made.plan_json(), indent=2)}, list(result["warnings"])
    if unknown:
        warnings.append(f"the model does not know {', '.join(unknown)}: flown as 0, and planned to be found")
    try:
        files["plan.lua"] = lua_script(made.vehicle, made.model, made.plan, RATE_HZ)
    except (GcsError, SimVehicleError) as error:
        warnings.append(f"no script for ArduPilot: {error}")
    return {**result, "warnings": warnings, "files": files}


def _as_identified(made: Design, gusts: float) -> dict[str, Any]:
    """Standard errors, and what is refused, of the plan flown in the simulator and identified with priors.

    The bounds of `sysid.design.predict` know the sensors as the vehicle file has them. An estimate with priors counts
    on what it does not say too (scale factors, servos, delays), which longer or larger manoeuvres make little smaller.
    """
    flight, _ = rehearse(made.vehicle, made.model, made.plan, seed=_SEED, gusts=gusts)
    found = identify([flight], made.vehicle, structure=made.model, method="map")
    known = found.model.coefficients
    reasons = {one.name: one for one in found.refused}
    kept, refused = [], [one for one in made.result["refused"] if one["name"] not in reasons]
    for entry in made.result["coefficients"]:
        std = of_the_flight(known[entry["name"]].to_json()) if entry["name"] in known else None
        if std is None:
            why = reasons.get(entry["name"])
            reason = why.reason if why else "the simulated flight could not identify it"
            refused.append({"name": entry["name"], "reason": reason, "manoeuvre": why.manoeuvre if why else None})
            continue
        larger = std / entry["std"] if entry["std"] else 1.0
        percent = None if entry["percent"] is None else entry["percent"] * larger
        # Correlations are of the bounds.
        kept.append(
            {key: value for key, value in entry.items() if key != "correlated"} | {"std": std, "percent": percent}
        )
    return {"method": "map", "coefficients": kept, "refused": refused}
