"""A stand-in for ArduPilot's SITL, written from the description of its JSON interface: frames out, lines in.

It reads lines as ArduPilot does: the last whole line between two line feeds, each value behind its quoted key and a
colon, without a parser of JSON.
"""

from __future__ import annotations

import re
import socket
import struct

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_NUMBER = r"[-+0-9.eE]+"


class Sitl:
    """One autopilot's side of the link. heard: fields of the last line."""

    def __init__(self, address: tuple[str, int], rate_hz: int = 400, outputs: int = 16) -> None:
        self.address, self.rate_hz, self.outputs = address, rate_hz, outputs
        self.number = 0
        self.heard: dict[str, Array] = {}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(10.0)

    def frame(self, pwm: dict[int, float]) -> bytes:
        """Servo outputs by number, us."""
        magic = 18458 if self.outputs == 16 else 29569
        pulses = [round(pwm.get(output, 0.0)) for output in range(1, self.outputs + 1)]
        return struct.pack(f"<HHI{self.outputs}H", magic, self.rate_hz, self.number, *pulses)

    def exchange(self, pwm: dict[int, float], *, again: bool = False) -> dict[str, Array]:
        """Send a frame, wait for the line. again: the same frame once more, as SITL does that has heard nothing."""
        self.number += not again
        self._socket.sendto(self.frame(pwm), self.address)
        data, _ = self._socket.recvfrom(65536)
        self.heard = self.read(data)
        return self.heard

    def send(self, data: bytes) -> None:
        """Anything else."""
        self._socket.sendto(data, self.address)

    @staticmethod
    def read(data: bytes) -> dict[str, Array]:
        """The fields of a line."""
        text = data.decode("ascii")
        assert text.startswith("\n")
        assert text.endswith("\n")
        line = text[1:-1]
        assert "\n" not in line
        found = {}
        for key in ("gyro", "accel_body", "position", "velocity", "quaternion", "velocity_wind"):
            count = 4 if key == "quaternion" else 3
            at = line.index(f'"{key}":') + len(key) + 3
            match = re.match(r"\[" + r", *".join([f"({_NUMBER})"] * count) + r"\]", line[at:])
            assert match is not None, line
            found[key] = np.array([float(one) for one in match.groups()])
        match = re.match(f"({_NUMBER})", line[line.index('"timestamp":') + 12 :])
        assert match is not None
        found["timestamp"] = np.array([float(match[1])])
        return found

    def close(self) -> None:
        self._socket.close()


def euler(q: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw of a quaternion from earth to body, scalar first."""
    w, x, y, z = q
    return (
        float(np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))),
        float(np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))),
        float(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))),
    )
