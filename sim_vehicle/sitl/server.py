"""The UDP side of an autopilot's simulation."""

from __future__ import annotations

import socket
from collections.abc import Callable
from dataclasses import dataclass

from sim_vehicle.errors import SinkError
from sim_vehicle.sitl.json_interface import ServoFrame, answer, read_frame
from sim_vehicle.sitl.physics import AutopilotFlight

_WAIT_S = 0.2  # so that Ctrl-C is heard
_LARGEST = 4096


@dataclass
class Counts:
    """What has come and gone."""

    frames: int = 0
    again: int = 0
    lost: int = 0
    strange: int = 0
    restarts: int = 0

    def __str__(self) -> str:
        return f"{self.frames} steps, {self.again} asked for again, {self.lost} lost, {self.restarts} restarts"


class SitlServer:
    """Answers the frames of one SITL; who restarts it gets a flight that begins anew."""

    def __init__(self, flight: AutopilotFlight, host: str, port: int, say: Callable[[str], None]) -> None:
        """Raises SinkError where the port cannot be had."""
        self._flight, self._say = flight, say
        self.counts = Counts()
        self._last: ServoFrame | None = None
        self._reply = b""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise SinkError(f"UDP {host}:{port}: {error.strerror or error}; give another port with --listen") from None
        self._socket.settimeout(_WAIT_S)

    @property
    def address(self) -> tuple[str, int]:
        """Host and port it listens at."""
        host, port = self._socket.getsockname()
        return str(host), int(port)

    def serve(self, stop: Callable[[], bool] = lambda: False) -> None:
        """Answer until `stop` says so."""
        while not stop():
            try:
                datagram, peer = self._socket.recvfrom(_LARGEST)
            except TimeoutError:
                continue
            except ConnectionError:
                continue  # the other side has closed its port
            reply = self.reply(datagram)
            if reply:
                self._socket.sendto(reply, peer)

    def reply(self, datagram: bytes) -> bytes:
        """The answer to a datagram; nothing to what is no frame."""
        frame = read_frame(datagram)
        if frame is None:
            self.counts.strange += 1
            if self.counts.strange == 1:
                self._say(f"a datagram of {len(datagram)} bytes is no servo frame of SITL: left out")
            return b""
        last = self._last
        if last is not None and frame.number == last.number and self._reply:
            self.counts.again += 1
            return self._reply
        if last is None:
            self._say(f"SITL has connected: {frame.rate_hz} steps a second, {len(frame.pwm)} outputs")
        elif frame.number < last.number:
            self.counts.restarts += 1
            self._say("SITL has started anew: the aircraft stands on the ground again")
            self._flight.restart()
        else:
            self.counts.lost += frame.number - last.number - 1
        self.counts.frames += 1
        self._last = frame
        motion = self._flight.step(frame.pwm, 1.0 / frame.rate_hz)
        wind = self._flight.wind.at(float(-motion.position[2]))
        self._reply = answer(motion, (float(wind[0]), float(wind[1]), float(wind[2])))
        return self._reply

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()
