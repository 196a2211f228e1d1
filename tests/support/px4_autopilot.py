"""A stand-in for PX4's SITL, written from the description of its simulator interface: it connects and answers sensors.

Frames are taken apart by hand, by the field order of MAVLink's common dialect; what it sends is packed by pymavlink.
"""

from __future__ import annotations

import socket
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common

Array = NDArray[np.float64]
SENSOR, GPS, TRUTH, HEARTBEAT = 107, 113, 115, 0


class Px4:
    """One autopilot's side of the link. lockstep: as it says of itself."""

    def __init__(self, address: tuple[str, int], *, lockstep: bool = True) -> None:
        self._socket = socket.create_connection(address, timeout=10.0)
        self._flags = 1 if lockstep else 0
        self._build = common.MAVLink(None, srcSystem=1, srcComponent=1)
        self._left = b""
        # By message id, the newest of each, and how many came.
        self.newest: dict[int, dict[str, Any]] = {}
        self.count: dict[int, int] = {}

    def sensors(self) -> dict[str, Any]:
        """Read up to the next HIL_SENSOR and what came with it."""
        before = self.count.get(SENSOR, 0)
        while self.count.get(SENSOR, 0) == before:
            data = self._socket.recv(65536)
            if not data:
                raise ConnectionError("the simulator has gone")
            self._left += data
            self._take()
        return self.newest[SENSOR]

    def is_silent(self, seconds: float) -> bool:
        """Whether nothing comes for so long."""
        self._socket.settimeout(seconds)
        try:
            return not self._socket.recv(1, socket.MSG_PEEK)
        except TimeoutError:
            return True
        finally:
            self._socket.settimeout(10.0)

    def answer(self, controls: dict[int, float], *, armed: bool = True) -> None:
        """Actuators by output, -1 to 1, of motors 0 to 1."""
        values = [controls.get(output, 0.0) for output in range(1, 17)]
        time_us = self.newest[SENSOR]["time_us"]
        message = self._build.hil_actuator_controls_encode(time_us, values, 128 if armed else 0, self._flags)
        self._socket.sendall(message.pack(self._build))

    def exchange(self, controls: dict[int, float], *, armed: bool = True) -> dict[str, Any]:
        """Answer, and read the next sensors."""
        self.answer(controls, armed=armed)
        return self.sensors()

    def send(self, data: bytes) -> None:
        self._socket.sendall(data)

    def close(self) -> None:
        self._socket.close()

    def _take(self) -> None:
        while len(self._left) >= 12:
            assert self._left[0] == 0xFD
            length = self._left[1] + 12
            if len(self._left) < length:
                return
            frame, self._left = self._left[:length], self._left[length:]
            number = int.from_bytes(frame[7:10], "little")
            self.count[number] = self.count.get(number, 0) + 1
            self.newest[number] = _fields(number, frame[10:-2])


def _fields(number: int, payload: bytes) -> dict[str, Any]:
    if number == SENSOR:
        whole = payload.ljust(65, b"\0")
        values = struct.unpack("<Q13fI", whole[:64])
        return {
            "time_us": values[0], "force": np.array(values[1:4]), "rates": np.array(values[4:7]),
            "field": np.array(values[7:10]), "pressure": values[10], "pitot": values[11], "altitude": values[12],
            "temperature": values[13], "updated": values[14],
        }  # fmt: skip
    if number == GPS:
        whole = payload.ljust(36, b"\0")
        time_us, lat, lon, alt, eph, epv, vel, vn, ve, vd, cog, fix, seen = struct.unpack("<QiiiHHHhhhHBB", whole[:36])
        return {"time_us": time_us, "lat": lat / 1e7, "lon": lon / 1e7, "alt": alt / 1e3,
                "velocity": np.array([vn, ve, vd]) / 100.0, "speed": vel / 100.0, "course": cog / 100.0, "fix": fix,
                "seen": seen, "accuracy": (eph, epv)}  # fmt: skip
    if number == TRUTH:
        whole = payload.ljust(64, b"\0")
        values = struct.unpack("<Q4f3fiiihhhHHhhh", whole[:64])
        return {
            "time_us": values[0], "quaternion": np.array(values[1:5]), "rates": np.array(values[5:8]),
            "alt": values[10] / 1e3, "velocity": np.array(values[11:14]) / 100.0, "airspeed": values[15] / 100.0,
        }  # fmt: skip
    return {}
