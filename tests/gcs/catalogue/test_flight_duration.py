"""How long a flight was, by the vehicle's clock and not by that of whoever received it."""

from __future__ import annotations

from pathlib import Path

import pytest
from traffic import SECOND, Vehicle, batch, ground_station_heartbeat

from gcs.catalogue.intake import describe
from gcs.mavlink.dialect import Dialect
from gcs.station.capture import Capture

START = 1_700_000_000 * SECOND


def captured(path: Path, seconds: list[list[bytes]], every_s: float) -> Path:
    capture = Capture(path, Dialect.load(), now_ns=START)
    for i, frames in enumerate(seconds):
        capture.take("udpin", batch(frames, START + round(i * every_s * SECOND)))
    capture.close(START + round(len(seconds) * every_s * SECOND))
    assert capture.problem is None
    return path


def test_a_flight_told_ten_times_as_fast_as_it_was_flown_is_as_long_as_it_was_flown(tmp_path: Path) -> None:
    vehicle = Vehicle()
    path = captured(tmp_path / "fast.mcap", [vehicle.second() for _ in range(40)], 0.1)
    flight = describe([path], "fast", "fast.mcap", "live", "complete")
    assert flight.vehicle_s == pytest.approx(40.0, abs=0.1)
    assert (flight.end_ns - flight.start_ns) / SECOND == pytest.approx(4.0, abs=1.1)


def test_of_a_recording_without_a_vehicle_only_the_reception_is_told(tmp_path: Path) -> None:
    path = captured(tmp_path / "none.mcap", [[ground_station_heartbeat()] for _ in range(3)], 1.0)
    assert describe([path], "none", "none.mcap", "upload", "complete").vehicle_s is None
