"""Modes, texts and raw fields on the clock of a flight's signals."""

from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from traffic import SECOND, Vehicle, batch

from gcs.flights.signals import extract, streams_for
from gcs.flights.timeline import modes, raw_fields, texts
from gcs.mavlink.dialect import Dialect
from gcs.recording.reader import Recording
from gcs.station.capture import Capture
from sim_vehicle.vehicle.vehicle_file import Vehicle as VehicleFile

START = 1_800_000_000 * SECOND


class Plane(Vehicle):
    """An ArduPlane: its modes are numbers that only its type gives a meaning."""

    def beat(self, mode: int, armed: bool) -> bytes:
        flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
        return self.frame(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_FIXED_WING, 3, flags, mode, 4, 3))

    def says(self, text: str, number: int = 0, chunk: int = 0) -> bytes:
        return self.frame(mavlink.MAVLink_statustext_message(4, text.encode(), number, chunk))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Ten seconds: MANUAL on the ground, FBWA armed from 3 s on, AUTO from 6 s on."""
    path = tmp_path_factory.mktemp("timeline") / "flight.mcap"
    plane = Plane()
    plane.boot_ms = 7000
    with_capture = Capture(path, Dialect.load())
    for tenth in range(100):
        mode, armed = (0, False) if tenth < 30 else (5, True) if tenth < 60 else (10, True)
        frames = [plane.attitude(0.01 * tenth)]
        if tenth % 10 == 0:
            frames.append(plane.beat(mode, armed))
        if tenth == 42:
            frames += [plane.says("x" * 50, 7, 0), plane.says("end of it", 7, 1)]
        if tenth == 80:
            frames.append(plane.says("Low battery"))
        with_capture.take("udpin:test", batch(frames, START + tenth * SECOND // 10, 1_000_000))
        plane.boot_ms += 100
    with_capture.close(START + 10 * SECOND)
    return Recording(path)


def test_modes_have_the_names_that_ground_stations_show(recording: Recording) -> None:
    found = modes(recording, streams_for(recording, VehicleFile.unknown()))
    assert [(one.mode, one.armed) for one in found] == [("MANUAL", False), ("FBWA", True), ("AUTO", True)]
    assert [one.start for one in found] == pytest.approx([0.0, 3.0, 6.0], abs=0.05)
    assert [one.end for one in found] == pytest.approx([3.0, 6.0, 9.9], abs=0.05)


def test_a_text_in_two_chunks_is_one(recording: Recording) -> None:
    found = texts(recording, streams_for(recording, VehicleFile.unknown()))
    assert [(one.text, one.severity) for one in found] == [("x" * 50 + "end of it", 4), ("Low battery", 4)]
    assert [one.time for one in found] == pytest.approx([4.2, 8.0], abs=0.05)


def test_a_field_stands_on_the_clock_of_the_signals(recording: Recording) -> None:
    streams = streams_for(recording, VehicleFile.unknown())
    found = {one.name: one for one in raw_fields(recording, streams, "ATTITUDE")}
    signal = extract(recording, VehicleFile.unknown()).signals["phi"]
    assert np.array_equal(found["ATTITUDE.roll"].values, signal.values)
    assert np.array_equal(found["ATTITUDE.roll"].time_s, signal.time_s)
    assert found["ATTITUDE.time_boot_ms"].values[0] == 7000
    assert raw_fields(recording, streams, "NO_SUCH") == []
    assert Path(recording.path).exists()
