"""What an autopilot's parameters say of its aircraft fills what the vehicle file leaves out, and nothing else."""

from __future__ import annotations

import json
import re
import shutil
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dataflash import BOOT_US
from dataflash import a_log as a_dataflash_log
from field_flight import Plan, fly_plan, textbook
from field_plant import Air, Hold, Servo
from field_wire import BOOT, START, write_flight
from processes import run
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy.signal import butter, group_delay
from ulog_writer import a_log as a_px4_log

import sim_vehicle
from gcs.cli import main
from gcs.flights.autopilot_settings import USUAL_TRAVEL, filled, flown
from gcs.flights.signals import extract
from gcs.formats.conversion import import_file
from gcs.recording.reader import Recording
from sim_vehicle.vehicle.controls import servo_pwm
from sim_vehicle.vehicle.strict_toml import Known
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle

pytestmark = pytest.mark.whole_flight

PLANE = {
    f"SERVO{n}_{key}": value
    for n, function, turned in ((1, 4, 1), (2, 19, 1), (3, 70, 0), (4, 21, 1))
    for key, value in (("FUNCTION", function), ("MIN", 1000), ("TRIM", 1500), ("MAX", 2000), ("REVERSED", turned))
}


def bare() -> Vehicle:
    """A vehicle whose file says nothing of its controls."""
    return replace(load_vehicle("ultrastick25e"), controls={}, warnings=())


def test_servos_of_arduplane_become_controls_with_an_assumed_travel_that_is_said() -> None:
    craft = filled(bare(), PLANE)
    assert set(craft.controls) == {"elevator", "aileron", "rudder", "throttle"}
    elevator = craft.controls["elevator"]
    assert elevator.servos == (2,)
    assert elevator.deflection_from_pwm(2000.0) == pytest.approx(USUAL_TRAVEL)
    assert elevator.gain_std == 0.3
    assert craft.controls["throttle"].deflection_from_pwm(1250.0) == pytest.approx(0.25)
    assert any("[controls.elevator] is not given: servo 2 (1000 to 2000 us)" in line for line in craft.warnings)
    (told,) = (line for line in craft.warnings if line.startswith("travel of "))
    assert told == (
        "travel of elevator, aileron, rudder is not in the log: 25 deg is taken, down and left positive, and their"
        " derivatives are known to 30 %; measure it and write it to [controls]"
    )


def test_flaperons_are_one_aileron_and_two_motors_one_throttle_each_by_its_own_pulses() -> None:
    """ArduPilot's flaperons (24, 25) get the ailerons' demand; its left and right motors (73, 74) the throttle's."""
    craft = filled(
        bare(), PLANE | {"SERVO1_FUNCTION": 24, "SERVO5_FUNCTION": 25, "SERVO3_FUNCTION": 73, "SERVO6_FUNCTION": 74}
    )
    aileron, throttle = craft.controls["aileron"], craft.controls["throttle"]
    assert (aileron.servos, throttle.servos) == ((1, 5), (3, 6))
    # Servo 1 is reversed, servo 5 is not, with the travel that is usual: both down by half of it is no roll.
    assert aileron.deflection_from_pwm(1750.0, 1700.0) == pytest.approx(0.0, abs=1e-9)
    assert aileron.deflection_from_pwm(2000.0, 1100.0) == pytest.approx(USUAL_TRAVEL)
    # Told apart, motors are half of the throttle each.
    assert throttle.deflection_from_pwm(1000.0, 1900.0) == pytest.approx(0.5)


def test_px4_s_outputs_are_those_of_their_port() -> None:
    craft = filled(bare(), {
        "PWM_MAIN_FUNC1": 101, "PWM_AUX_FUNC1": 201, "PWM_AUX_FUNC2": 202, "CA_SV_CS0_TYPE": 15, "CA_SV_CS1_TYPE": 3,
        "PWM_AUX_REV": 2, "PWM_AUX_MIN1": 1100, "PWM_AUX_MAX1": 1900, "PWM_AUX_CENT1": 1400,
    })  # fmt: skip
    assert {name: one.servos for name, one in craft.controls.items()} == {
        "throttle": (1,), "aileron": (17,), "elevator": (18,),
    }  # fmt: skip
    assert craft.controls["aileron"].pwm == ((1100.0, 1400.0, 1900.0),)
    # Turned by the second bit of the port's own mask: longer pulses are a demand to pitch down.
    assert craft.controls["elevator"].deflection_from_pwm(2000.0) == pytest.approx(USUAL_TRAVEL)
    assert any(
        line.startswith("[controls.aileron] is not given: servo AUX 1 (1100 to 1900 us)") for line in craft.warnings
    )


def test_a_control_on_the_second_port_is_recorded_and_read_as_on_the_first(tmp_path: Path) -> None:
    """The simulator's telemetry has a message for each port, as boards do; nothing else of the flight changes."""
    shutil.copytree(Path(sim_vehicle.__file__).parent / "vehicles", tmp_path / "vehicles")
    craft = tmp_path / "vehicles" / "iitb-mav.toml"
    text = craft.read_text(encoding="utf-8")
    assert "servo = 2\n" in text
    craft.write_text(text.replace("servo = 2\n", 'servo = 2\nport = "AUX"\n'), encoding="utf-8")
    found = {}
    for name, vehicle in (("main", "iitb-mav"), ("aux", str(craft))):
        flown = run("sim-vehicle", "fly", "--vehicle", vehicle, "--model", "iitb-mav", "--seed", 4, "--manoeuvre",
                    "elevator-3211", "--duration", 4, "--record", tmp_path / f"{name}.mcap")  # fmt: skip
        assert flown.returncode == 0, flown.stderr
        found[name] = extract(Recording(tmp_path / f"{name}.mcap"), load_vehicle(vehicle)).signals
    assert np.ptp(found["main"]["de"].values) > 0.02
    np.testing.assert_array_equal(found["aux"]["de"].values, found["main"]["de"].values)
    assert "servo18" in found["aux"]
    assert "servo18" not in found["main"]
    assert not np.any(found["aux"]["servo2"].values > 0.0) if "servo2" in found["aux"] else True


def test_what_moves_and_is_no_control_is_named() -> None:
    craft = filled(bare(), PLANE | {"SERVO5_FUNCTION": 16, "SERVO6_FUNCTION": 33})
    told = [line for line in craft.warnings if "which is no control of the model" in line]
    assert [line.split(",")[0] for line in told] == [
        "servo 5 is a differential spoiler by the log's parameters (SERVO5_FUNCTION = 16)",
        "servo 6 is motor 1 by the log's parameters (SERVO6_FUNCTION = 33)",
    ]


def test_a_flap_is_a_control_of_its_own() -> None:
    """A share of its travel, so that none has to be guessed."""
    own = {"SERVO6_FUNCTION": 3, "SERVO6_MIN": 1000.0, "SERVO6_MAX": 2000.0, "SERVO6_REVERSED": 1.0}
    craft = filled(bare(), PLANE | own)
    assert craft.named_controls == ("flap",)
    assert [float(craft.controls["flap"].deflection_from_pwm(us)) for us in (2000.0, 1250.0)] == [0.0, 0.75]
    assert "flap" not in " ".join(line for line in craft.warnings if "is not in the log" in line)


def test_what_the_file_gives_stays() -> None:
    plane = load_vehicle("ultrastick25e")
    assert filled(plane, PLANE).controls == plane.controls


@pytest.mark.parametrize(
    "parameters",
    [
        {"SERVO1_FUNCTION": 77, "SERVO2_FUNCTION": 78},
        {"PWM_MAIN_FUNC1": 201, "PWM_MAIN_FUNC2": 202, "CA_SV_CS0_TYPE": 5, "CA_SV_CS1_TYPE": 6},
    ],
)
def test_elevons_pitch_together_and_roll_apart(parameters: dict[str, float]) -> None:
    controls = filled(bare(), parameters).controls
    assert set(controls) == {"elevator", "aileron"}
    # A demand to pitch up is a negative elevator: both servos go the same way.
    up = servo_pwm(controls, {"elevator": -0.2})
    assert up[1] == pytest.approx(up[2])
    assert up[1] > 1500.0
    right = servo_pwm(controls, {"aileron": -0.2})
    assert right[1] < 1500.0 < right[2]


def test_servos_that_make_no_sense_are_left_out() -> None:
    assert set(filled(bare(), PLANE | {"SERVO2_MIN": 2000.0}).controls) == {"aileron", "rudder", "throttle"}
    # One half of a pair of elevons does not tell pitch from roll.
    lone = filled(bare(), {"SERVO1_FUNCTION": 77})
    assert lone.controls == {}
    assert any("cannot be distinguished" in line for line in lone.warnings)
    assert filled(bare(), {}) == bare()


def test_px4_reverses_by_a_mask_and_places_its_sensors() -> None:
    parameters = {
        "PWM_MAIN_FUNC2": 201, "CA_SV_CS0_TYPE": 3, "PWM_MAIN_MIN2": 1100, "PWM_MAIN_MAX2": 1900, "PWM_MAIN_REV": 2,
        "PWM_MAIN_FUNC3": 202, "CA_SV_CS1_TYPE": 15, "EKF2_IMU_POS_X": 0.05, "EKF2_IMU_POS_Z": -0.01,
    }  # fmt: skip
    plain = replace(bare(), sensors=replace(bare().sensors, accelerometer=Vehicle.unknown().sensors.accelerometer))
    craft = filled(plain, parameters)
    assert craft.controls["elevator"].deflection_from_pwm(1900.0) == pytest.approx(USUAL_TRAVEL)
    assert craft.controls["aileron"].servos == (3,)
    assert craft.controls["aileron"].deflection_from_pwm(2000.0) == pytest.approx(-USUAL_TRAVEL)
    assert craft.sensors.accelerometer.position == (0.05, 0.0, -0.01)
    assert any("position is not given" in line for line in craft.warnings)


def test_the_low_pass_of_the_gyros_is_known_to_come_late_where_the_file_says_nothing_of_it() -> None:
    craft = filled(bare(), {"INS_GYRO_FILTER": 20.0}, ("RAW_IMU", "ATTITUDE", "SERVO_OUTPUT_RAW"))
    # The phase of the filter that ArduPilot runs, by another implementation, at 1 Hz of 1000 Hz.
    numerator, denominator = butter(2, 20.0, fs=1000.0)
    _, delay_samples = group_delay((numerator, denominator), [1.0], fs=1000.0)
    assert set(craft.timing) == {"RAW_IMU"}
    assert craft.timing["RAW_IMU"].value == pytest.approx(1e-3 * float(delay_samples[0]), rel=0.02)
    assert any("11.3 ms late by the log's parameters" in line for line in craft.warnings)
    stated = replace(bare(), timing={"RAW_IMU": Known(0.004, 0.001)})
    assert filled(stated, {"INS_GYRO_FILTER": 20.0}, ("RAW_IMU",)) == stated
    assert filled(bare(), {"INS_GYRO_FILTER": 0.0}, ("RAW_IMU",)) == bare()


@pytest.mark.parametrize(("at_s", "turned", "told"), [(4.5, True, False), (3.0, True, True), (1.0, False, True)])
@pytest.mark.parametrize("kind", ["BIN", "ulg"])
def test_a_parameter_counts_from_when_it_was_set(
    tmp_path: Path, kind: str, at_s: float, turned: bool, told: bool
) -> None:
    if kind == "BIN":
        plane = a_dataflash_log()
        first = plane.message("MODE", BOOT_US, 5, 5, 0)
        given = b"".join(plane.message("PARM", BOOT_US, name, float(value)) for name, value in PLANE.items())
        plane.data = plane.data.replace(first, first + given)
        plane.add("PARM", BOOT_US + round(1e6 * at_s), "SERVO2_REVERSED", 0.0)
        data, name = plane.data, "SERVO2_REVERSED changed from 1 to 0"
    else:
        wing = a_px4_log()
        for name, number in (("PWM_MAIN_FUNC2", 201), ("CA_SV_CS0_TYPE", 3), ("PWM_MAIN_REV", 2)):
            wing.parameter(name, number)
        wing.change("PWM_MAIN_REV", 0, round(1e6 * at_s))
        data, name = wing.bytes(), "PWM_MAIN_REV changed from 2 to 0"
    (tmp_path / f"a.{kind}").write_bytes(data)
    import_file(tmp_path / f"a.{kind}", tmp_path / "a.mcap")
    recording = Recording(tmp_path / "a.mcap")
    system = 7 if kind == "BIN" else 9
    craft = flown(bare(), recording, system)
    assert craft is not None
    assert (craft.controls["elevator"].deflection_from_pwm(1900.0) > 0.0) == turned
    assert [line.startswith(name) for line in craft.warnings if " changed from " in line] == [True] * told
    # A part by itself has no change, and its own value.
    part = flown(bare(), recording, system, stop_s=0.5)
    assert part is not None
    assert part.controls["elevator"].deflection_from_pwm(1900.0) > 0.0
    assert not any(" changed from " in line for line in part.warnings)


def test_a_log_with_parameters_needs_no_controls_in_the_vehicle_file(tmp_path: Path) -> None:
    plan = Plan("multisine", 25.0, Servo(), Air(), Hold(hz=50.0), textbook(), 0.0)
    write_flight(fly_plan(plan, 2, tmp_path, "wired"), tmp_path / "wired")
    log = bytearray()
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    for place, (name, value) in enumerate(PLANE.items()):
        message = mavlink.MAVLink_param_value_message(name.encode(), float(value), 9, len(PLANE), place)
        log += struct.pack(">Q", round((START + BOOT) * 1e6)) + message.pack(link)
    with (tmp_path / "wired.tlog").open("ab") as file:
        file.write(log)
    text = (tmp_path / "wired.toml").read_text(encoding="utf-8")
    short = re.sub(r"\[controls\.\w+\]\n(?:(?!\[).*\n)*", "", text)
    assert "controls" not in short
    (tmp_path / "short.toml").write_text(short, encoding="utf-8")
    found = {}
    for name in ("wired", "short"):
        command = ["identify", str(tmp_path / "wired.tlog"), "--vehicle", str(tmp_path / f"{name}.toml")]
        assert main([*command, "--method", "map", "-o", str(tmp_path / f"{name}.json")]) == 0
        found[name] = json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8"))
    for name in ("Cm_alpha", "Cl_p", "Cn_beta"):
        given, assumed = (one["model"]["coefficients"][name]["value"] for one in found.values())
        assert assumed == pytest.approx(given, rel=0.02), name
    # What hangs on the travel is known no better than that is, and given.
    for name, source in (("Cm_de", "elevator_gain_std"), ("Cl_da", "aileron_gain_std")):
        entry = found["short"]["model"]["coefficients"][name]
        assert entry["std"] == pytest.approx(0.3 * abs(entry["value"]), rel=0.1)
        assert abs(entry["systematic"][source]) == pytest.approx(0.3 * abs(entry["value"]), rel=0.1)
    assert any("[controls.aileron] is not given" in line for line in found["short"]["warnings"])
    assert np.isfinite(found["wired"]["model"]["coefficients"]["Cm_de"]["value"])
