"""Two telemetry logs that pymavlink wrote of flights that JSBSim flew, and `gcs discrepancy` on them.

None of the four files is made by this project: the logs are pymavlink's, the aircraft with the hidden effect is
JSBSim's (drag of the elevator, a term of its drag function), and vehicle and model are written down here as a user
would, the coefficients off by up to 5 %.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NoReturn

import pytest
from discrepancy_flights import over_floor
from jsbsim_effects import hidden
from jsbsim_telemetry import telemetry
from other_aircraft import write_tlog
from processes import run
from pymavlink.dialects.v20 import ardupilotmega as mavlink

FIT_S, JUDGE_S = 8.0, 6.0
VEHICLE = """
name = "stick"
[mass]
mass = 1.959
Ixx = 0.07151
Iyy = 0.08636
Izz = 0.15364
Ixz = 0.014
[geometry]
S = 0.3097
b = 1.27
c = 0.25
[controls.aileron]
servo = 1
pwm = [1000, 1500, 2000]
deflection = [-0.5, 0.0, 0.5]
[controls.elevator]
servo = 2
pwm = [1000, 1500, 2000]
deflection = [0.5, 0.0, -0.5]
[controls.throttle]
servo = 3
pwm = [1000, 2000]
deflection = [0.0, 1.0]
[controls.rudder]
servo = 4
pwm = [1000, 1500, 2000]
deflection = [0.5, 0.0, -0.5]
[propulsion]
line = [0.297, 0.0, -0.046]
max_thrust = 7.86
tau = 0.169
[sensors]
accelerometer = { position = [0.05, -0.01, 0.02] }
alpha_vane = { position = [0.197, 0.356, 0.0] }
beta_vane = { position = [0.197, 0.356, 0.0], kind = "sideslip" }
airspeed = { kind = "true" }
[signals]      # vanes on an autopilot that otherwise reports its filter's estimate under this message
alpha = { message = "AOA_SSA", field = "AOA", scale = 0.017453292519943295 }
beta = { message = "AOA_SSA", field = "SSA", scale = 0.017453292519943295 }
"""
MODEL = {
    "CL_0": 0.112, "CL_alpha": 4.42, "CL_q": 7.9, "CL_de": 0.096, "CD_0": 0.0490, "CD_k": 0.0785, "Cm_0": -0.0271,
    "Cm_alpha": -0.75, "Cm_q": -13.1, "Cm_de": -0.88, "CY_beta": -0.52, "CY_p": -0.0385, "CY_r": 0.145,
    "CY_dr": 0.20, "Cl_beta": -0.0565, "Cl_p": -0.435, "Cl_r": 0.112, "Cl_da": -0.169, "Cl_dr": 0.0111,
    "Cn_beta": 0.070, "Cn_p": -0.0309, "Cn_r": -0.19, "Cn_da": 0.0169, "Cn_dr": -0.176,
}  # fmt: skip
STAGES = ("given", "before", "after", "noise_floor")


def no_constant(text: str) -> NoReturn:
    raise AssertionError(f"{text} is no JSON")


def assert_is_discrepancy(found: dict[str, Any]) -> None:
    """Every key of the schema, with its type."""
    assert found["schema"] == "discrepancy/1"
    assert found["verdict"] in ("none", "parameter_error", "missing_effect", "unexplained")
    for place in found["where"]:
        assert place.keys() >= {"axis", "variable", "intervals", "share", "p_value"}
        for interval in place["intervals"]:
            assert interval["flight"] == "fit"
            assert 0.0 <= interval["start"] < interval["end"] <= FIT_S + 0.1
    for effect in found["effects"]:
        assert effect.keys() >= {"name", "probability", "parameters", "alternatives", "separating_manoeuvre"}
        assert all(entry.keys() >= {"value", "std"} for entry in effect["parameters"].values())
    assert found["gap"].keys() == {"estimation", "validation"}
    outputs = {"V", "alpha", "beta", "p", "q", "r", "phi", "theta", "ax", "ay", "az"}
    for gap in found["gap"].values():
        assert gap.keys() == set(STAGES)
        assert all(gap[stage].keys() == outputs for stage in STAGES)
        assert all(math.isfinite(value) and value > 0.0 for stage in STAGES for value in gap[stage].values())
    assert found["model"]["schema"] == "model/1"
    assert found["model"]["coefficients"].keys() >= MODEL.keys()


def test_logs_of_another_engine_give_the_effect_that_it_flew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    effect = hidden("control_drag")
    (flown,) = effect.parameters.values()
    for name, seed, seconds in (("fit", 1, FIT_S), ("judge", 2, JUDGE_S)):
        rows = telemetry(tmp_path, effect.flown, seed, seconds)
        write_tlog(tmp_path / f"{name}.tlog", rows, "RAW_IMU", 30.0, autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    (tmp_path / "stick.toml").write_text(VEHICLE, encoding="utf-8")
    coefficients = {name: {"value": value} for name, value in MODEL.items()}
    model = {"schema": "model/1", "name": "stick", "coefficients": coefficients, "effects": []}
    (tmp_path / "base.json").write_text(json.dumps(model), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    done = run("gcs", "discrepancy", "fit.tlog", "--validate", "judge.tlog", "--vehicle", "stick.toml", "--model",
               "base.json", "--json")  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout, parse_constant=no_constant)
    assert_is_discrepancy(found)
    assert found["verdict"] == "missing_effect", found["reasons"]
    assert [one["name"] for one in found["effects"]] == ["control_drag"], found["reasons"]
    (first,) = found["effects"]
    assert first["probability"] > 0.95
    estimate = first["parameters"]["CD_de2"]
    assert estimate["value"] == pytest.approx(flown, abs=4.0 * estimate["std"])
    assert 0.0 < estimate["statistical_std"] < 0.05 * flown
    assert found["model"]["coefficients"]["CD_de2"]["value"] == estimate["value"]
    gap = found["gap"]["validation"]
    assert over_floor(gap, "after") < 1.3
    assert over_floor(gap, "before") > 1.3 * over_floor(gap, "after")
