"""Whether the intervals of what `gcs tune` proposes hold.

Run: make campaign NAME=tuning

Flights of tests/support/field_flight.py (JSBSim, with the sensors, servos and air of the field): feedforward of the
rate loops against what its aircraft needs. Flights of the three aircraft that come with the simulator, each with an
asymmetry, a wrong pitot tube and a mass known to 1 %: trims, airspeed ratio, throttle, climb and sink too, against the
model that was flown: what tune makes of it (its formulas are held against flights and closed forms by tests). Every
flight is a line of JSON in --store; what is there already is not run again.
"""

from __future__ import annotations

import math
import sys
import tempfile
import tomllib
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent / "support"))

import numpy as np
from field_flight import FieldFlight, field_flight
from field_wire import vehicle_file
from resumable import resumable
from simulated import fly_mav

from gcs.tuning.tune import tune
from sim_vehicle.model.model_file import Coefficient, read_model
from sim_vehicle.vehicle.vehicle_file import VEHICLES, load_vehicle
from sysid.errors import SysidError
from sysid.identification.result_file import result_json
from sysid.identify import identify

FIELD = ("mild", "typical", "rough", "closed-loop")
SIMULATED = ("iitb-mav", "aerosonde", "ultrastick25e")
NOW = {"ARSPD_RATIO": 2.0}
MASS_STD, WIND = 0.01, 4.0
Line = dict[str, Any]


def with_aircraft(result: dict[str, Any], text: str, name: str) -> dict[str, Any]:
    """The result with what `gcs identify` writes beside it."""
    tables = {key: table for key, table in tomllib.loads(text).items() if key != "calibration"}
    kept = {"file": tables, "parameters": NOW, "airspeed": "AIRSPEED.airspeed"}
    return {**result, "aircraft": kept, "made": {"settings": {"vehicle": name}}}


def numbers(sheet: dict[str, Any], truth: dict[str, float]) -> Line:
    """Per parameter its value, interval and truth, and what was refused."""
    found = {
        one["name"]: [one["value"], *one["interval"], truth[one["name"]]]
        for one in sheet["parameters"]
        if one["name"] in truth
    }
    return {"found": found, "refused": [one["name"] for one in sheet["refused"] if one["name"] in truth]}


def of_field(flight: FieldFlight) -> Line:
    """Feedforward of a flight of JSBSim's."""
    result = with_aircraft(result_json(identify([flight.signals], flight.vehicle)), vehicle_file(flight), "field")
    truth = {name: float(np.mean(ends)) for name, ends in flight.truth.items()}
    craft, space = flight.vehicle, result["state_space"]
    speed, mass = space["airspeed"], craft.mass.mass
    pressure = 0.5 * space["air_density"] * speed**2 * craft.geometry.S
    rate = craft.geometry.c / (2.0 * speed)
    weight = mass * craft.environment.gravity / pressure
    turning = truth["CL_alpha"] + truth.get("CD_0", 0.0) + truth["CD_k"] * weight**2
    lines = np.array([[turning, truth["CL_de"]], [truth["Cm_alpha"], truth["Cm_de"]]])
    _, elevator = np.linalg.solve(lines, [mass * speed / pressure, -truth["Cm_q"] * rate])
    scale = 45.0 / math.degrees(0.436) / 15.0
    return numbers(tune(result, "ardupilot"), {
        "RLL_RATE_FF": abs(truth["Cl_p"] / truth["Cl_da"]) * craft.geometry.b / 2.0 * scale,
        "PTCH_RATE_FF": abs(elevator) * speed * scale,
    })  # fmt: skip


def of_simulator(name: str, seed: int) -> Line:
    """Everything but limits, of an aircraft that is a little crooked."""
    g = np.random.default_rng([seed, 41, SIMULATED.index(name)])
    craft, model = load_vehicle(name), read_model(name)
    crooked = dict(zip(("Cl_0", "Cn_0", "Cm_0"), g.normal(0.0, (0.003, 0.003, 0.02)).tolist(), strict=True))
    crooked["Cm_0"] += model.values().get("Cm_0", 0.0)
    damped = {key: value for key, value in (("Cm_q", -6.0), ("CL_q", 3.0)) if key not in model.values()}
    entries = {key: Coefficient(value) for key, value in (crooked | damped).items()}
    flown = replace(model, coefficients={**model.coefficients, **entries})
    scale, (north, east) = float(g.normal(0.0, 0.04)), g.normal(0.0, WIND, 2).tolist()
    effects = (f"airspeed_error:scale={scale:.5f}", f"steady_wind:north={north:.3f},east={east:.3f}")
    signals, _ = fly_mav("multisine,multisine", seed, effects=effects, model=flown, vehicle=craft, max_step=0.005)
    given = replace(craft, mass=replace(craft.mass, mass=craft.mass.mass * math.exp(MASS_STD * g.standard_normal())))
    text = (VEHICLES / f"{name}.toml").read_text(encoding="utf-8")
    result = with_aircraft(result_json(identify([signals], given)), text, name)
    result["aircraft"]["file"]["mass"]["mass"] = given.mass.mass
    right = with_aircraft({**result, "model": flown.to_json(), "sensor_errors": {}}, text, name)
    truth = {one["name"]: one["value"] for one in tune(right, "ardupilot")["parameters"]}
    truth["ARSPD_RATIO"] = NOW["ARSPD_RATIO"] / (1.0 + scale) ** 2
    return numbers(tune(result, "ardupilot"), truth)


def fly(family: str, seed: int) -> Line:
    """One flight of either kind."""
    try:
        if family in SIMULATED:
            return of_simulator(family, seed)
        with tempfile.TemporaryDirectory() as folder:
            return of_field(field_flight(family, seed, Path(folder)))
    except SysidError as error:
        return {"error": str(error)}


def report(lines: Sequence[Line]) -> None:
    """By family and by parameter: how many intervals, how many hold the truth, the worst miss, the usual width."""
    groups: dict[str, list[list[float]]] = defaultdict(list)
    refused: dict[str, int] = defaultdict(int)
    for line in lines:
        for name, entry in line.get("found", {}).items():
            for group in (line["family"], name, "all"):
                groups[group].append(entry)
        for name in line.get("refused", []):
            for group in (line["family"], name, "all"):
                refused[group] += 1
    print(f"{'':<20}{'intervals':>10}{'hold':>9}{'worst':>9}{'width':>9}{'refused':>9}")
    for group in dict.fromkeys([*groups, *refused]):
        every = np.array(groups.get(group) or np.empty((0, 4)))
        value, low, high, truth = every.T
        if not value.size:
            print(f"{group:<20}{0:>10}{'':>27}{refused[group]:>9}")
            continue
        # What is whole in an autopilot is right to half a step.
        step = np.array([0.5 if abs(one) >= 100.0 or one == round(one) else 0.0 for one in value])
        off = np.maximum(np.maximum(low - truth, truth - high) - step, 0.0)
        miss = np.max(np.abs(value - truth) / np.maximum((high - low) / 3.92, 1e-12) * (off > 0.0))
        width = np.median((high - low) / np.maximum(np.abs(truth), 1e-9))
        print(f"{group:<20}{value.size:>10}{np.mean(off == 0.0):>9.1%}{miss:>9.1f}{width:>9.1%}{refused[group]:>9}")
    for line in lines:
        if "error" in line:
            print(f"{line['family']} {line['seed']}: {line['error']}")


if __name__ == "__main__":
    resumable("tuning", __doc__, (*FIELD, *SIMULATED), 6, fly, report)
