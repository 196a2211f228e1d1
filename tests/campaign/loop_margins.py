"""Whether the gain that `gcs margins` calls the limit is the one at which the loop begins to oscillate in flight.

Run: make campaign NAME=margins

Each aircraft that comes with the simulator, its damping and its effectiveness drawn anew, a board with gains drawn anew
and a servo that is late and lags: a flight in gusts is identified, the sheet made, and the roll loop flown step by step
with more and more of its proportional gain (tests/support/flown_loop.py). Every flight is a line of JSON in --store;
what is there already is not run again.
"""

from __future__ import annotations

import math
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent / "support"))

import numpy as np
from flown_loop import RollLoop
from resumable import resumable
from simulated import fly_mav

from gcs.tuning.margins import margins
from sim_vehicle.model.model_file import Coefficient, read_model
from sim_vehicle.vehicle.vehicle_file import VEHICLES, load_vehicle
from sysid.errors import SysidError
from sysid.identification.result_file import result_json
from sysid.identify import identify

AIRCRAFT = ("iitb-mav", "aerosonde", "ultrastick25e")
# Standard deviations that a servo's delay and lag are known by, s.
DELAY_STD, LAG_STD = 0.004, 0.004
Line = dict[str, Any]


def fly(name: str, seed: int) -> Line:
    """One flight: the factor by which the gain may grow, with its interval, and the one at which the loop does."""
    g = np.random.default_rng([seed, 51, AIRCRAFT.index(name)])
    craft, model = load_vehicle(name), read_model(name)
    changed = {
        key: Coefficient(model.values()[key] * math.exp(0.2 * g.standard_normal()))
        for key in ("Cl_p", "Cl_da", "Cn_beta", "Cl_beta")
        if model.values().get(key)
    }
    flown = replace(model, coefficients={**model.coefficients, **changed})
    speed = craft.flight.airspeed
    board = {
        "RLL_RATE_P": 0.08, "RLL_RATE_I": float(g.uniform(0.05, 0.2)), "RLL_RATE_D": float(g.uniform(0.0, 0.004)),
        "RLL_RATE_FF": float(g.uniform(0.1, 0.3)), "RLL2SRV_TCONST": float(g.uniform(0.4, 0.8)),
        "SCALING_SPEED": speed * float(g.uniform(0.8, 1.2)), "INS_GYRO_FILTER": float(g.uniform(15.0, 40.0)),
        "SCHED_LOOP_RATE": 50.0,
    }  # fmt: skip
    delay, lag = float(g.uniform(0.015, 0.04)), float(g.uniform(0.015, 0.05))
    given = {"servo_delay": (delay, DELAY_STD), "servo_lag": (lag, LAG_STD)}
    try:
        signals, _ = fly_mav(
            "multisine", seed, effects=("turbulence:sigma=0.3",), model=flown, vehicle=craft, max_step=0.005
        )
        result = result_json(identify([signals], craft))
    except SysidError as error:
        return {"error": str(error)}
    tables = tomllib.loads((VEHICLES / f"{name}.toml").read_text(encoding="utf-8"))
    tables.pop("calibration", None)
    result["aircraft"] = {"file": tables, "parameters": board, "airspeed": ""}
    result["made"] = {"settings": {"vehicle": name}}
    result["nuisances"] = [
        {"name": key, "group": "lateral", "value": value + std * float(g.standard_normal()), "std": std}
        for key, (value, std) in given.items()
    ]
    sheet = margins(result)
    if "roll" not in sheet["loops"]:
        return {"error": sheet["refused"][0]["refused"]}
    found = sheet["loops"]["roll"]["gains"]["P"]["may_grow"]
    flies = RollLoop(craft, flown, board, result["state_space"]["airspeed"], delay, lag).limit()
    return {"value": found["value"], "interval": found.get("interval"), "flown": None if math.isinf(flies) else flies}


def report(lines: Sequence[Line]) -> None:
    """Per flight the factor and its interval, and what was flown; and how many intervals hold."""
    held = 0
    given = [line for line in lines if line.get("interval") and line["flown"]]
    print(f"{'':<20}{'may grow':>9}  {'95 %':<16}{'flown':>7}")
    for line in given:
        low, high = (math.inf if one is None else one for one in line["interval"])
        inside = low <= line["flown"] <= high
        held += inside
        between, name = f"{low:>6.2f} … {high:<7.2f}", f"{line['family']} {line['seed']}"
        print(f"{name:<20}{line['value']:>9.2f}  {between}{line['flown']:>7.2f}{'' if inside else '  miss'}")
    print(f"{held} of {len(given)} hold")
    for line in lines:
        if "error" in line:
            print(f"{line['family']} {line['seed']}: {line['error']}")


if __name__ == "__main__":
    resumable("margins", __doc__, AIRCRAFT, 7, fly, report)
