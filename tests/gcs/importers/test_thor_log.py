"""A flight log of the Ultra Stick 25e becomes a recording: nothing lost, nothing made up."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from gcs.errors import GcsError
from gcs.flights.signals import extract
from gcs.recording.reader import Recording
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.signals.flight import FlightSignals

TOOL = Path(__file__).parents[3] / "tools" / "thor.py"
SECONDS, TAKE_OVER, MOTOR_LATE = 60.0, 20.0, 7.75


def made_log() -> dict[str, Any]:
    """Columns of a made-up flight: the pilot flies, then the autopilot; no fix in the first ten seconds."""
    time = np.arange(0.02, SECONDS, 0.02)
    auto = time > TAKE_OVER
    rng = np.random.default_rng(1)
    throttle = np.where(auto, 0.6 + 0.2 * np.sin(0.9 * time) * np.sin(0.23 * time), 0.7)
    second = np.floor(time)
    log = {name: rng.standard_normal(time.size) for name in ("p", "q", "r", "ax", "ay", "az", "phi", "theta", "psi")}
    log |= {"aoa": 0.1 + 0.02 * np.sin(time), "aos": 0.03 * np.cos(time), "ias": 17.0 + np.sin(time)}
    log |= {
        "time": time,
        "mode": np.where(auto, 2, 1).astype(np.uint8),
        "Ps": np.full(time.size, 97.7),
        "h": 60.0 + time,
    }
    log |= {
        "GPS_TOW": np.where(second < 10.0, 0.0, 3e5 + second),
        "lat": 45.0 + 1e-5 * second,
        "lon": -93.0 + 0.0 * time,
    }
    log |= {"alt": 300.0 + 0.0 * time, "vn": 10.0 + 0.1 * second, "ve": -5.0 + 0.0 * time, "vd": 0.01 * second}
    log |= {"satVisible": np.full(time.size, 7.0), "dthr": throttle}
    for name, neutral in (("de", -0.04), ("da_l", -0.02), ("da_r", 0.02), ("dr", 0.0)):
        log[name] = np.where(auto, neutral + 0.05 * np.sin(2.0 * time + len(name)), neutral)
    motor_time = np.arange(0.0, SECONDS + 20.0, 0.5)
    log |= {"motor_time": motor_time, "motor_throttle": 1.1 + 0.7 * np.interp(motor_time + MOTOR_LATE, time, throttle)}
    log["motor_RPM"] = 4000.0 + motor_time
    return log


def tool() -> ModuleType:
    """The script as a module."""
    specification = importlib.util.spec_from_file_location("thor", TOOL)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def convert(folder: Path, log: dict[str, Any]) -> None:
    """Convert a log that is written to the folder first."""
    savemat(folder / "log.mat", {"flight_data": log}, do_compression=True)
    tool().convert(folder / "log.mat", folder / "log.mcap", folder / "log.toml")


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], FlightSignals]:
    folder = tmp_path_factory.mktemp("thor")
    log = made_log()
    convert(folder, log)
    vehicle = load_vehicle(str(folder / "log.toml"))
    assert vehicle.warnings == ()
    return log, extract(Recording(folder / "log.mcap"), vehicle)


def test_every_measured_column_arrives_in_si_units(flight: tuple[dict[str, Any], FlightSignals]) -> None:
    log, signals = flight
    columns = {"p": "p", "q": "q", "r": "r", "ax": "ax", "ay": "ay", "az": "az", "alpha": "aoa", "beta": "aos"}
    for name, column in (columns | {"airspeed": "ias", "phi": "phi", "theta": "theta"}).items():
        found = signals.signals[name]
        assert found.values.size == log["time"].size, name
        np.testing.assert_allclose(found.values, log[column], atol=2e-5, err_msg=name)
    static = signals.signals["static_pressure"]
    np.testing.assert_allclose(static.values, 97_700.0, rtol=1e-6)


def test_surfaces_are_there_only_while_the_autopilot_moves_them(flight: tuple[dict[str, Any], FlightSignals]) -> None:
    log, signals = flight
    auto = log["mode"] == 2
    for name, expected in (
        ("de", log["de"]),
        ("da", 0.5 * (log["da_r"] - log["da_l"])),
        ("dr", log["dr"]),
        ("throttle", log["dthr"]),
    ):
        np.testing.assert_allclose(signals.signals[name].values, expected[auto], atol=1e-6, err_msg=name)
        assert signals.signals[name].time_s[0] >= TAKE_OVER - log["time"][0] - 0.03


def test_a_satellite_fix_counts_once_and_not_before_there_is_one(flight: tuple[dict[str, Any], FlightSignals]) -> None:
    log, signals = flight
    north = signals.signals["vn"]
    fixes = np.unique(log["GPS_TOW"])[1:]
    assert north.values.size == fixes.size
    np.testing.assert_allclose(north.values, 10.0 + 0.1 * (fixes - 3e5), atol=0.02)


def test_the_motor_log_is_put_on_the_flights_clock(flight: tuple[dict[str, Any], FlightSignals]) -> None:
    log, signals = flight
    rpm = signals.signals["rpm"]
    # The log counts half of the turns; its clock started MOTOR_LATE seconds after the flight's.
    at = 30.0 + log["time"][0]
    expected = 2.0 * (4000.0 + at - MOTOR_LATE)
    assert np.interp(30.0, rpm.time_s, rpm.values) == pytest.approx(expected, abs=2.0 * 0.3)


@pytest.mark.parametrize(
    ("change", "told"), [("drop", "flight_data lacks dthr"), ("short", "ias has"), ("idle", "throttle")]
)
def test_a_log_that_cannot_be_used_is_told_in_one_line(tmp_path: Path, change: str, told: str) -> None:
    log = made_log()
    if change == "drop":
        del log["dthr"]
    elif change == "short":
        log["ias"] = log["ias"][:-5]
    else:
        log["dthr"] = np.full(log["time"].size, 0.7)
    with pytest.raises(GcsError, match=told) as caught:
        convert(tmp_path, log)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "log.mcap").exists()


def test_a_file_that_is_no_log_is_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "log.mat").write_bytes(b"nothing of the kind" * 50)
    arguments = [str(tmp_path / "log.mat"), "-o", str(tmp_path / "log.mcap"), "--vehicle", str(tmp_path / "log.toml")]
    done = subprocess.run([sys.executable, str(TOOL), *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
