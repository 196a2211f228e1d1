"""The simulated aircraft at the other end of a serial line: nothing is lost, and the model is the file's own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from processes import ANSWERS, recording_station, run
from same_result import assert_same_result
from serial_line import serial_line

from gcs.cli import main
from gcs.recording.reader import Recording

FLIGHT = ("fly", "--manoeuvre", "multisine", "--duration", 16, "--seed", 3, "--noise", "table2")


def test_a_flight_over_a_serial_line_is_the_flight_recorded_at_its_source(tmp_path: Path) -> None:
    direct, received = tmp_path / "direct.mcap", tmp_path / "received.mcap"
    done = run("sim-vehicle", *FLIGHT, "--record", direct)
    assert done.returncode == 0, done.stderr
    source = Recording(direct)
    with (
        serial_line() as (vehicle_end, station_end),
        recording_station(f"{station_end},921600", received, sum(source.counts().values())),
    ):
        done = run("sim-vehicle", *FLIGHT, "--out", f"{vehicle_end},921600", "--speed", 5)
        assert done.returncode == 0, done.stderr
    again = Recording(received)
    assert {topic: n for topic, n in again.counts().items() if not topic.endswith(ANSWERS)} == source.counts()
    assert sum(again.lost().values()) == 0
    for name in set(source.messages()) - {"SYSTEM_TIME"}:  # which tells when the simulation was started
        np.testing.assert_array_equal(again.columns(name)[0].fields, source.columns(name)[0].fields)
    results = []
    for path in (direct, received):
        target = path.with_suffix(".json")
        assert main(["identify", str(path), "--vehicle", "iitb-mav", "-o", str(target)]) == 0
        results.append(json.loads(target.read_text(encoding="utf-8")))
    assert_same_result(results[1], results[0], relative=1e-6)
