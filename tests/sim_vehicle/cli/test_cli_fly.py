"""The command `sim-vehicle fly` as a user runs it."""

import json
import socket
import threading
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.cli.main import main


def messages(path: Path) -> list[mavlink.MAVLink_message]:
    """Frames of a .tlog by pymavlink's parser, which here skips the 8 bytes of time before each."""
    data, at, found = path.read_bytes(), 0, []
    parser = mavlink.MAVLink(None)
    while at < len(data):
        length = 12 + data[at + 9]
        found += parser.parse_buffer(data[at + 8 : at + 8 + length]) or []
        at += 8 + length
    return found


def test_records_a_tlog_with_its_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, truth = tmp_path / "flight.tlog", tmp_path / "truth.json"
    assert main(["fly", "--manoeuvre", "elevator-3211", "--record", str(path), "--truth", str(truth)]) == 0
    imu = [message for message in messages(path) if message.get_type() == "HIGHRES_IMU"]
    assert len(imu) == 601
    told = json.loads(truth.read_text())
    assert told["sensor_errors"]["accel_bias_x"] == pytest.approx(0.1962)
    measured = np.array([message.xacc for message in imu])
    true = np.array(told["truth"]["ax"])
    # 0.02 g of bias; the mean of 601 samples of 0.008 g noise is known to 0.0032 m/s^2.
    assert np.mean(measured - true) == pytest.approx(0.1962, abs=0.013)
    assert "12.0 s flown" in capsys.readouterr().err


def test_same_seed_same_readings(tmp_path: Path) -> None:
    readings = []
    for name, seed in (("a", "4"), ("b", "4"), ("c", "5")):
        path = tmp_path / f"{name}.tlog"
        assert main(["fly", "--duration", "3", "--seed", seed, "--record", str(path)]) == 0
        readings.append([m.zacc for m in messages(path) if m.get_type() == "HIGHRES_IMU"])
    assert readings[0] == readings[1]
    assert readings[0] != readings[2]


def test_settings_reach_model_manoeuvre_sensors_and_flight(tmp_path: Path) -> None:
    truth = tmp_path / "truth.json"
    arguments = [
        "fly",
        "--record",
        str(tmp_path / "f.tlog"),
        "--truth",
        str(truth),
        "--noise",
        "none",
        "--duration",
        "3",
    ]
    settings = ["CD_0=0.05", "manoeuvre.amplitude=0.01", "sensors.accel_bias_x=0.3", "flight.airspeed=17"]
    for setting in settings:
        arguments += ["--set", setting]
    assert main([*arguments, "--wind", "2,0,0"]) == 0
    told = json.loads(truth.read_text())
    assert told["truth"]["V"][0] == pytest.approx(17.0)
    assert told["truth"]["CD"][0] == pytest.approx(0.05 + 0.4 * told["truth"]["CL"][0] ** 2)
    assert np.ptp(told["truth"]["de"]) == pytest.approx(0.01, abs=0.0009)
    assert told["sensor_errors"]["accel_bias_x"] == 0.3
    assert told["truth"]["vn"][0] == pytest.approx(17.0 + 2.0, abs=0.1)


def test_plan_file(tmp_path: Path) -> None:
    plan = tmp_path / "plan.json"
    entry = {"manoeuvre": "elevator-doublet", "duration": 4.0, "width": 0.4, "amplitude": 0.03}
    plan.write_text(json.dumps({"schema": "plan/1", "segments": [entry]}))
    truth = tmp_path / "truth.json"
    assert main(["fly", "--plan", str(plan), "--record", str(tmp_path / "f.tlog"), "--truth", str(truth)]) == 0
    told = json.loads(truth.read_text())
    assert told["time_s"][-1] == pytest.approx(4.0)
    elevator = np.array(told["command"])[:, 0]
    assert elevator[60] - elevator[40] == pytest.approx(0.03, abs=0.001)


def test_streams_over_udp_at_several_times_real_time() -> None:
    kinds: list[str] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        station.bind(("127.0.0.1", 0))
        url = f"udpout:127.0.0.1:{station.getsockname()[1]}"
        result: list[int] = []
        arguments = ["fly", "--duration", "2", "--speed", "10", "--out", url]
        vehicle = threading.Thread(target=lambda: result.append(main(arguments)))
        vehicle.start()
        vehicle.join(60.0)
        station.setblocking(False)
        parser = mavlink.MAVLink(None)
        while len(kinds) < 860:
            try:
                datagram = station.recv(2048)
            except BlockingIOError:
                break
            kinds += [message.get_type() for message in parser.parse_buffer(datagram) or []]
    assert result == [0]
    assert kinds.count("HIGHRES_IMU") == 101
    assert "BAD_DATA" not in kinds


def refused_model(tmp_path: Path) -> str:
    path = tmp_path / "model.json"
    coefficients = {"CL_0": {"value": 0.2}, "Cl_r": {"refused": "no yaw rate in the flight"}}
    path.write_text(json.dumps({"schema": "model/1", "name": "m", "coefficients": coefficients}))
    return str(path)


def test_a_refused_coefficient_is_named_and_a_value_demanded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fly", "--model", refused_model(tmp_path), "--record", str(tmp_path / "f.tlog")]) == 1
    error = capsys.readouterr().err
    assert "Cl_r" in error
    assert "--set Cl_r=VALUE" in error
    assert error.count("\n") == 1


WRONG_USE = [
    ([], "required"),
    (["--record", "f.tlog", "--out", "udpout:127.0.0.1:1"], "not allowed with"),
    (["--record", "f.tlog", "--manoeuvre", "loop"], "no manoeuvre 'loop'"),
    (["--record", "f.tlog", "--effect", "magic"], "unknown effect 'magic'"),
    (["--record", "f.tlog", "--effect", "vane_lag:tau=fast"], "is not KEY=NUMBER"),
    (["--record", "f.tlog", "--set", "CL_alpha"], "give NAME=NUMBER"),
    (["--record", "f.tlog", "--set", "CL_alpha=nan"], "give NAME=NUMBER"),
    (["--record", "f.tlog", "--set", "CL_beauty=1"], "CL_beauty"),
    (["--record", "f.tlog", "--set", "weather.wind=1"], "manoeuvre.NAME"),
    (["--record", "f.tlog", "--set", "manoeuvre.colour=1"], "no setting 'colour'"),
    (["--record", "f.tlog", "--set", "manoeuvre.width=-1"], "above 0"),
    (["--record", "f.tlog", "--set", "sensors.colour=1"], "no sensor error"),
    (["--record", "f.tlog", "--set", "flight.colour=1"], "airspeed, altitude"),
    (["--record", "f.tlog", "--wind", "1,2"], "three numbers"),
    (["--record", "f.tlog", "--duration", "0"], "above 0"),
    (["--record", "f.tlog", "--plan", "p.json", "--manoeuvre", "cruise"], "not both"),
    (["--out", "udpout:127.0.0.1:1", "--speed", "0"], "from 0.01 to 1000"),
    (["--out", "pigeon"], "no such link"),
    (["--record", "f.tlog", "--vehicle", "no-such-vehicle"], "no such vehicle file"),
    (["--record", "f.tlog", "--fault", "loss=2"], "--fault loss=2: give loss=a share of frames, from 0 to 1"),
    (["--record", "f.tlog", "--fault", "rain=1"], "no such fault"),
    (["--record", "f.tlog", "--system", "0"], "--system is 0"),
    (["--record", "f.tlog", "--system", "251"], "from 1 to 250"),
    (["--record", "f.tlog", "--system", "249", "--vehicles", "3"], "from 1 to 2"),
    (["--record", "f.tlog", "--vehicles", "0"], "--vehicles is 0"),
    (["--record", "f.tlog", "--vehicles", "1000"], "from 1 to 20"),
    (["--record", "f.tlog", "--taxi", "--wait-arm"], "give --taxi and --out"),
    (["--out", "udpout:127.0.0.1:1", "--wait-arm"], "give --taxi and --out"),
    (["--record", "f.tlog", "--mavlink1", "--signing-key", "key"], "leave out --signing-key"),
    (["--record", "f.tlog", "--duration", "1e12"], "14400 s at most"),
    (["--record", "f.tlog", "--duration", "inf"], "14400 s at most"),
    (["--record", "f.tlog", "--duration", "nan"], "above 0"),
    (["--record", "f.tlog", "--wind", "1e6,0,0"], "from -100 to 100"),
    (["--record", "f.tlog", "--set", "CL_alpha=1e30"], "from -1000 to 1000"),
    (["--record", "f.tlog", "--set", "flight.airspeed=-5"], "from 1 to 300"),
    (["--record", "f.tlog", "--set", "flight.altitude=1e9"], "from -400 to 10000"),
    (["--record", "f.tlog", "--set", "sensors.accel_bias_x=1e9"], "from -100000 to 100000"),
    (["--record", "f.tlog", "--set", "sensors.airspeed.noise=-1"], "from 0 to"),
    (["--record", "f.tlog", "--seed", "-1"], "from 0"),
    (["--record", "f.tlog", "--set", "manoeuvre.duration=1e12"], "it may be 14400 at most"),
    (["--record", "f.tlog", "--manoeuvre", "multisine", "--set", "manoeuvre.high=1e9"], "it may be 100 at most"),
    (["--record", "f.tlog", "--manoeuvre", "multisine", "--set", "manoeuvre.length=3600"], "harmonics are too many"),
]


@pytest.mark.parametrize(("arguments", "words"), WRONG_USE)
def test_wrong_use_is_one_line_and_code_2(
    arguments: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["fly", *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--record", "f.xyz"], "no recorder for .xyz files"),
        (["--record", "none/f.tlog"], "cannot be written"),
        (["--record", "f.tlog", "--plan", "none.json"], "cannot read the plan"),
        (["--record", "f.tlog", "--model", "none.json"], "cannot read the model"),
        (["--record", "f.tlog", "--set", "CD_0=5"], "steady flight at 15 m/s would need"),
    ],
)
def test_a_failing_input_is_one_line_and_code_1(
    arguments: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["fly", *arguments]) == 1
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_an_aircraft_that_flies_apart_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fly", "--set", "Cm_q=900", "--record", str(tmp_path / "f.tlog")]) == 1
    error = capsys.readouterr().err
    assert "out of control after 0.02 s" in error
    assert error.count("\n") == 1


def test_a_sensor_that_reads_beyond_its_field_stands_at_the_fields_end(tmp_path: Path) -> None:
    path = tmp_path / "f.tlog"
    changes = ["--set", "sensors.vn.bias=1e5", "--set", "sensors.temperature.bias=-1e5"]
    assert main(["fly", "--duration", "1", *changes, "--record", str(path)]) == 0
    found = {message.get_type(): message for message in messages(path)}
    assert found["GLOBAL_POSITION_INT"].vx == 2**15 - 1
    assert found["GPS_RAW_INT"].vel == 2**16 - 2
    assert found["AIRSPEED"].temperature == -(2**15 - 1)
