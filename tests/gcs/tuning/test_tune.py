"""What a flight says of an autopilot's parameters, held against what the parameters do in their controllers."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from processes import run
from pymavlink.mavparm import MAVParmDict
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve
from tuned_result import NOW, SPEED, a_result

from gcs.tuning.parameter_file import write_parameters
from gcs.tuning.tune import tune
from sim_vehicle.constants import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from sim_vehicle.effects import parse_effect
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.trim import solve_trim
from sim_vehicle.model.model_file import Coefficient, Model, read_model
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle

STILL = np.zeros(3)


def with_values(**values: float) -> Model:
    model = read_model("iitb-mav")
    return replace(model, coefficients={**model.coefficients, **{k: Coefficient(v) for k, v in values.items()}})


def proposed(result: dict[str, Any], autopilot: str = "ardupilot") -> dict[str, dict[str, Any]]:
    return {one["name"]: one for one in tune(result, autopilot)["parameters"]}


def refused(result: dict[str, Any], autopilot: str = "ardupilot") -> dict[str, str]:
    return {one["name"]: one["refused"] for one in tune(result, autopilot)["refused"]}


def in_standard_air() -> Vehicle:
    craft = load_vehicle("iitb-mav")
    return replace(craft, environment=replace(craft.environment, air_density=SEA_LEVEL_DENSITY))


def test_the_feedforward_of_roll_is_what_a_steady_roll_takes_in_flight() -> None:
    """Flown: an aileron held for 0.4 s, all that answers a roll but its own damping left out."""
    others = ("CY_beta", "CY_p", "CY_r", "CY_da", "Cl_beta", "Cl_r", "Cn_beta", "Cn_p", "Cn_r", "Cn_da")
    model = with_values(**dict.fromkeys(others, 0.0))
    plant = Plant(in_standard_air(), model)
    trim = solve_trim(plant, SPEED, 0.0)
    aileron = math.radians(2.0)
    command = trim.command + np.array([0.0, aileron, 0.0, 0.0])
    surfaces = trim.state.surfaces + np.array([0.0, aileron, 0.0, 0.0])
    flown = solve_ivp(
        lambda t, x: plant.rates(plant.state_at(x, command, surfaces), STILL, STILL),
        (0.0, 0.4),
        trim.state.x,
        rtol=1e-8,
    )
    rate_deg = math.degrees(abs(flown.y[10, -1]))
    # ArduPilot: 45 notional degrees are the whole travel, and at SCALING_SPEED the feedforward is not scaled.
    notional_deg = 45.0 * math.degrees(aileron) / math.degrees(0.436)
    found = proposed(a_result(model))["RLL_RATE_FF"]
    assert found["value"] * rate_deg == pytest.approx(notional_deg, rel=0.01)
    assert found["now"] == 0.3
    # PX4: 1 is the whole travel, rates are in rad/s.
    px4 = proposed(a_result(model, {"FW_AIRSPD_TRIM": 12.0}), "px4")["FW_RR_FF"]
    scaling = 12.0 / SPEED
    assert px4["value"] * math.radians(rate_deg) * scaling == pytest.approx(aileron / 0.436, rel=0.01)


def test_the_feedforward_of_pitch_is_what_a_steady_pull_up_takes() -> None:
    """Flown: the angle of attack, pitch rate and elevator at which neither flow nor rate changes, at one speed."""
    model = with_values(Cm_q=-6.0, CL_q=3.0)
    plant = Plant(in_standard_air(), model)
    trim = solve_trim(plant, SPEED, 0.0)
    level = float(plant.outputs(trim.state)[1])
    rate = 0.05

    def unsteady(unknowns: np.ndarray) -> list[float]:
        alpha, elevator = unknowns
        x = trim.state.x.copy()
        x[3], x[5], x[11], x[13] = SPEED * math.cos(alpha), SPEED * math.sin(alpha), rate, alpha
        # The path stays level, so that gravity stands to the lift as it did.
        x[6:10] = [math.cos(alpha / 2.0), 0.0, math.sin(alpha / 2.0), 0.0]
        change = np.array([elevator, 0.0, 0.0, 0.0])
        state = plant.state_at(x, trim.command + change, trim.state.surfaces + change)
        moved = plant.rates(state, STILL, STILL)
        turning = (x[3] * moved[5] - x[5] * moved[3]) / SPEED**2
        return [turning, moved[11]]

    _, elevator = fsolve(unsteady, [level, 0.0])
    notional = 45.0 * abs(elevator) / 0.436
    found = proposed(a_result(model))["PTCH_RATE_FF"]["value"]
    assert found * math.degrees(rate) == pytest.approx(notional, rel=0.02)


def test_trims_are_the_pulses_at_which_forces_and_moments_are_in_balance() -> None:
    """Closed form: two lines, of lift and of moment, with thrust along the body."""
    model = with_values(Cm_0=0.02, Cl_0=0.004)
    craft, values = load_vehicle("iitb-mav"), model.values()
    pressure = 0.5 * SEA_LEVEL_DENSITY * SPEED**2 * craft.geometry.S
    lines = np.array([[values["CL_alpha"], values["CL_de"]], [values["Cm_alpha"], values["Cm_de"]]])
    alpha = elevator = 0.0
    for _ in range(20):
        drag = values["CD_0"] + values["CD_k"] * (values["CL_0"] + lines[0] @ [alpha, elevator]) ** 2
        lift = craft.mass.mass * STANDARD_GRAVITY / pressure - drag * math.tan(alpha)
        alpha, elevator = np.linalg.solve(lines, [lift - values["CL_0"], -0.02])
    found = proposed(a_result(model))
    assert found["SERVO2_TRIM"]["value"] == pytest.approx(1500.0 + 500.0 * elevator / 0.436, abs=1.0)
    assert found["SERVO2_TRIM"]["unit"] == "us"
    # Rudder and bank keep the aircraft straight, and are small beside the aileron that Cl_0 takes.
    aileron = -0.004 / values["Cl_da"]
    assert found["SERVO1_TRIM"]["value"] == pytest.approx(1500.0 + 500.0 * aileron / 0.436, abs=4.0)
    sink = SPEED * drag / math.hypot(drag, lift)
    assert found["TECS_SINK_MIN"]["value"] == pytest.approx(sink, rel=0.01)
    # A servo at 47 % of full thrust, which is in proportion to the throttle.
    thrust = drag * pressure / math.cos(alpha)
    assert found["TRIM_THROTTLE"]["value"] == pytest.approx(100.0 * thrust / craft.propulsion.max_thrust, abs=0.6)
    assert found["TECS_CLMB_MAX"]["value"] == pytest.approx(
        SPEED * (craft.propulsion.max_thrust - drag * pressure) / (craft.mass.mass * STANDARD_GRAVITY), rel=0.02
    )


def test_an_airspeed_that_reads_high_lowers_the_ratio_and_intervals_are_its_errors() -> None:
    """ArduPilot: airspeed is the root of pressure times ARSPD_RATIO; PX4: CAS is ASPD_SCALE times what it reads."""
    errors = {
        "airspeed_scale": {"value": 0.05, "std": 0.005, "unit": "1"},
        "theta_bias": {"value": 0.02, "std": 0.002, "unit": "rad"},
    }
    result = a_result(read_model("iitb-mav"), sensor_errors=errors)
    found = proposed(result)
    pressure = (SPEED * 1.05) ** 2 / 2.0
    assert math.sqrt(found["ARSPD_RATIO"]["value"] * pressure) == pytest.approx(SPEED, rel=1e-4)
    low, high = found["ARSPD_RATIO"]["interval"]
    assert (high - low) / 3.92 == pytest.approx(2.0 * 2.0 * 0.005 / 1.05**3, rel=0.15)
    # A turned board turns both that the attitude is held against: no flight shows it.
    assert "pitch reads +1.15 deg against the accelerometers" in refused(result)["AHRS_TRIM_Y"]
    px4 = proposed(a_result(read_model("iitb-mav"), {"ASPD_SCALE_1": 1.0}, sensor_errors=errors), "px4")
    assert px4["ASPD_SCALE_1"]["value"] == pytest.approx(1.0 / 1.05, abs=1e-4)
    assert "ARSPD_TYPE is 0" in refused(a_result(read_model("iitb-mav"), NOW | {"ARSPD_TYPE": 0.0}))["ARSPD_RATIO"]
    assert "does not hold what it is now" in refused(a_result(read_model("iitb-mav"), {}), "px4")["ASPD_SCALE_1"]
    of_vane = {**result, "aircraft": {**result["aircraft"], "airspeed": "NAMED_VALUE_FLOAT.adc3"}}
    assert "not the autopilot's own" in refused(of_vane)["ARSPD_RATIO"]


def test_what_the_flight_does_not_show_is_refused_with_the_reason() -> None:
    why = refused(a_result(read_model("iitb-mav"), {"LIM_ROLL_CD": 4500.0}))
    assert "does not hold what it is now" in why["ARSPD_RATIO"]
    assert "no stall was approached" in why["AIRSPEED_MIN"]
    assert "no stall was approached" in why["LIM_ROLL_CD"]  # by the name that the log has it under
    lacking = replace(
        read_model("iitb-mav"),
        coefficients={**read_model("iitb-mav").coefficients, "Cl_p": Coefficient(None, refused="roll did not move")},
    )
    why = refused(a_result(lacking))
    assert why["RLL_RATE_FF"] == "nothing is known of Cl_p"
    still = replace(with_values(Cm_q=-6.0), coefficients={
        **with_values(Cm_q=-6.0).coefficients, "Cm_alpha": Coefficient(None, refused="alpha did not move"),
    })  # fmt: skip
    assert refused(a_result(still))["PTCH_RATE_FF"] == "nothing is known of Cm_alpha"
    # Behind its manoeuvre point a pull-up is held by pushing.
    assert "beyond the manoeuvre point" in refused(a_result(with_values(Cm_q=-6.0, Cm_alpha=0.9)))["PTCH_RATE_FF"]


def test_a_stall_that_was_found_gives_the_slowest_speed_and_the_steepest_bank() -> None:
    model = read_model("iitb-mav").with_effect(*parse_effect("stall:alpha_stall=0.3"))
    result = a_result(model)
    result["model"]["validity"] = {"airspeed": [9.0, 18.0], "alpha": [0.0, 0.35]}
    found = proposed(result)
    slow = found["AIRSPEED_STALL"]["value"]
    assert 8.0 < slow < 13.0
    assert found["AIRSPEED_MIN"]["value"] == pytest.approx(1.2 * slow, abs=0.1)
    # In a level turn the stall speed grows with the root of the load.
    fast = a_result(model, state_space={"airspeed": 1.1 * slow, "air_density": SEA_LEVEL_DENSITY})
    fast["model"]["validity"] = result["model"]["validity"]
    assert "less than 1.2 times the stall speed" in refused(fast)["LIM_ROLL_CD"]
    bank = math.radians(found["LIM_ROLL_CD"]["value"] / 100.0)
    assert 1.2 * slow / math.sqrt(math.cos(bank)) == pytest.approx(SPEED, rel=0.02)


def test_the_file_is_read_by_those_that_load_it(tmp_path: Path) -> None:
    result = a_result(read_model("iitb-mav"))
    found = tune(result, "ardupilot")
    write_parameters(found, tmp_path / "plane.param")
    loaded = MAVParmDict()
    assert loaded.load(str(tmp_path / "plane.param"), use_excludes=False)
    assert dict(loaded) == {one["name"]: pytest.approx(one["value"]) for one in found["parameters"]}
    text = (tmp_path / "plane.param").read_text()
    assert "# RLL_RATE_FF: now 0.3: a steady rate needs so much" in text
    assert "# AIRSPEED_MIN: not proposed: no stall was approached" in text
    found = tune(result, "px4")
    write_parameters(found, tmp_path / "plane.params")
    rows = [line.split("\t") for line in (tmp_path / "plane.params").read_text().splitlines() if line[0] != "#"]
    # QGroundControl: vehicle, component, name, value, MAV_PARAM_TYPE.
    assert [row[2] for row in rows] == [one["name"] for one in found["parameters"]]
    assert all(len(row) == 5 and row[:2] == ["1", "1"] and row[4] in ("6", "9") for row in rows)


def test_a_full_demand_is_what_the_servo_s_range_makes_of_it() -> None:
    """Half of the range is half of the travel, so that the same roll takes twice the share of it."""
    model = with_values(Cl_0=0.0, Cn_0=0.0)
    whole = proposed(a_result(model, {"SERVO1_MIN": 1000.0, "SERVO1_MAX": 2000.0}))["RLL_RATE_FF"]["value"]
    half = proposed(a_result(model, {"SERVO1_MIN": 1250.0, "SERVO1_MAX": 1750.0}))["RLL_RATE_FF"]["value"]
    assert half == pytest.approx(2.0 * whole, rel=1e-3)
    assert any("ranges of servo 1, 2, 4" in line for line in tune(a_result(model, {}), "ardupilot")["warnings"])
    out = refused(a_result(with_values(Cm_0=0.3), {"SERVO2_MIN": 1480.0, "SERVO2_MAX": 1520.0}))["SERVO2_TRIM"]
    assert "beyond its range of 1480 to 1520 us" in out
    # No more throttle is given than THR_MAX: the climb is that of 60 %.
    now = {one: proposed(a_result(model, {"THR_MAX": one}))["TECS_CLMB_MAX"]["value"] for one in (60.0, 100.0)}
    craft = load_vehicle("iitb-mav")
    less = SPEED * 0.4 * craft.propulsion.max_thrust / (craft.mass.mass * STANDARD_GRAVITY)
    assert now[100.0] - now[60.0] == pytest.approx(less, rel=0.01)
    wide = tune(a_result(model, {"SERVO1_MIN": 800.0, "SERVO1_MAX": 2200.0}), "ardupilot")["warnings"]
    assert any("servo 1 in the log go beyond the vehicle file's table" in line for line in wide)
    trimmed = {"PWM_MAIN_CENT2": 1500.0, "TRIM_PITCH": 0.2}
    assert "TRIM_PITCH trims it too" in refused(a_result(model, trimmed), "px4")["PWM_MAIN_CENT2"]


def elevons(**changed: Any) -> dict[str, Any]:
    """The result of an aircraft whose servos 1 and 2 move both elevator and aileron."""
    result = a_result(with_values(Cl_0=0.0, Cn_0=0.0))
    controls = result["aircraft"]["file"]["controls"]
    curve = {"pwm": [[1000, 1500, 2000]] * 2, "deflection": [[-0.436, 0.0, 0.436]] * 2}
    controls["elevator"] = {"servo": [1, 2], "mix": [0.5, 0.5], **curve, **changed}
    controls["aileron"] = {"servo": [1, 2], "mix": [-0.5, 0.5], **curve, **changed}
    return result


def test_elevons_get_their_share_whether_or_not_the_log_says_that_they_are() -> None:
    """ArduPilot gives an elevon MIXING_GAIN, 0.5, of a demand: half of the travel that one servo alone would have."""
    alone = proposed(a_result(with_values(Cl_0=0.0, Cn_0=0.0)))["RLL_RATE_FF"]["value"]
    assert proposed(elevons())["RLL_RATE_FF"]["value"] == pytest.approx(2.0 * alone, rel=1e-3)
    said = elevons()
    said["aircraft"]["parameters"] = NOW | {"SERVO1_FUNCTION": 77.0, "SERVO2_FUNCTION": 78.0, "MIXING_GAIN": 0.8}
    assert proposed(said)["RLL_RATE_FF"]["value"] == pytest.approx(alone / 0.8, rel=1e-3)


def test_positions_are_no_pulses() -> None:
    result = a_result(with_values(Cm_q=-6.0))
    result["aircraft"]["file"]["controls"]["elevator"]["signal"] = "position"
    assert "holds positions of the elevator" in refused(result)["PTCH_RATE_FF"]
    assert "SERVO2_TRIM" not in {**proposed(result), **refused(result)}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "is not JSON"),
        ('{"schema": "discrepancy/1"}', "no result of gcs identify"),
        ('{"schema": "identification/1", "model": {}}', "does not hold the aircraft that flew: make it again"),
        (json.dumps(a_result(read_model("iitb-mav")) | {"model": 3}), "make it again with gcs identify"),
        (json.dumps(a_result(read_model("iitb-mav")) | {"state_space": {"airspeed": "x"}}), "make it again"),
        (json.dumps(a_result(read_model("iitb-mav")) | {"sensor_errors": [1]}), "make it again"),
    ],
)
def test_what_is_no_result_is_one_line(tmp_path: Path, content: str, words: str) -> None:
    path = tmp_path / "result.json"
    path.write_text(content)
    found = run("gcs", "tune", path, "--for", "px4")
    assert found.returncode in (1, 2)
    assert found.stdout == ""
    assert words in found.stderr
    assert found.stderr.count("\n") == 1


def test_a_file_of_another_kind_is_not_replaced(tmp_path: Path) -> None:
    path, other = tmp_path / "result.json", tmp_path / "mine.param"
    path.write_text(json.dumps(a_result(read_model("iitb-mav"))))
    other.write_text("RLL_RATE_FF,0.3\n")
    found = run("gcs", "tune", path, "--for", "ardupilot", "-o", other)
    assert found.returncode == 2
    assert "--force" in found.stderr
    assert other.read_text() == "RLL_RATE_FF,0.3\n"
    other.unlink()
    assert run("gcs", "tune", path, "--for", "ardupilot", "-o", other).returncode == 0
    again = run("gcs", "tune", path, "--for", "ardupilot", "-o", other, "--json")
    assert again.returncode == 0, again.stderr  # an older one of its own kind
    assert json.loads(again.stdout)["schema"] == "tuning/1"
