"""What the vehicle answers: time, parameters, commands, and an empty mission, as the MAVLink services describe them.

https://mavlink.io/en/services/: timesync, parameter, command, ping, mission.
"""

from __future__ import annotations

import logging
import os
import struct
from collections.abc import Callable
from typing import Any

os.environ.setdefault("MAVLINK20", "1")

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.flight.arming import Arming
from sim_vehicle.mavlink.command_service import Commands
from sim_vehicle.mavlink.frame_encoder import COMPONENT
from sim_vehicle.mavlink.parameter_service import LARGEST_HZ, Onboard, Parameter
from sim_vehicle.mavlink.telemetry import Telemetry

_log = logging.getLogger(__name__)

# Sequence, session, opcode, size, opcode asked, burst complete, padding, offset:
# https://mavlink.io/en/services/ftp.html
_FTP_HEADER = struct.Struct("<HBBBBBxI")
_FTP_NAK, _FTP_UNKNOWN_COMMAND = 129, b"\x07"


class Protocol:
    """The answers of one vehicle.

    telemetry: what it says of itself; answers go out by the same voice, and the caller takes them from there.
    clock_s: what the vehicle's clock shows now, s since its boot.
    """

    def __init__(self, telemetry: Telemetry, onboard: Onboard, arming: Arming, clock_s: Callable[[], float]) -> None:
        self._telemetry = telemetry
        self._voice = telemetry.voice
        self._build = telemetry.voice.build
        self._onboard = onboard
        self._commands = Commands(telemetry, arming)
        self._clock_s = clock_s
        self._handlers: dict[str, Callable[[Any], None]] = {
            "TIMESYNC": self._timesync,
            "PING": self._ping,
            "PARAM_REQUEST_LIST": self._parameter_list,
            "PARAM_REQUEST_READ": self._parameter_read,
            "PARAM_SET": self._parameter_set,
            "COMMAND_LONG": self._command,
            "COMMAND_INT": self._command,
            "REQUEST_DATA_STREAM": self._data_stream,
            "FILE_TRANSFER_PROTOCOL": self._no_files,
            "MISSION_REQUEST_LIST": self._mission_list,
            "MISSION_REQUEST": self._no_such_item,
            "MISSION_REQUEST_INT": self._no_such_item,
            "MISSION_CLEAR_ALL": self._mission_clear,
            "MISSION_COUNT": self._mission_upload,
        }

    def answer(self, message: Any) -> None:
        """Say what a message from a ground station asks for; nothing where it is for another, or asks nothing.

        An answer that no message can carry is left out and logged: the vehicle hears on.
        """
        handler = self._handlers.get(message.get_type())
        if not handler or message.get_srcSystem() == self._voice.system:
            return
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        if system in (0, self._voice.system) and component in (0, COMPONENT):
            try:
                handler(message)
            except (ArithmeticError, ValueError, struct.error) as error:
                _log.warning("%s from %d/%d: no answer: %s", message.get_type(), *_sender(message), error)

    # --- time ---

    def _timesync(self, message: Any) -> None:
        if message.tc1 == 0:  # else an answer, to another's question
            self._voice.say(self._build.timesync_encode(round(self._clock_s() * 1e9), message.ts1))

    def _ping(self, message: Any) -> None:
        if message.target_system == 0 and message.target_component == 0:
            self._voice.say(self._build.ping_encode(message.time_usec, message.seq, *_sender(message)))

    # --- parameters ---

    def _send_value(self, parameter: Parameter | None) -> None:
        if parameter:
            name = parameter.name.encode("ascii")
            kind = mavlink.MAV_PARAM_TYPE_REAL32
            reply = self._build.param_value_encode(name, parameter.value, kind, len(self._onboard), parameter.index)
            self._voice.say(reply)

    def _parameter_list(self, message: Any) -> None:
        for parameter in self._onboard.all():
            self._send_value(parameter)

    def _parameter_read(self, message: Any) -> None:
        by_name = message.param_index < 0
        self._send_value(
            self._onboard.get(_text(message.param_id)) if by_name else self._onboard.at(message.param_index)
        )

    def _parameter_set(self, message: Any) -> None:
        self._send_value(self._onboard.set(_text(message.param_id), message.param_value))

    # --- commands ---

    def _command(self, message: Any) -> None:
        """Acknowledge first, then say what was asked for."""
        result, asked = self._commands.run(message)
        self._voice.say(self._build.command_ack_encode(message.command, result, 0, 0, *_sender(message)))
        for reply in asked:
            self._voice.say(reply)

    def _data_stream(self, message: Any) -> None:
        hz = min(float(message.req_message_rate), LARGEST_HZ) if message.start_stop else 0.0
        self._onboard.stream(message.req_stream_id, hz)

    def _no_files(self, message: Any) -> None:
        """Refuse at once: a ground station that tries files first then lists the parameters one by one."""
        asked = bytes(message.payload[: _FTP_HEADER.size])
        sequence, session, opcode, *_ = _FTP_HEADER.unpack(asked)
        refusal = _FTP_HEADER.pack((sequence + 1) & 0xFFFF, session, _FTP_NAK, 1, opcode, 0, 0) + _FTP_UNKNOWN_COMMAND
        payload = refusal.ljust(len(message.payload), b"\0")
        self._voice.say(self._build.file_transfer_protocol_encode(0, *_sender(message), payload))

    # --- a mission: there is none, and none can be put aboard ---

    def _mission_list(self, message: Any) -> None:
        self._voice.say(self._build.mission_count_encode(*_sender(message), 0, message.mission_type))

    def _no_such_item(self, message: Any) -> None:
        self._acknowledge_mission(message, mavlink.MAV_MISSION_INVALID_SEQUENCE)

    def _mission_clear(self, message: Any) -> None:
        self._acknowledge_mission(message, mavlink.MAV_MISSION_ACCEPTED)

    def _mission_upload(self, message: Any) -> None:
        nothing = message.count == 0
        self._acknowledge_mission(message, mavlink.MAV_MISSION_ACCEPTED if nothing else mavlink.MAV_MISSION_UNSUPPORTED)

    def _acknowledge_mission(self, message: Any, result: int) -> None:
        self._voice.say(self._build.mission_ack_encode(*_sender(message), result, message.mission_type))


def _sender(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def _text(name: Any) -> str:
    text = name if isinstance(name, str) else bytes(name).decode("ascii", "replace")
    return text.rstrip("\0")
