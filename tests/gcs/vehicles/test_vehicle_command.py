"""`gcs vehicle` as a person at a terminal uses it."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from traffic import SECOND, Vehicle, batch

from gcs.cli import main
from gcs.mavlink.dialect import Dialect
from gcs.station.capture import Capture
from sim_vehicle.vehicle.vehicle_file import load_vehicle


def test_a_new_aircraft_from_a_scale_and_a_ruler(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bixler.toml"
    given = ["--mass", "1.05,0.01", "--span", "1.5", "--area", "0.26", "--inertia", "0.04,0.05,0.08"]
    given += ["--control", "elevator=2:1100,1500,1900:-20,0,22", "--control", "throttle=3:1100,1900:0,100"]
    assert main(["vehicle", "new", "-o", str(path), *given]) == 0
    assert "wing loading: 39.6 N/m^2\n" in capsys.readouterr().out
    vehicle = load_vehicle(path)
    assert (vehicle.name, vehicle.mass.mass_std, vehicle.mass.Iyy, vehicle.geometry.c) == (
        "bixler",
        0.01,
        0.05,
        0.173333,
    )
    assert main(["vehicle", "new", "-o", str(path), *given]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["vehicle", "check", str(path)]) == 0
    assert main(["vehicle", "show", str(path), "--json", "-o", str(tmp_path / "sketch.svg")]) == 0
    assert (tmp_path / "sketch.svg").read_text().startswith("<svg")


def test_what_is_left_out_is_asked_for_in_a_terminal(tmp_path: Path) -> None:
    path = tmp_path / "asked.toml"
    ours, theirs = os.openpty()
    with os.fdopen(ours, "r+b", buffering=0) as keyboard:
        command = [sys.executable, "-m", "gcs", "vehicle", "new", "-o", str(path), "--span", "1.2"]
        process = subprocess.Popen(command, stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        os.close(theirs)
        keyboard.write(b"heavy\n0.9,0.01\n0.24\n")
        out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert err.decode().count("Mass, ready to fly, on a scale, kg: ") == 2  # asked again: "heavy" is no number
    assert "give numbers" in err.decode()
    vehicle = load_vehicle(path)
    assert (vehicle.mass.mass, vehicle.mass.mass_std, vehicle.geometry.S) == (0.9, 0.01, 0.24)
    assert "swing the aircraft" in out.decode()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["new", "-o", "x.toml"], "--mass, --span, --area: missing, and there is no terminal to ask in"),
        (["new", "-o", "x.toml", "--mass", "1kg", "--span", "1", "--area", "0.2"], "--mass 1kg: give numbers"),
        (["new", "-o", "x.toml", "--mass", "1", "--span", "1", "--area", "0.2", "--control", "alpha=1:1,2:3,4"],
         "--control alpha=1:1,2:3,4: give NAME=SERVO"),
        (["new", "-o", "x.toml", "--mass", "1", "--span", "1", "--area", "0.2", "--inertia", "1,2"], "Ixx,Iyy,Izz"),
        (["new", "-o", "x.toml", "--mass", "1", "--span", "0", "--area", "0.3"], "--span 0.0: give a positive number"),
        (["new", "-o", "x.toml", "--mass", "1", "--span", "nan", "--area", "0.3"], "--span nan: give finite numbers"),
        (["new", "-o", "x.toml", "--mass", "1", "--span", "1", "--area", "0.3", "--control",
        "elevator=²:1100,1900:-2,2"],
         "give NAME=SERVO"),
        (["estimate", "swing", "--mass", "1"], "swing needs --times"),
        (["estimate", "bifilar", "--mass", "1", "--times", "10", "--length", "1"], "bifilar needs --spacing"),
        (["estimate", "usual", "--mass", "1"], "usual needs --span"),
        (["show", "nothing.toml"], "nothing.toml: no such vehicle file"),
    ],
)  # fmt: skip
def test_wrong_use_is_one_line(
    arguments: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert main(["vehicle", *arguments]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_swings_give_lines_for_the_vehicle_file(capsys: pytest.CaptureFixture[str]) -> None:
    swings = ["--mass", "1.3", "--length", "1.2", "--spacing", "0.5", "--times", "15.9,15.7,15.8", "--axis", "Izz"]
    assert main(["vehicle", "estimate", "bifilar", *swings]) == 0
    assert "Izz = 0.04199\nIzz_std = 0.00051\n" in capsys.readouterr().out
    assert main(["vehicle", "estimate", "usual", "--mass", "1.3", "--span", "1.4", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found) == {"Ixx", "Iyy", "Izz", "Ixz"}
    assert found["Ixz"]["value"] == 0.0 < found["Ixz"]["std"]


def parameter(vehicle: Vehicle, name: str, value: float) -> bytes:
    """A PARAM_VALUE as ArduPilot sends it."""
    return vehicle.frame(mavlink.MAVLink_param_value_message(name.encode(), value, 9, 1, 0))


def test_controls_come_from_the_autopilots_parameters_in_a_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    vehicle = Vehicle()
    settings = {
        "SERVO2_FUNCTION": 19,
        "SERVO2_MIN": 1050,
        "SERVO2_TRIM": 1510,
        "SERVO2_MAX": 1950,
        "SERVO2_REVERSED": 1,
    }
    frames = [vehicle.heartbeat(), *(parameter(vehicle, *one) for one in settings.items()), vehicle.attitude(0.0)]
    log = tmp_path / "flight.mcap"
    capture = Capture(log, Dialect.load())
    capture.take("udpin:test", batch(frames, 1_800_000_000 * SECOND))
    capture.close(1_800_000_001 * SECOND)
    path = tmp_path / "mine.toml"
    given = ["--mass", "1", "--span", "1", "--area", "0.2", "--log", str(log)]
    assert main(["vehicle", "new", "-o", str(path), *given]) == 0
    elevator = load_vehicle(path).controls["elevator"]
    assert elevator.pwm == ((1050.0, 1510.0, 1950.0),)
    assert elevator.deflection_from_pwm(1950.0) > 0.0  # reversed: ArduPilot's demand to pitch up is then the low pulse
    # No parameter says how far it moves: the file marks the guess, and whoever looks at it is told.
    assert elevator.gain_std == 0.3
    assert "gain_std = 0.3 # the travel is guessed: measure it" in path.read_text()
    capsys.readouterr()
    assert main(["vehicle", "check", str(path)]) == 0
    assert (
        "warning: travel of elevator is guessed (gain_std = 0.3), and their derivatives are known to 30 %; measure"
        in (capsys.readouterr().out)
    )
