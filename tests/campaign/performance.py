"""Whether the intervals of `gcs performance` hold: glide, sink, and how long and how far a battery lasts.

Run: make campaign NAME=performance

Each aircraft that comes with the simulator, its drag drawn anew, a mass known to 1 %, gusts, and a battery, a motor and
a propeller of a wind tunnel (tests/support/electric_drive.py) whose voltage and current are read five times a second.
Of even seeds thrust is measured, of odd ones the battery gives it, by the propeller's print alone. Truth of glide and
sink is the sheet of the model that was flown (closed forms hold it in tests), of endurance and range what the drive
takes for that model's drag. Every flight is a line of JSON in --store; what is there already is not run again.
"""

from __future__ import annotations

import math
import sys
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent / "support"))

import numpy as np
from electric_drive import Drive, with_battery
from resumable import resumable
from simulated import fly_mav

from gcs.errors import GcsError
from gcs.exports.exported import Exported
from gcs.exports.performance import performance
from sim_vehicle.model.model_file import Coefficient, model_from_json, read_model
from sim_vehicle.vehicle.propulsion import Propulsion
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.errors import SysidError
from sysid.identification.result_file import result_json
from sysid.identify import identify

# How large the propeller is beside those of the wind tunnel, the motor's speed by voltage, rad/s/V, and the battery, V.
DRIVES = {"iitb-mav": (1.0, 100.0, 12.3), "aerosonde": (2.0, 25.0, 33.0), "ultrastick25e": (1.25, 70.0, 16.4)}
PLANS = ("multisine,throttle-step", "elevator-3211,throttle-step,aileron-doublet,rudder-doublet,cruise")
# Share of the usual airspeed at which they are flown, so that best glide is within the speeds that the sheet looks at.
SLOWER = {"iitb-mav": 0.85, "aerosonde": 0.8, "ultrastick25e": 0.75}
GLIDE = ("best_glide_ratio", "best_glide_speed", "min_sink", "min_sink_speed")
BATTERY_WH, MASS_STD = 40.0, 0.01
Line = dict[str, Any]


def fly(name: str, seed: int) -> Line:
    """One flight: figure -> value, ends of its interval, truth; and what was refused."""
    g = np.random.default_rng([seed, 61, list(DRIVES).index(name)])
    craft, model = load_vehicle(name), read_model(name)
    craft = replace(craft, flight=replace(craft.flight, airspeed=SLOWER[name] * craft.flight.airspeed))
    damped = {key: value for key, value in (("Cm_q", -6.0), ("CL_q", 3.0)) if key not in model.values()}
    more = {
        key: model.values()[key] * math.exp(0.2 * g.standard_normal())
        for key in ("CD_0", "CD_k")
        if key in model.values()
    }
    changed = {key: Coefficient(value) for key, value in (damped | more).items()}
    flown = replace(model, coefficients={**model.coefficients, **changed})
    larger, kv, charged = DRIVES[name]
    drive = Drive(
        str(g.choice(["10x4.7", "11x4.7"])), kv * math.exp(0.1 * g.standard_normal()), float(g.uniform(0.04, 0.1)),
        float(g.uniform(0.3, 1.0)), float(g.uniform(0.9, 0.97)), charged, float(g.uniform(0.02, 0.05)), larger=larger,
    )  # fmt: skip
    plan = PLANS[seed // 2 % 2]
    read, flight = fly_mav(plan, seed, effects=("turbulence:sigma=0.3",), model=flown, vehicle=craft, max_step=0.005)
    truth = flight.truth
    given = {"time_s": flight.time_s, "thrust": truth["thrust"], "airspeed": truth["V"], "rho": truth["rho"]}
    signals = with_battery(read, drive, given, 5.0, seed)
    known = replace(craft, mass=replace(craft.mass, mass=craft.mass.mass * math.exp(MASS_STD * g.standard_normal())))
    assert craft.propulsion is not None
    motor = replace(craft.propulsion, diameter=drive.diameter, pitch=drive.pitch, CT=(), CQ=(), max_rpm=None)
    if seed % 2:
        motor = Propulsion(line=motor.line, diameter=drive.diameter, pitch=drive.pitch, tau=motor.tau)
    else:
        motor = replace(motor, max_thrust=motor.max_thrust or 2.0 * float(np.max(truth["thrust"])))
        signals = replace(signals, signals={**signals.signals, "thrust": read.signals["thrust"]})
    known = replace(known, propulsion=motor)
    try:
        result = result_json(identify([signals], known))
        sheet = performance(
            Exported(model_from_json(result["model"], name), known), powered=result["battery"], battery=BATTERY_WH
        )
    except (GcsError, SysidError) as error:
        return {"error": str(error)}
    right = performance(Exported(replace(flown, validity=model_from_json(result["model"], name).validity), craft))
    wanted = {key: right["figures"][key].get("value") for key in GLIDE} | lasting(right, craft.mass.mass, drive)
    found, refused = {}, []
    for key, value in wanted.items():
        entry = sheet["figures"][key]
        if value is None or "interval" not in entry:
            refused.append(key)
        else:
            found[key] = [entry["value"], *entry["interval"], value]
    return {"found": found, "refused": refused, "powered": bool(seed % 2)}


def lasting(right: dict[str, Any], mass: float, drive: Drive) -> dict[str, float]:
    """How long, min, and how far, km, the battery lasts in level flight of the aircraft that was flown."""
    rows = right["speeds"]
    speed, drag = (np.array([row[key] for row in rows]) for key in ("speed", "drag"))
    fine = np.linspace(speed[0], speed[-1], 2000)
    power = drive.power(np.interp(fine, speed, drag), fine, np.full(fine.size, right["air_density"]))
    power = power + drive.electronics
    return {
        "endurance": BATTERY_WH * 60.0 / float(power.min()),
        "range": BATTERY_WH / float(np.min(power / fine / 3.6)),
    }


def report(lines: Sequence[Line]) -> None:
    """By aircraft, source of thrust and figure: how many intervals hold the truth, the worst miss, the usual width."""
    groups: dict[str, list[list[float]]] = defaultdict(list)
    refused: dict[str, int] = defaultdict(int)
    for line in lines:
        source = "thrust by battery" if line.get("powered") else "thrust measured"
        for name, entry in line.get("found", {}).items():
            for group in (line["family"], source, name, "all"):
                groups[group].append(entry)
        for name in line.get("refused", []):
            for group in (line["family"], source, name, "all"):
                refused[group] += 1
    print(f"{'':<20}{'intervals':>10}{'hold':>9}{'worst':>9}{'width':>9}{'no interval':>13}")
    for group in dict.fromkeys([*groups, *refused]):
        value, low, high, truth = np.array(groups.get(group) or np.empty((0, 4))).T
        if not value.size:
            print(f"{group:<20}{0:>10}{'':>27}{refused[group]:>13}")
            continue
        off = np.maximum(np.maximum(low - truth, truth - high), 0.0)
        worst = np.max(np.abs(value - truth) / ((high - low) / 3.92) * (off > 0.0))
        width = np.median((high - low) / np.abs(truth))
        print(f"{group:<20}{value.size:>10}{np.mean(off == 0.0):>9.1%}{worst:>9.1f}{width:>9.1%}{refused[group]:>13}")
    for line in lines:
        if "error" in line:
            print(f"{line['family']} {line['seed']}: {line['error']}")


if __name__ == "__main__":
    resumable("performance", __doc__, tuple(DRIVES), 12, fly, report)
