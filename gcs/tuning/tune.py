"""`gcs tune`: the sheet of proposals of a result, as JSON, as lines and as a file that a ground station loads."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gcs.analysis.aircraft import aircraft_of, well_formed
from gcs.errors import ExportError
from gcs.exports.exported import Exported
from gcs.exports.performance import performance
from gcs.tuning.findings import SAMPLES, Quantity, findings
from gcs.tuning.parameter_file import AUTOPILOTS, number_text
from gcs.tuning.proposals import proposals
from gcs.tuning.travel import range_warnings
from sim_vehicle.model.model_file import model_from_json

# Messages in which an autopilot gives the airspeed that it flies by.
_OWN_AIRSPEED = ("VFR_HUD", "AIRSPEED")
# Names of parameters by which the logs of each autopilot are known.
_KNOWN_BY = {"ardupilot": ("SERVO1_FUNCTION", "SCALING_SPEED"), "px4": ("SYS_AUTOSTART", "FW_AIRSPD_TRIM")}


def tune(
    result: Any, autopilot: str, progress: Callable[[float, str], None] = lambda share, text: None
) -> dict[str, Any]:
    """What the result of an identification says of an autopilot's parameters; the JSON of schema tuning/1.

    Raises SettingsError or ExportError in one line for what is no such result.
    """
    with well_formed(result):
        return _tune(result, autopilot, progress)


def _tune(result: Any, autopilot: str, progress: Callable[[float, str], None]) -> dict[str, Any]:
    vehicle, now, airspeed = aircraft_of(result)
    model = Exported(model_from_json(result["model"], "the result's model"), vehicle)
    most = now.get("THR_MAX", 100.0) / 100.0 if autopilot == "ardupilot" else now.get("FW_THR_MAX", 1.0)
    found = findings(result, model, _no_pitot(airspeed, now), most if 0.0 < most <= 1.0 else 1.0)
    warnings = [*vehicle.warnings, *range_warnings(vehicle, autopilot, now)]
    if "intervals" in found.refused:
        warnings.append(f"no intervals: {found.refused['intervals']}")
    other = next(name for name in _KNOWN_BY if name != autopilot)
    if not now:
        warnings.append("the recordings hold no parameters: what each is now is not known")
    elif any(name in now for name in _KNOWN_BY[other]):
        warnings.append(f"the parameters of the recordings are those of {AUTOPILOTS[other]}")
    every = proposals(autopilot, found, model, _stall(model, progress), now)
    return {
        "schema": "tuning/1", "for": autopilot, "vehicle": vehicle.name, "model": model.model.name,
        "flights": list(result.get("flights", [])),
        "parameters": [one.to_json() for one in every if not one.refused],
        "refused": [one.to_json() for one in every if one.refused],
        "warnings": warnings,
    }  # fmt: skip


def _no_pitot(airspeed: str, now: Mapping[str, float]) -> str:
    """Why an airspeed is no reading of the autopilot's own sensor, "" where it is."""
    if not airspeed.startswith(_OWN_AIRSPEED):
        return "the airspeed of these recordings is not the autopilot's own reading"
    if now.get("ARSPD_TYPE") == 0.0:
        return "ARSPD_TYPE is 0: there is no airspeed sensor, and its airspeed is a guess of the autopilot's"
    return ""


def _stall(model: Exported, progress: Callable[[float, str], None]) -> Quantity | str:
    """Stall speed at sea level, which is its equivalent one everywhere, or why it is not known."""
    if "stall" not in {effect.name for effect in model.model.effects}:
        return "no stall was approached: fly one, and let gcs discrepancy find it"
    try:
        entry = performance(model, progress=progress)["figures"]["stall_speed"]
    except ExportError as error:
        return str(error)
    if "refused" in entry:
        return str(entry["refused"])
    value, std = float(entry["value"]), entry.get("std")
    spread = [] if std is None else value + std * np.random.default_rng(3).standard_normal(SAMPLES)
    return Quantity(value, np.array(spread), "m/s")


def tuning_text(found: Mapping[str, Any]) -> str:
    """The sheet as lines."""
    lines = [
        f"{found['vehicle']}, for {AUTOPILOTS[found['for']]}: compare and load line by line, nothing is written to an"
        " aircraft",
        f"  {'parameter':<20}{'now':>10}{'proposed':>10}  {'95 % interval':<20}{'unit':<5} why",
    ]
    for one in found["parameters"]:
        ends = one["interval"]
        between = "" if ends is None else f"{ends[0]:.4g} … {ends[1]:.4g}"
        unit = "" if one["unit"] == "1" else one["unit"]
        lines.append(
            f"  {one['name']:<20}{number_text(one['now']):>10}{number_text(one['value']):>10}  {between:<20}{unit:<5}"
            f" {one['reason']}"
        )
    if found["refused"]:
        lines += ["", "not proposed:"]
        lines += [f"  {one['name']:<20}{number_text(one['now']):>10}  {one['refused']}" for one in found["refused"]]
    return "\n".join([*lines, *(f"warning: {one}" for one in found["warnings"])])
