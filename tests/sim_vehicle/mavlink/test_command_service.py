"""What the vehicle answers to commands, asked and read through pymavlink."""

import logging
import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.flight.arming import Arming
from sim_vehicle.mavlink.frame_encoder import Voice
from sim_vehicle.mavlink.parameter_service import Onboard
from sim_vehicle.mavlink.services import Protocol
from sim_vehicle.mavlink.telemetry import Telemetry
from sim_vehicle.vehicle.vehicle_file import load_vehicle

ACCEPTED, DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED
KNOWN = (
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
    mavlink.MAV_CMD_GET_MESSAGE_INTERVAL,
    mavlink.MAV_CMD_REQUEST_MESSAGE,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES,
)
EXTREMES = (
    *(0.0, 0.5, 1.0, -1.0, -2.0, 30.0, 148.0, 244.0, 295.0, 65_535.0, 65_536.0, 70_000.0, 16_777_215.0, 16_777_216.0),
    *(1e10, 3e38, -3e38, 1e-40, math.nan, math.inf, -math.inf),
)


class Vehicle:
    """A vehicle that has just booted, and a ground station at its ear."""

    def __init__(self, version: int = 2) -> None:
        self.telemetry = Telemetry(epoch_us=0, voice=Voice(version=version))
        onboard = Onboard(load_vehicle("iitb-mav"), 1, self.telemetry.rates)
        self.protocol = Protocol(self.telemetry, onboard, Arming(wait=True), lambda: 1.0)
        self.station: Any = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._ear, self._mind = self.telemetry.voice.parser(), mavlink.MAVLink(None)

    def ask(self, message: Any) -> list[Any]:
        """Its answers, as a station parses them."""
        for heard in self._ear.parse_buffer(message.pack(self.station)) or []:
            self.protocol.answer(heard)
        return [self._mind.decode(bytearray(frame)) for frame in self.telemetry.voice.take()]

    def command(self, number: int, first: float = 0.0, second: float = 0.0) -> tuple[int, list[Any]]:
        """Result and what followed it."""
        acknowledged, *rest = self.ask(
            self.station.command_long_encode(1, 1, number, 0, first, second, 0.0, 0.0, 0.0, 0.0, 0.0)
        )
        assert (acknowledged.get_type(), acknowledged.command) == ("COMMAND_ACK", number)
        return acknowledged.result, rest


def test_ids_that_no_answer_can_carry_are_denied() -> None:
    vehicle = Vehicle()
    assert vehicle.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 70_000.0) == (DENIED, [])
    assert vehicle.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 244.0, 70_000.0) == (DENIED, [])
    result, (told,) = vehicle.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 65_535.0)
    assert (result, told.message_id, told.interval_us) == (ACCEPTED, 65_535, 0)


@pytest.mark.parametrize("asked_us", [1e10, 3e38])
def test_an_interval_is_held_at_the_longest_that_can_be_told(asked_us: float) -> None:
    vehicle = Vehicle()
    assert vehicle.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 30.0, asked_us) == (ACCEPTED, [])
    _, (told,) = vehicle.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 30.0)
    assert (told.message_id, told.interval_us) == (30, 2**31 - 1)


def test_the_slowest_stream_rate_can_be_told() -> None:
    vehicle = Vehicle()
    vehicle.ask(vehicle.station.param_set_encode(1, 1, b"SR0_EXTRA1", 1e-40, mavlink.MAV_PARAM_TYPE_REAL32))
    _, (told,) = vehicle.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 30.0)
    assert told.interval_us == 2**31 - 1


@pytest.mark.parametrize("version", [1, 2])
def test_extreme_parameters_are_answered_and_the_vehicle_hears_on(
    version: int, caplog: pytest.LogCaptureFixture
) -> None:
    vehicle = Vehicle(version)
    for number in KNOWN:
        for first in EXTREMES:
            for second in EXTREMES:
                result, _ = vehicle.command(number, first, second)
                assert result in (ACCEPTED, DENIED)
    assert not caplog.records
    (answer,) = vehicle.ask(vehicle.station.timesync_encode(0, 7))
    assert answer.ts1 == 7


def test_one_question_without_a_possible_answer_does_not_deafen_the_vehicle(caplog: pytest.LogCaptureFixture) -> None:
    vehicle = Vehicle()
    too_late = vehicle.station.system_time_encode(0, 2**40)
    vehicle.telemetry.latest[mavlink.MAVLINK_MSG_ID_SYSTEM_TIME] = too_late
    with caplog.at_level(logging.WARNING):
        assert vehicle.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 2.0) == (ACCEPTED, [])
    assert "COMMAND_LONG from 255/190: no answer" in caplog.text
    assert vehicle.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == (ACCEPTED, [])


def test_mavlink_1_denies_what_it_cannot_carry() -> None:
    old, new = Vehicle(1), Vehicle(2)
    airspeed = mavlink.MAVLINK_MSG_ID_AIRSPEED
    for vehicle in (old, new):
        vehicle.telemetry.latest[airspeed] = vehicle.station.airspeed_encode(0, 15.0, 2000, 1.0, 0)
    for command, second in ((mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 1e5), (mavlink.MAV_CMD_REQUEST_MESSAGE, 0.0)):
        assert old.command(command, airspeed, second) == (DENIED, [])
        assert new.command(command, airspeed, second)[0] == ACCEPTED
    _, (told,) = old.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, airspeed)
    assert told.interval_us == 0  # MAVLink's number for a message that is not available
