"""Telemetry logs that pymavlink wrote, from a simulation that shares nothing with ours, through the command line."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import other_aircraft
import pytest
from other_aircraft import BIASES, TRUTH, VEHICLE, Row, write_tlog
from own_bars import own_bar
from pymavlink import mavutil

from gcs.cli import main

# IMU message, seconds the vehicle had been up when the log begins: a clock that starts at 0, and one that does not.
SETS = {"HIGHRES_IMU": 0.0, "RAW_IMU": 700.0}


@pytest.fixture(scope="module")
def rows() -> Sequence[Row]:
    return other_aircraft.fly(seed=1)


@pytest.fixture(scope="module")
def folder(rows: Sequence[Row], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both logs and the vehicle file."""
    folder = tmp_path_factory.mktemp("heron")
    (folder / "heron.toml").write_text(VEHICLE, encoding="utf-8")
    for kind, boot_s in SETS.items():
        write_tlog(folder / f"{kind}.tlog", rows, kind, boot_s)
    return folder


def no_constant(text: str) -> NoReturn:
    raise AssertionError(f"{text} is no JSON")


def identify(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, dict[str, Any], str]:
    """Exit code, result (empty if there is none) and what was said besides progress."""
    code = main(["identify", *map(str, arguments), "--json"])
    out, error = capsys.readouterr()
    said = "".join(line for line in error.splitlines(keepends=True) if "%" not in line[:6])
    return code, json.loads(out, parse_constant=no_constant) if out else {}, said


def assert_is_identification(result: dict[str, Any]) -> None:
    """Every key of the schema, with its type."""
    assert result["schema"] == "identification/1"
    kinds = {"flights": list, "sensor_errors": dict, "compatibility": dict, "model": dict, "refused": list,
             "segments": list, "warnings": list}  # fmt: skip
    assert {name: type(result[name]) for name in kinds} == kinds
    assert "validation" in result
    for entry in result["sensor_errors"].values():
        assert entry.keys() >= {"value", "std", "unit"}
    compatibility = result["compatibility"]
    assert compatibility["compatible"] is True
    assert {"before", "after"} <= compatibility.keys()
    for fit in compatibility["after"].values():
        assert fit.keys() >= {"rms", "tic"}
    assert result["model"]["schema"] == "model/1"
    assert result["model"]["validity"].keys() >= {"alpha", "airspeed"}
    for refusal in result["refused"]:
        assert refusal.keys() >= {"name", "reason", "manoeuvre"}
    for segment in result["segments"]:
        assert segment.keys() >= {"flight", "start", "end"}


@pytest.mark.parametrize("kind", SETS)
def test_a_foreign_log_gives_the_aircraft_that_flew(
    kind: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Nothing hangs on its thrust sensor.
    weighed = folder / "weighed.toml"
    weighed.write_text(f"{VEHICLE}[propulsion]\nmax_thrust = 20.0\nmoving_mass = 0.0\n", encoding="utf-8")
    code, result, said = identify(capsys, folder / f"{kind}.tlog", "--vehicle", weighed)
    assert (code, said) == (0, "")
    assert_is_identification(result)
    assert result["flights"] == [kind]
    assert result["warnings"] == []
    found = result["model"]["coefficients"]
    for name in TRUTH:
        limit = max(4.0 * own_bar(found[name]), 0.03 * abs(TRUTH[name]))
        assert found[name]["value"] == pytest.approx(TRUTH[name], abs=limit), name
        assert found[name]["value"] == pytest.approx(TRUTH[name], rel=0.1), name  # however wide its own error is
    for name, value in BIASES.items():
        error = result["sensor_errors"][name]
        assert error["value"] == pytest.approx(value, abs=4.0 * error["std"]), name


def test_pymavlink_reads_the_log_as_well(folder: Path, rows: Sequence[Row]) -> None:
    """The log is one: another reader finds the same messages in it."""
    log = mavutil.mavlink_connection(str(folder / "RAW_IMU.tlog"))
    seen: dict[str, int] = {}
    while (message := log.recv_match()) is not None:
        seen[message.get_type()] = seen.get(message.get_type(), 0) + 1
    log.close()
    assert seen.pop("HEARTBEAT") == math.ceil(other_aircraft.DURATION_S)
    wanted = ("RAW_IMU", "SCALED_PRESSURE", "ATTITUDE", "AOA_SSA", "VFR_HUD", "NAMED_VALUE_FLOAT", "SERVO_OUTPUT_RAW")
    assert seen == dict.fromkeys(wanted, len(rows))


def test_a_log_cut_off_anywhere_gives_what_is_in_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = (folder / "HIGHRES_IMU.tlog").read_bytes()
    cut = folder / "cut.tlog"
    cut.write_bytes(whole[: len(whole) * 2 // 3 - 7])
    code, result, _ = identify(capsys, cut, "--vehicle", folder / "heron.toml")
    assert code == 0
    assert result["segments"][-1]["end"] < 25.0
    assert result["model"]["coefficients"]["Cm_alpha"]["value"] == pytest.approx(TRUTH["Cm_alpha"], rel=0.03)


@pytest.mark.parametrize(
    ("without", "words"),
    [
        ("VFR_HUD", "no signal airspeed"),
        ("ATTITUDE", "no signal phi, theta"),
        ("SERVO_OUTPUT_RAW", "no control surface is known"),
        ("HEARTBEAT", "no vehicle's HEARTBEAT"),
    ],
)
def test_what_is_missing_is_named_in_one_line(
    without: str, words: str, folder: Path, rows: Sequence[Row], capsys: pytest.CaptureFixture[str]
) -> None:
    log = folder / f"without_{without}.tlog"
    write_tlog(log, rows[:600], "HIGHRES_IMU", 0.0, lambda message: message.get_type() != without)
    code, result, said = identify(capsys, log, "--vehicle", folder / "heron.toml")
    assert (code, result) == (1, {})
    assert said.startswith(f"gcs identify: without_{without}: ")
    assert words in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("content", [b"", b"\xfd\x09\x00", b"no telemetry\n" * 900, bytes(range(256)) * 300])
def test_garbage_is_refused_in_one_line(content: bytes, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = folder / "garbage.tlog"
    log.write_bytes(content)
    code, result, said = identify(capsys, log, "--vehicle", folder / "heron.toml")
    assert (code, result) == (1, {})
    assert "garbage.tlog holds no MAVLink frame" in said
    assert said.count("\n") == 1


def test_a_log_that_ends_before_anything_moves_is_refused_in_one_line(
    folder: Path, rows: Sequence[Row], capsys: pytest.CaptureFixture[str]
) -> None:
    log = folder / "short.tlog"
    write_tlog(log, rows[:100], "HIGHRES_IMU", 0.0)
    code, _, said = identify(capsys, log, "--vehicle", folder / "heron.toml")
    assert code == 1
    assert "airborne from 0.0 to 2.0 s, but no surface moved" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('kind = "true"', 'kind = "knots"', "sensors.airspeed.kind is 'knots'"),
        ("mass = 4.5", "mass = 0", "mass.mass"),
        ("mass = 4.5", 'mass = "4.5 kg"', "mass.mass"),
        ("mass = 4.5", "mass = 4.5\nweight = 44.1", "mass.weight"),
        ("servo = 4\n", "servo = 4\npwm_unit = 1\n", "controls.rudder.pwm_unit"),
    ],
)
def test_a_wrong_vehicle_file_is_exit_code_2_and_names_the_key(
    old: str, new: str, words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = folder / "wrong.toml"
    file.write_text(VEHICLE.replace(old, new), encoding="utf-8")
    code, result, said = identify(capsys, folder / "RAW_IMU.tlog", "--vehicle", file)
    assert (code, result) == (2, {})
    assert words in said
    assert said.count("\n") == 1


def test_doubtful_units_are_told(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = folder / "degrees.toml"
    file.write_text(VEHICLE.replace("[0.35, 0.0, -0.35]", "[20.0, 0.0, -20.0]"), encoding="utf-8")
    code, result, _ = identify(capsys, folder / "RAW_IMU.tlog", "--vehicle", file, "--method", "ee")
    assert code == 0
    (line,) = [text for text in result["warnings"] if "controls.elevator.deflection" in text]
    assert "degrees" in line


def test_what_was_noticed_before_a_failure_is_shown_with_it(
    folder: Path, rows: Sequence[Row], capsys: pytest.CaptureFixture[str]
) -> None:
    mute = folder / "silent.tlog"
    write_tlog(mute, rows[:600], "HIGHRES_IMU", 0.0, lambda message: message.get_type() != "SERVO_OUTPUT_RAW")
    code, result, said = identify(capsys, mute, "--vehicle", folder / "heron.toml")
    assert (code, result) == (1, {})
    assert said.startswith("gcs identify: silent: no control surface is known")
    assert "(noticed before: de: the recording has no servo3" in said
    assert said.count("\n") == 1


def test_check_says_what_a_log_is_worth_and_what_to_do_better(
    folder: Path, rows: Sequence[Row], capsys: pytest.CaptureFixture[str]
) -> None:
    vehicle = ["--vehicle", str(folder / "heron.toml")]
    assert main(["check", str(folder / "HIGHRES_IMU.tlog"), *vehicle, "--json"]) == 0
    found = json.loads(capsys.readouterr().out, parse_constant=no_constant)
    assert found["schema"] == "check/1"
    assert found["quality"]["verdict"] in ("good", "care")
    assert found["quality"]["axes"].keys() == {"CL", "CD", "Cm", "CY", "Cl", "Cn"}
    assert found["senders"]["HIGHRES_IMU"]["type"] == "fixed wing"
    assert found["rates"]["HIGHRES_IMU"]["q"] == pytest.approx(50.0, abs=0.1)
    told = found["expected"]["Cm_alpha"]
    assert abs(told["value"] - TRUTH["Cm_alpha"]) < 4.0 * own_bar(told)

    mute = folder / "mute.tlog"
    write_tlog(mute, rows[:600], "HIGHRES_IMU", 0.0, lambda message: message.get_type() != "VFR_HUD")
    assert main(["check", str(mute), *vehicle]) == 1
    said = capsys.readouterr().out
    assert said.startswith("quality: too poor, because\n  mute: no signal airspeed: have the vehicle send or log it")

    assert main(["info", str(mute), *vehicle]) == 0
    assert capsys.readouterr().out.startswith("quality: too poor, because\n  mute: no signal airspeed")
    assert main(["info", str(folder / "HIGHRES_IMU.tlog"), *vehicle, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["quality"] == found["quality"]

    assert main(["check", str(mute), *vehicle, "--as-recorded", "qq"]) == 1
    out, error = capsys.readouterr()
    assert out == ""
    assert "as recorded: qq is no signal" in error
    # What was asked wrongly has nothing to do with what the log lacks.
    code, _, said = identify(capsys, mute, *vehicle, "--as-recorded", "qq")
    assert code == 1
    assert said.startswith("gcs identify: as recorded: qq is no signal")
    assert "noticed before" not in said


def test_the_log_of_something_without_wings_is_one_line_with_its_type(
    folder: Path, rows: Sequence[Row], capsys: pytest.CaptureFixture[str]
) -> None:
    log = folder / "copter.tlog"

    def as_quadrotor(message: Any) -> bool:
        if message.get_type() == "HEARTBEAT":
            message.type = mavutil.mavlink.MAV_TYPE_QUADROTOR
        return True

    write_tlog(log, rows[:600], "HIGHRES_IMU", 0.0, as_quadrotor)
    code, result, said = identify(capsys, log, "--vehicle", folder / "heron.toml")
    assert (code, result) == (1, {})
    assert "copter: the log of a quadrotor" in said
    assert said.count("\n") == 1
    assert main(["info", str(log)]) == 0
    assert "system 7: quadrotor" in capsys.readouterr().out


def test_without_any_thrust_all_but_drag_is_told(
    folder: Path, rows: Sequence[Row], capsys: pytest.CaptureFixture[str]
) -> None:
    log = folder / "no_thrust.tlog"
    write_tlog(log, rows, "HIGHRES_IMU", 0.0, lambda message: message.get_type() != "NAMED_VALUE_FLOAT")
    code, result, _ = identify(capsys, log, "--vehicle", folder / "heron.toml")
    assert (code, result["method"], result["thrust"]) == (0, "map", {"no_thrust": "unknown"})
    found = result["model"]["coefficients"]
    for name in TRUTH:
        if name.startswith("CD"):
            assert "drag needs thrust" in found[name]["refused"]
        else:
            limit = max(4.0 * own_bar(found[name]), 0.15 * abs(TRUTH[name]))
            assert found[name]["value"] == pytest.approx(TRUTH[name], abs=limit), name
    assert not any(one["name"] == "ax_zero" for one in result["nuisances"])
    assert any("thrust is unknown" in reason for reason in result["quality"]["reasons"])
    code, result, said = identify(capsys, log, "--vehicle", folder / "heron.toml", "--method", "oe")
    assert (code, result) == (1, {})
    assert "thrust is unknown: the flight has neither" in said


def test_a_log_too_slow_for_any_number_is_written_with_its_refusals(
    folder: Path, rows: Sequence[Row], capsys: pytest.CaptureFixture[str]
) -> None:
    log, model = folder / "slow.tlog", folder / "slow.model.json"
    every = round(1.0 / (4.0 * (other_aircraft.DURATION_S / len(rows))))
    write_tlog(log, rows[::every], "HIGHRES_IMU", 0.0)
    code, result, said = identify(capsys, log, "--vehicle", folder / "heron.toml", "--write-model", model)
    reason = "gyros and accelerometers come at 4 Hz; have them sent at 50 Hz or more"
    assert (code, said) == (1, f"gcs identify: no coefficient could be identified: {reason}\n")
    assert {name: one["refused"] for name, one in result["model"]["coefficients"].items()} == dict.fromkeys(
        result["model"]["coefficients"], reason
    )
    assert json.loads(model.read_text(encoding="utf-8")) == result["model"]
