"""The commands that the vehicle carries out: arming, messages on request, and their intervals.

https://mavlink.io/en/services/command.html
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from typing import Any

os.environ.setdefault("MAVLINK20", "1")

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.flight.arming import Arming
from sim_vehicle.mavlink.message_rates import OFF
from sim_vehicle.mavlink.telemetry import Telemetry

_ACCEPTED, _DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED
_SOFTWARE_VERSION = 0x00_01_00_00 | mavlink.FIRMWARE_VERSION_TYPE_DEV  # 0.1.0: major, minor, patch, type
_CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
)
_NO_HASH = [0] * 8
_LARGEST_ID = 0xFFFF  # of MESSAGE_INTERVAL

# The result, a MAV_RESULT, and the messages that follow the acknowledgement.
Outcome = tuple[int, Sequence[Any]]


class Commands:
    """The commands of one vehicle, of COMMAND_LONG and COMMAND_INT alike."""

    def __init__(self, telemetry: Telemetry, arming: Arming) -> None:
        self._telemetry = telemetry
        self._build = telemetry.voice.build
        self._arming = arming
        self._known: dict[int, Callable[[Any], Outcome]] = {
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
            mavlink.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: self._request_capabilities,
        }

    def run(self, message: Any) -> Outcome:
        """Carry out a COMMAND_LONG or COMMAND_INT."""
        known = self._known.get(message.command)
        return known(message) if known else (mavlink.MAV_RESULT_UNSUPPORTED, ())

    def _arm(self, message: Any) -> Outcome:
        if message.param1 not in (0.0, 1.0):
            return _DENIED, ()
        done = self._arming.command(message.param1 == 1.0, armed=self._telemetry.armed)
        return _ACCEPTED if done else _DENIED, ()

    def _set_interval(self, message: Any) -> Outcome:
        number, interval_us = _whole(message.param1), message.param2
        if number is None or not self._telemetry.voice.can_say(number):
            return _DENIED, ()
        if not math.isfinite(interval_us) or interval_us < -1.0:
            return _DENIED, ()
        interval_s = OFF if interval_us < 0.0 else interval_us * 1e-6
        return _ACCEPTED if self._telemetry.rates.set(number, interval_s) else _DENIED, ()

    def _get_interval(self, message: Any) -> Outcome:
        return self._interval(_whole(message.param1))

    def _request_message(self, message: Any) -> Outcome:
        number = _whole(message.param1)
        if number == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            return self._request_capabilities(message)
        if number == mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
            return self._interval(_whole(message.param2))
        if number is None or not self._telemetry.voice.can_say(number):
            return _DENIED, ()
        newest = self._telemetry.latest.get(number)
        return (_ACCEPTED, (newest,)) if newest else (_DENIED, ())

    def _request_capabilities(self, message: Any) -> Outcome:
        voice = self._telemetry.voice
        capabilities = _CAPABILITIES | (mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2 if voice.version == 2 else 0)
        versions = (_SOFTWARE_VERSION, 0, 0, 0)
        hashes = (_NO_HASH, _NO_HASH, _NO_HASH)
        return _ACCEPTED, (self._build.autopilot_version_encode(capabilities, *versions, *hashes, 0, 0, voice.system),)

    def _interval(self, number: int | None) -> Outcome:
        """MESSAGE_INTERVAL: us, -1 where stopped, 0 for a message that the vehicle does not send."""
        if number is None or number > _LARGEST_ID:
            return _DENIED, ()
        sendable = self._telemetry.voice.can_say(number)
        interval = self._telemetry.rates.interval(number) if sendable else None
        us = 0 if interval is None else -1 if interval < 0.0 else round(interval * 1e6)
        return _ACCEPTED, (self._build.message_interval_encode(number, us),)


def _whole(value: float) -> int | None:
    return int(value) if math.isfinite(value) and value == int(value) and 0 <= value <= 0xFFFFFF else None
