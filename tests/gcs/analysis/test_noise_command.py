"""`gcs noise` on a log at rest that pymavlink wrote."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.cli import main

START_US = 1_760_000_000_000_000
ACCELEROMETER, GYRO = 0.08, 0.0009


def write_log(path: Path, seconds: float, turn_rate: float = 0.0, push: float = 0.0) -> Path:
    """An IMU at 50 Hz whose white noise is known, on a bench that turns at `turn_rate` (amplitude, rad/s).

    push: m/s2 along x from three quarters of the time on, as a motor makes that starts.
    """
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    generator = np.random.default_rng(8)
    with open(path, "wb") as file:
        for i in range(round(seconds * 50)):
            at = i * 20_000
            messages = []
            if i % 50 == 0:
                messages.append(mavlink.MAVLink_heartbeat_message(1, 0, 0, 0, 3, 3))
            ax, ay, az = generator.normal(0.0, ACCELEROMETER, 3)
            p, q, r = generator.normal(0.0, GYRO, 3)
            ax += push if i > 0.75 * seconds * 50 else 0.0
            r += turn_rate * np.sin(0.5 * at * 1e-6)
            imu = (ax, ay, az - 9.8, p, q, r, 0, 0, 0, 1013.0, 0.0, 0.0, 20.0, 0x103F)
            messages.append(mavlink.MAVLink_highres_imu_message(12_000_000 + at, *imu))
            for message in messages:
                file.write(struct.pack(">Q", START_US + at) + message.pack(sender))
                sender.seq = (sender.seq + 1) % 256
    return path


def test_the_noise_of_an_imu_on_the_bench(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write_log(tmp_path / "bench.tlog", 60.0)
    assert main(["noise", str(log), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["schema"] == "noise/1"
    for name, sigma in {"ax": ACCELEROMETER, "az": ACCELEROMETER, "q": GYRO}.items():
        entry = result["signals"][name]
        assert entry["noise"] == pytest.approx(sigma, rel=0.06)
        white = entry["white"]
        assert abs(white["value"] - sigma / np.sqrt(50.0)) < 4.0 * white["std"]
    assert result["signals"]["az"]["mean"] == pytest.approx(-9.8, abs=0.01)
    assert result["vehicle_file"]["accelerometer"] == pytest.approx(ACCELEROMETER, rel=0.04)
    assert result["vehicle_file"]["gyro"] == pytest.approx(GYRO, rel=0.04)
    assert result["warnings"] == [] or not any("at rest" in text for text in result["warnings"])
    assert any(entry["name"] == "temperature" and "never changes" in entry["reason"] for entry in result["refused"])
    assert main(["noise", str(log), "--from", "5", "--to", "50"]) == 0
    text = capsys.readouterr().out
    assert "accelerometer = { noise = 0.0" in text
    assert "rad/s" in text


def test_a_bench_that_moves_is_no_bench(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write_log(tmp_path / "moving.tlog", 60.0, turn_rate=0.3)
    assert main(["noise", str(log), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert any(text.startswith("r moved: the aircraft was not at rest") for text in result["warnings"])
    assert result["vehicle_file"] == {}


def test_a_motor_that_starts_leaves_nothing_to_copy_into_a_vehicle_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_log(tmp_path / "started.tlog", 60.0, push=2.0)
    assert main(["noise", str(log)]) == 0
    text = capsys.readouterr().out
    assert "warning: ax moved: the aircraft was not at rest or its motor not off" in text
    assert "accelerometer = {" not in text
    assert main(["noise", str(log), "--to", "44"]) == 0
    assert "accelerometer = { noise = 0.0" in capsys.readouterr().out


def test_too_short_a_log_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = write_log(tmp_path / "short.tlog", 2.0)
    assert main(["noise", str(log)]) == 1
    assert capsys.readouterr().err.count("\n") == 1
