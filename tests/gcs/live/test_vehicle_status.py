"""What is known of a vehicle beside its signals, by messages as pymavlink makes them."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from traffic import SECOND, Vehicle, batch

from gcs.live.messages import VehicleMessages
from gcs.live.vehicle_status import MESSAGES, VehicleStatus
from gcs.mavlink.dialect import Dialect

HOME = (47.0, 8.0)


def place(north: float, east: float) -> tuple[int, int]:
    """1e-7 degrees of a place so far from HOME, m: 111.32 km a degree."""
    degrees = 111_319.49
    return round(1e7 * (HOME[0] + north / degrees)), round(1e7 * (HOME[1] + east / degrees / 0.68199836))


class Heard:
    """A vehicle whose messages are read."""

    def __init__(self) -> None:
        self.vehicle = Vehicle()
        self.vehicle.boot_ms = 5000
        self.messages = VehicleMessages(Dialect.load(), [*MESSAGES, "ATTITUDE"])
        self.status = VehicleStatus()
        self.now = 1_800_000_000 * SECOND

    def hear(self, *messages: Any) -> dict[str, Any]:
        frames = [self.vehicle.heartbeat(), self.vehicle.attitude(), *map(self.vehicle.frame, messages)]
        self.vehicle.boot_ms += 1000
        self.status.take(self.messages.take([batch(frames, self.now)]))
        self.now += SECOND
        return self.status.to_json()


def test_mode_battery_gps_and_wind() -> None:
    station = Heard()
    found = station.hear()
    assert (found["mode"], found["armed"]) == ("PREFLIGHT", True)
    assert "battery" not in found
    found = station.hear(
        mavlink.MAVLink_heartbeat_message(1, 3, 0x81, 5, 4, 3),
        mavlink.MAVLink_sys_status_message(0, 0, 0, 500, 11820, 1230, 72, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_gps_raw_int_message(1, 3, *place(0.0, 0.0), 500_000, 90, 150, 0, 0, 11),
        # From the west, where it goes to the east.
        mavlink.MAVLink_wind_message(270.0, 4.0, 0.1),
    )
    assert (found["mode"], found["armed"]) == ("FBWA", True)
    assert found["battery"] == {"voltage_v": 11.82, "current_a": 12.3, "remaining": 0.72}
    assert found["gps"] == {"fix": "3D", "good": True, "satellites": 11, "hdop": 0.9}
    assert found["wind"] == {"north": pytest.approx(0.0, abs=1e-6), "east": pytest.approx(4.0)}


def test_what_a_battery_does_not_say_is_not_there() -> None:
    station = Heard()
    found = station.hear(mavlink.MAVLink_sys_status_message(0, 0, 0, 500, 65535, -1, -1, 0, 0, 0, 0, 0, 0))
    assert "battery" not in found
    cells = [4000, 4010, 3990, *[65535] * 7]
    found = station.hear(mavlink.MAVLink_battery_status_message(0, 0, 0, 0, cells, -1, -1, -1, 55))
    assert found["battery"] == {"voltage_v": 12.0, "remaining": 0.55}


def test_places_are_metres_from_home_or_from_where_it_was_heard_first() -> None:
    station = Heard()
    fix = mavlink.MAVLink_gps_raw_int_message(1, 3, *place(10.0, -20.0), 0, 90, 150, 0, 0, 9)
    found = station.hear(fix)
    assert found["position"] == [0.0, 0.0]
    assert found["home"]["given"] is False
    found = station.hear(mavlink.MAVLink_global_position_int_message(2, *place(110.0, 30.0), 0, 0, 0, 0, 0, 0))
    assert found["position"] == pytest.approx([100.0, 50.0], abs=0.3)
    # What the GPS says beside the filter moves it no more; a home that the vehicle tells does.
    found = station.hear(fix)
    assert found["position"] == pytest.approx([100.0, 50.0], abs=0.3)
    found = station.hear(mavlink.MAVLink_home_position_message(*place(0.0, 0.0), 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))
    assert found["position"] == pytest.approx([110.0, 30.0], abs=0.3)
    assert found["home"]["given"] is True


def test_texts_in_pieces_are_one_and_the_same_one_twice_too() -> None:
    station = Heard()
    pieces = [b"a text that is longer than fifty characters and so", b" comes in two pieces"]
    first, second = (mavlink.MAVLink_statustext_message(4, piece, 7, i) for i, piece in enumerate(pieces))
    found = station.hear(first, second, mavlink.MAVLink_statustext_message(6, b"Flaps up"),
                      mavlink.MAVLink_statustext_message(6, b"Flaps up"))  # fmt: skip
    assert [one["text"] for one in found["texts"]] == [b"".join(pieces).decode(), "Flaps up"]
    assert found["texts"][0]["severity"] == 4
    # Pieces of two texts in between one another, the first ones over two links.
    ends = [mavlink.MAVLink_statustext_message(6, text, number, 1) for number, text in ((1, b"pha"), (2, b"ta"))]
    starts = [mavlink.MAVLink_statustext_message(6, text, number, 0) for number, text in ((1, b"al"), (2, b"be"))]
    found = station.hear(*starts, *starts, *ends, *ends)
    assert [one["text"] for one in found["texts"][-2:]] == ["alpha", "beta"]
    for number in range(40):
        found = station.hear(mavlink.MAVLink_statustext_message(6, f"number {number}".encode()))
    assert [one["text"] for one in found["texts"]] == [f"number {number}" for number in range(20, 40)]
