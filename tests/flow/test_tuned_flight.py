"""From a log with an autopilot's parameters to a file of better ones, by the command line."""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path

import numpy as np
import pytest
from field_flight import fly_plan, plan_of
from field_wire import BOOT, START, write_flight
from processes import run
from pymavlink.dialects.v20 import ardupilotmega as mavlink

pytestmark = pytest.mark.whole_flight

NOW = {"SCALING_SPEED": 18.0, "RLL_RATE_FF": 0.4, "ARSPD_RATIO": 2.1, "SERVO2_TRIM": 1520.0}


def test_the_intervals_hold_what_another_engine_flew_and_the_log_says_what_each_is_now(tmp_path: Path) -> None:
    """A flight of JSBSim's behind sensors, servos and gusts as the field has them."""
    flight = fly_plan(plan_of("mild", 103), 103, tmp_path, "flight")
    write_flight(flight, tmp_path / "flight")
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    link.seq = 99
    log = tmp_path / "flight.tlog"
    sent = b"".join(
        struct.pack(">Q", round((START + BOOT) * 1e6))
        + mavlink.MAVLink_param_value_message(name.encode(), value, 9, len(NOW), k).pack(link)
        for k, (name, value) in enumerate(NOW.items())
    )
    log.write_bytes(sent + log.read_bytes())
    result, file = tmp_path / "result.json", tmp_path / "plane.param"
    done = run("gcs", "identify", log, "--vehicle", tmp_path / "flight.toml", "-o", result)
    assert done.returncode == 0, done.stderr
    done = run("gcs", "tune", result, "--for", "ardupilot", "-o", file, "--json")
    assert done.returncode == 0, done.stderr
    found = {one["name"]: one for one in json.loads(done.stdout)["parameters"]}
    truth = {name: float(np.mean(ends)) for name, ends in flight.truth.items()}
    craft, full = flight.vehicle, math.degrees(500.0 * 0.436 / 500.0)
    roll = abs(truth["Cl_p"] / truth["Cl_da"]) * craft.geometry.b / 2.0 * 45.0 / full / 18.0
    low, high = found["RLL_RATE_FF"]["interval"]
    assert low < roll < high
    assert high - low < 0.2 * roll
    assert found["RLL_RATE_FF"]["now"] == pytest.approx(0.4)
    assert found["SERVO2_TRIM"]["now"] == 1520.0
    refused = {one["name"]: one for one in json.loads(done.stdout)["refused"]}
    # Straight flight in an unknown wind says nothing of the pitot tube.
    assert refused["ARSPD_RATIO"]["now"] == pytest.approx(2.1)
    assert f"RLL_RATE_FF,{found['RLL_RATE_FF']['value']:g}\n" in file.read_text()
