"""Two standing vehicles behind one link, asked by pymavlink over a real socket."""

from __future__ import annotations

import random
import signal
import time
from collections.abc import Iterator
from itertools import pairwise

import pytest
from asking import STATION, Asking
from patience import PATIENCE_S
from processes import start
from pymavlink.dialects.v20 import ardupilotmega as mavlink

ACCEPTED, DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED
ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
ATTITUDE = mavlink.MAVLINK_MSG_ID_ATTITUDE


@pytest.fixture(scope="module")
def station() -> Iterator[Asking]:
    asking = Asking()
    arguments = ["fly", "--taxi", "--wait-arm", "--vehicles", 2, "--seed", 3, "--out", asking.url]
    process = start("sim-vehicle", arguments)
    with process:
        try:
            for system in (1, 2):
                asking.wait_for(lambda m, own=system: m.get_type() == "HEARTBEAT" and m.get_srcSystem() == own)
            yield asking
            process.send_signal(signal.SIGINT)
            _, error = process.communicate(timeout=PATIENCE_S)
            assert process.returncode == 130
            assert "Traceback" not in error
        finally:
            asking.close()
            if process.poll() is None:
                process.kill()


def test_time_is_told_by_the_clock_that_stamps_the_telemetry(station: Asking) -> None:
    answers = []
    for question in (111, 222):
        asked = time.monotonic_ns()
        answer = station.ask(station.mav.timesync_encode(0, question), "TIMESYNC")
        answers.append((asked, answer.tc1, time.monotonic_ns()))
        assert answer.ts1 == question
    (first_asked, first, first_came), (second_asked, second, second_came) = answers
    assert second_asked - first_came - 1e5 <= second - first <= second_came - first_asked + 1e5
    stamped = station.wait_for(lambda m: m.get_type() == "HIGHRES_IMU" and m.get_srcSystem() == 1).time_usec
    assert second / 1e3 - 50e6 < stamped < second / 1e3 + PATIENCE_S * 1e6


def test_an_answer_to_anothers_timesync_is_not_answered(station: Asking) -> None:
    station.forget()
    station.send(station.mav.timesync_encode(5, 6))
    station.send(station.mav.timesync_encode(0, 7))
    found = [station.wait_for(lambda m: m.get_type() == "TIMESYNC").ts1 for _ in range(2)]
    assert found == [7, 7]  # one from each vehicle


def test_the_parameter_list_is_whole_and_each_can_be_read(station: Asking) -> None:
    first = station.ask(station.mav.param_request_list_encode(2, 1), "PARAM_VALUE", 2)
    found = {first.param_index: first}
    while len(found) < first.param_count:
        told = station.wait_for(lambda m: m.get_type() == "PARAM_VALUE")
        assert told.get_srcSystem() == 2
        found[told.param_index] = told
    assert sorted(found) == list(range(first.param_count))
    values = {told.param_id: told.param_value for told in found.values()}
    assert values["SYSID_THISMAV"] == 2.0
    assert values["SIM_MASS"] == 1.0
    assert values["SIM_WING_AREA"] == pytest.approx(0.2)
    by_name = station.ask(station.mav.param_request_read_encode(2, 1, b"SIM_WING_SPAN", -1), "PARAM_VALUE", 2)
    assert (by_name.param_value, by_name.param_type) == (1.0, mavlink.MAV_PARAM_TYPE_REAL32)
    by_index = station.ask(station.mav.param_request_read_encode(2, 1, b"", by_name.param_index), "PARAM_VALUE", 2)
    assert by_index.param_id == "SIM_WING_SPAN"


def set_parameter(station: Asking, name: bytes, value: float) -> float:
    question = station.mav.param_set_encode(1, 1, name, value, mavlink.MAV_PARAM_TYPE_REAL32)
    return float(station.ask(question, "PARAM_VALUE").param_value)


def test_what_is_read_only_or_out_of_range_stays(station: Asking) -> None:
    assert set_parameter(station, b"SIM_MASS", 2.0) == 1.0
    assert set_parameter(station, b"SR0_EXTRA2", 1e9) == pytest.approx(10.0)
    assert set_parameter(station, b"SR0_EXTRA2", float("nan")) == pytest.approx(10.0)


def stamps(station: Asking, kind: str, count: int, system: int) -> list[int]:
    """Stamps of the next messages of one kind, ms."""
    station.forget()
    found = [
        station.wait_for(lambda m: m.get_type() == kind and m.get_srcSystem() == system).time_boot_ms
        for _ in range(count)
    ]
    return [after - before for before, after in pairwise(found)]


def test_a_rate_asked_for_is_kept_by_that_vehicle_alone(station: Asking) -> None:
    assert station.command(INTERVAL, ATTITUDE, 100_000) == ACCEPTED
    assert stamps(station, "ATTITUDE", 4, 1) == [100, 100, 100]
    assert stamps(station, "ATTITUDE", 4, 2) == [20, 20, 20]
    assert station.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, ATTITUDE) == ACCEPTED
    assert station.wait_for(lambda m: m.get_type() == "MESSAGE_INTERVAL").interval_us == 100_000
    assert set_parameter(station, b"SR0_EXTRA1", 25.0) == 25.0
    assert stamps(station, "ATTITUDE", 3, 1) == [40, 40]
    station.send(station.mav.request_data_stream_encode(1, 1, mavlink.MAV_DATA_STREAM_EXTRA1, 50, 1))
    assert station.command(INTERVAL, ATTITUDE, 1) == ACCEPTED  # as often as there are samples
    assert stamps(station, "ATTITUDE", 3, 1) == [20, 20]


def test_a_stopped_message_comes_back_with_its_default(station: Asking) -> None:
    hud = mavlink.MAVLINK_MSG_ID_VFR_HUD
    assert station.command(INTERVAL, hud, -1) == ACCEPTED
    assert station.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, hud) == ACCEPTED
    assert station.wait_for(lambda m: m.get_type() == "MESSAGE_INTERVAL").interval_us == -1
    station.forget()
    seen = [station.wait_for(lambda m: m.get_srcSystem() == 1).get_type() for _ in range(200)]
    assert "VFR_HUD" not in seen
    assert station.command(INTERVAL, hud, 0) == ACCEPTED
    station.wait_for(lambda m: m.get_type() == "VFR_HUD" and m.get_srcSystem() == 1)


@pytest.mark.parametrize(
    ("number", "values", "result"),
    [
        (mavlink.MAV_CMD_NAV_TAKEOFF, (), mavlink.MAV_RESULT_UNSUPPORTED),
        (INTERVAL, (mavlink.MAVLINK_MSG_ID_CAMERA_TRIGGER, 1000), DENIED),
        (INTERVAL, (ATTITUDE, float("nan")), DENIED),
        (mavlink.MAV_CMD_REQUEST_MESSAGE, (mavlink.MAVLINK_MSG_ID_CAMERA_TRIGGER,), DENIED),
        (mavlink.MAV_CMD_REQUEST_MESSAGE, (1.5,), DENIED),
        (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.5,), DENIED),
    ],
)
def test_what_cannot_be_done_is_refused(station: Asking, number: int, values: tuple[float, ...], result: int) -> None:
    assert station.command(number, *values) == result


def test_messages_on_request(station: Asking) -> None:
    assert station.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION) == ACCEPTED
    version = station.wait_for(lambda m: m.get_type() == "AUTOPILOT_VERSION")
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    assert station.command(INTERVAL, mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, -1) == ACCEPTED
    asked = mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW
    assert station.command(mavlink.MAV_CMD_REQUEST_MESSAGE, asked) == ACCEPTED
    said = station.wait_for(lambda m: m.get_type() == "SERVO_OUTPUT_RAW" and m.get_srcSystem() == 1)
    assert said.servo4_raw == 1500
    question = station.mav.command_int_encode(
        1, 1, 0, mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 0, 0, 1, *[0] * 6
    )
    assert station.ask(question, "COMMAND_ACK").result == ACCEPTED


def test_a_mission_is_empty_and_cannot_be_put_aboard(station: Asking) -> None:
    assert station.ask(station.mav.mission_request_list_encode(1, 1), "MISSION_COUNT").count == 0
    assert station.ask(station.mav.mission_clear_all_encode(1, 1), "MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED
    refused = station.ask(station.mav.mission_count_encode(1, 1, 3), "MISSION_ACK")
    assert refused.type == mavlink.MAV_MISSION_UNSUPPORTED


def test_ping_and_files(station: Asking) -> None:
    answer = station.ask(station.mav.ping_encode(123, 9, 0, 0), "PING")
    assert (answer.time_usec, answer.seq, answer.target_system) == (123, 9, STATION)
    open_file = bytes([7, 0, 1, 4, 3, 0, 0, 0, 0, 0, 0, 0]) + b"x/y" + bytes(236)
    refusal = bytes(
        station.ask(station.mav.file_transfer_protocol_encode(0, 1, 1, open_file), "FILE_TRANSFER_PROTOCOL").payload
    )
    assert refusal[:6] == bytes([8, 0, 1, 129, 1, 4])


def test_random_payloads_of_every_message_do_it_no_harm(station: Asking) -> None:
    choice = random.Random(5)
    for count, number in enumerate(sorted(mavlink.mavlink_map)):
        kind = mavlink.mavlink_map[number]
        for start_bytes in (b"", bytes([1, 1])):
            payload = bytearray(choice.randbytes(kind.unpacker.size))
            payload[: len(start_bytes)] = start_bytes
            header = bytes([0xFD, len(payload), 0, 0, 0, STATION, 190]) + number.to_bytes(3, "little")
            check = mavlink.x25crc(header[1:] + bytes(payload) + bytes([kind.crc_extra])).crc
            station.socket.sendto(header + bytes(payload) + check.to_bytes(2, "little"), station.peer)
        if count % 30 == 0:  # no more than a socket's buffer holds
            station.ask(station.mav.timesync_encode(0, 41), "TIMESYNC", 2)
    assert station.ask(station.mav.timesync_encode(0, 42), "TIMESYNC", 2).ts1 == 42


def armed(station: Asking, system: int) -> bool:
    station.forget()
    heartbeat = station.wait_for(lambda m: m.get_type() == "HEARTBEAT" and m.get_srcSystem() == system)
    return bool(heartbeat.base_mode & ARMED)


def test_arming_begins_the_flight_of_the_vehicle_that_is_told_to(station: Asking) -> None:
    assert not armed(station, 2)
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, system=2) == ACCEPTED
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, system=2) == ACCEPTED
    station.wait_for(lambda m: m.get_type() == "HEARTBEAT" and m.get_srcSystem() == 2 and m.base_mode & ARMED)
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, system=2) == ACCEPTED
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, system=2) == DENIED
    assert armed(station, 2)
