"""A ground station that asks: a UDP socket and pymavlink, which waits for answers with a deadline."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from typing import Any

from patience import PATIENCE_S
from pymavlink.dialects.v20 import ardupilotmega as mavlink

STATION = 255


class Collected:
    """The file that pymavlink writes frames to."""

    def __init__(self) -> None:
        self.data = b""

    def write(self, frame: bytes) -> None:
        self.data += bytes(frame)

    def take(self) -> bytes:
        data, self.data = self.data, b""
        return data


class Asking:
    """Speaks to whoever spoke last on a UDP port of its own."""

    def __init__(self, key: bytes | None = None) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(1.0)
        self.out = Collected()
        self.mav = mavlink.MAVLink(self.out, srcSystem=STATION, srcComponent=mavlink.MAV_COMP_ID_MISSIONPLANNER)
        self._parser = mavlink.MAVLink(None)
        if key:
            for link in (self.mav, self._parser):
                link.signing.secret_key = key
            self.mav.signing.sign_outgoing = True
            self.mav.signing.timestamp = round((time.time() - 1_420_070_400) * 1e5)
        self.peer: Any = None

    @property
    def url(self) -> str:
        return f"udpout:127.0.0.1:{self.socket.getsockname()[1]}"

    def receive(self) -> list[mavlink.MAVLink_message]:
        """Messages of the next datagram; none where nothing comes for a second."""
        try:
            data, self.peer = self.socket.recvfrom(2048)
        except TimeoutError:
            return []
        return list(self._parser.parse_buffer(data) or [])

    def send(self, message: Any = None) -> None:
        """Send a message made by `self.mav`, or else what it has packed."""
        if message is not None:
            self.mav.send(message)
        self.socket.sendto(self.out.take(), self.peer)

    def forget(self) -> None:
        """Drop everything that has come up to now."""
        self.socket.setblocking(False)
        try:
            while True:
                self._parser.parse_buffer(self.socket.recv(2048))
        except BlockingIOError:
            pass
        self.socket.settimeout(1.0)

    def wait_for(self, wanted: Callable[[Any], bool]) -> Any:
        """The next message of which `wanted` is true; AssertionError when none comes in time."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            for message in self.receive():
                if wanted(message):
                    return message
        raise AssertionError("no such message came")

    def ask(self, question: Any, kind: str, system: int = 1) -> Any:
        """Send a question, and the first message of `kind` that `system` then sends."""
        self.forget()
        self.send(question)
        return self.wait_for(lambda m: m.get_type() == kind and m.get_srcSystem() == system)

    def command(self, number: int, *values: float, system: int = 1) -> int:
        """Send a COMMAND_LONG: the result that is acknowledged."""
        parameters = (*values, *(0.0,) * (7 - len(values)))
        question = self.mav.command_long_encode(system, 1, number, 0, *parameters)
        acknowledged = self.ask(question, "COMMAND_ACK", system)
        assert acknowledged.command == number
        assert (acknowledged.target_system, acknowledged.target_component) == (STATION, self.mav.srcComponent)
        return int(acknowledged.result)

    def close(self) -> None:
        self.socket.close()
