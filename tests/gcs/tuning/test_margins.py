"""Margins of an autopilot's loops against python-control, and against a flight in which a gain is raised."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from flown_loop import RollLoop
from processes import run
from simulated import fly_mav
from tuned_result import BOARD, SPEED, a_result, damped

from gcs.errors import SettingsError
from gcs.tuning.handling import handling
from gcs.tuning.margins import margins
from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.model.model_file import Coefficient, Model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identification.linear_model import OUTPUTS, linearise
from sysid.identification.result_file import result_json
from sysid.identify import identify

DELAY, LAG, TRAVEL = 0.025, 0.03, 0.436
SERVOS = [
    {"name": name, "group": group, "value": value, "std": 0.003}
    for group in ("longitudinal", "lateral")
    for name, value in (("servo_delay", DELAY), ("servo_lag", LAG))
]


def sheet(model: Model, **changed: float) -> dict[str, Any]:
    return margins(a_result(model, BOARD | changed, nuisances=SERVOS))


def by_control(axis: str, model: Model, board: dict[str, float]) -> Any:
    """The open loop of ArduPilot's block diagram, as python-control makes it of blocks."""
    craft = load_vehicle("iitb-mav")
    there = replace(craft, environment=replace(craft.environment, air_density=SEA_LEVEL_DENSITY))
    system = linearise(there, model, SPEED, SEA_LEVEL_DENSITY).system
    column, rate, angle, prefix = {
        "roll": (1, "p", "phi", "RLL"), "pitch": (0, "q", "theta", "PTCH"),
    }[axis]  # fmt: skip
    rows = [OUTPUTS.index(rate), OUTPUTS.index(angle)]
    sense = math.copysign(1.0, model.values()["Cl_da" if axis == "roll" else "Cm_de"])
    plant = control.ss(system.A, system.B[:, [column]], system.C[rows], system.D[np.ix_(rows, [column])])
    s = control.tf("s")
    late = control.tf(*control.pade(DELAY + 0.5 / board["SCHED_LOOP_RATE"], 6))
    servo = sense * TRAVEL * late / (LAG * s + 1)
    w = 2.0 * math.pi * board["INS_GYRO_FILTER"]
    gyro = w**2 / (s**2 + math.sqrt(2.0) * w * s + w**2)
    scaler = board["SCALING_SPEED"] / SPEED
    p, i, d, ff = (board[f"{prefix}_RATE_{k}"] for k in ("P", "I", "D", "FF"))
    pid = p + i / s + d * s / (s / (2.0 * math.pi * 12.0) + 1)
    target = 1 / (s / (2.0 * math.pi * 3.0) + 1)
    share = math.degrees(1.0) / 45.0
    demand = target / board[f"{prefix}2SRV_TCONST"]
    of_rate = share * scaler**2 * pid * gyro
    of_angle = share * (scaler**2 * pid + scaler * ff) * demand
    return control.ss(of_rate * servo) * plant[0, 0] + control.ss(of_angle * servo) * plant[1, 0]


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_margins_are_those_of_python_control(axis: str) -> None:
    found, loop = sheet(damped())["loops"][axis], by_control(axis, damped(), BOARD)
    hz = np.geomspace(0.05, 20.0, 4000)
    gain, phase, _ = control.frequency_response(loop, 2.0 * math.pi * hz)
    most, spare, _, turn, cross, _ = control.stability_margins((gain, np.degrees(phase), 2.0 * math.pi * hz))
    assert found["stable"]
    assert found["gain_margin"]["value"] == pytest.approx(20.0 * math.log10(most), abs=0.3)
    assert found["phase_margin"]["value"] == pytest.approx(spare, abs=1.0)
    assert found["oscillation"]["value"] == pytest.approx(turn / 2.0 / math.pi, rel=0.02)
    assert found["crossover"]["value"] == pytest.approx(cross / 2.0 / math.pi, rel=0.02)
    sensitivity = 20.0 * np.log10(np.max(np.abs(1.0 / (1.0 + gain * np.exp(1j * phase)))))
    assert found["peak_sensitivity"]["value"] == pytest.approx(sensitivity, abs=0.2)


@pytest.mark.parametrize("factor", [1.0, 2.0, 3.0, 4.5, 6.0])
@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_a_loop_is_stable_where_its_poles_are(axis: str, factor: float) -> None:
    prefix = {"roll": "RLL", "pitch": "PTCH"}[axis]
    board = {f"{prefix}_RATE_{k}": factor * BOARD[f"{prefix}_RATE_{k}"] for k in ("P", "I", "D")}
    poles = control.feedback(1, by_control(axis, damped(), BOARD | board)).poles()
    assert sheet(damped(), **board)["loops"][axis]["stable"] == bool(np.max(poles.real) < 0.02)


def test_the_gain_that_is_the_limit_oscillates_in_flight() -> None:
    """Flown: the roll loop at 50 Hz, its servo late and lagging; a kick, and whether its answer grows."""
    model = damped()
    found = sheet(model)["loops"]["roll"]["gains"]["P"]
    limit = found["may_grow"]["value"]
    loop = RollLoop(load_vehicle("iitb-mav"), model, BOARD, SPEED, DELAY, LAG)
    assert not loop.grows(0.85 * limit)
    assert loop.grows(1.15 * limit)


def test_intervals_hold_the_truth_and_a_guessed_inertia_widens_nothing() -> None:
    """The flight shows the loop's motion, not the inertia: limits are as sharp as Cl_p and Cl_da together."""
    craft = load_vehicle("iitb-mav")
    signals, _ = fly_mav("multisine", 5, model=damped())
    beside = {key: a_result(damped(), BOARD)[key] for key in ("aircraft", "made")}
    widths = []
    for std in (None, 0.014):
        mass = replace(craft.mass, Ixx_std=std)
        result = result_json(identify([signals], replace(craft, mass=mass)))
        made = {**result, **beside, "nuisances": SERVOS}
        made["aircraft"]["file"]["mass"] = {
            **made["aircraft"]["file"]["mass"],
            **({} if std is None else {"Ixx_std": std}),
        }
        found, truth = margins(made)["loops"], sheet(damped())["loops"]
        for axis in ("roll", "pitch"):
            for name in ("gain_margin", "phase_margin"):
                low, high = found[axis][name]["interval"]
                assert low < truth[axis][name]["value"] < high
        low, high = found["roll"]["gain_margin"]["interval"]
        widths.append(high - low)
    assert widths[1] < 1.3 * widths[0]


@pytest.mark.parametrize(("changed", "axis"), [({"Cl_r": 0.4}, "pitch"), ({"Cm_alpha": 0.05}, "roll")])
def test_what_grows_in_the_other_axes_makes_no_loop_unstable(changed: dict[str, float], axis: str) -> None:
    """A spiral that diverges, and an aircraft that tips over: neither is in the other loop."""
    model = damped()
    entries = {name: Coefficient(value) for name, value in changed.items()}
    model = replace(model, coefficients={**model.coefficients, **entries})
    there = replace(load_vehicle("iitb-mav"), warnings=())
    there = replace(there, environment=replace(there.environment, air_density=SEA_LEVEL_DENSITY))
    system = linearise(there, model, SPEED, SEA_LEVEL_DENSITY).system
    assert np.max(np.linalg.eigvals(system.A).real) > 0.05
    assert sheet(model)["loops"][axis]["stable"]


def test_px4_s_gains_are_found_and_what_is_not_there_is_said(tmp_path: Path) -> None:
    board = {"FW_RR_P": 0.1, "FW_RR_I": 0.1, "FW_RR_FF": 0.3, "FW_R_TC": 0.4, "FW_AIRSPD_TRIM": 25.0, "FW_PR_P": 0.1}
    found = margins(a_result(damped(), board, nuisances=SERVOS))
    assert found["autopilot"] == "px4"
    assert set(found["loops"]) == {"roll"}
    assert found["loops"]["roll"]["gains"]["P"]["parameter"] == "FW_RR_P"
    assert found["refused"] == [{"name": "pitch", "refused": "the recording does not hold FW_PR_I, FW_PR_FF"}]
    # Without scaling gains act as they are, here by less than a third of what 25 over 15 m/s, squared, makes of them.
    bare = margins(a_result(damped(), board | {"FW_ARSP_SCALE_EN": 0.0}, nuisances=SERVOS))
    margin = [one["loops"]["roll"]["gain_margin"]["value"] for one in (found, bare)]
    assert margin[1] - margin[0] > 3.0
    with pytest.raises(SettingsError, match="no gains of the rate loops"):
        margins(a_result(damped(), {"SCALING_SPEED": 15.0}))
    path = tmp_path / "result.json"
    path.write_text(json.dumps(a_result(damped(), BOARD)))
    done = run("gcs", "margins", path, "--vehicle", "iitb-mav")
    assert done.returncode == 0, done.stderr
    assert "RLL_RATE_P (0.12) may grow" in done.stdout
    assert "no intervals: " in done.stdout
    path.write_text(json.dumps(a_result(damped(), {})))
    done = run("gcs", "margins", path)
    assert done.returncode == 2
    assert "give by --log the recording" in done.stderr


def test_modes_are_of_the_level_that_the_standard_says() -> None:
    """MIL-F-8785C by hand; of an aircraft of the standard's own span nothing is scaled."""
    modes = [
        {"name": "short period", "eigenvalue": [-1.0, 2.0], "damping_ratio": {"value": 0.25}},
        {"name": "Dutch roll", "eigenvalue": [-0.1, 0.3], "damping_ratio": {"value": 0.3},
         "frequency_hz": {"value": 0.05}},
        {"name": "spiral", "eigenvalue": [math.log(2.0) / 10.0, 0.0]},
        {"name": "roll", "eigenvalue": [-1.0, 0.0], "time_constant_s": {"value": 1.0}},
    ]  # fmt: skip
    found = {(one["mode"], one["quantity"]): one["level"] for one in handling(modes, 10.0)}
    assert found == {
        ("short period", "damping_ratio"): 2, ("Dutch roll", "damping_ratio"): 1, ("Dutch roll", "frequency"): 4,
        ("spiral", "time_to_double"): 2, ("roll", "time_constant"): 1,
    }  # fmt: skip
    # A tenth of the size lives faster by the root of ten: a roll of 1 s is one of 3.2 s.
    small = {one["mode"]: one for one in handling(modes[3:], 1.0)}
    assert small["roll"]["value"] == pytest.approx(math.sqrt(10.0))
    assert small["roll"]["level"] == 3
    # A phugoid that grows is of level 3 where it doubles in 55 s or more.
    slow = {"name": "phugoid", "eigenvalue": [math.log(2.0) / 60.0, 0.4], "damping_ratio": {"value": -0.03}}
    fast = {**slow, "eigenvalue": [math.log(2.0) / 30.0, 0.4]}
    assert [one["level"] for mode in (slow, fast) for one in handling([mode], 10.0)] == [3, 4]
