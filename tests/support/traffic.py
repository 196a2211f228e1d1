"""A vehicle for tests: MAVLink 2 by pymavlink, and waiting with a deadline instead of a fixed sleep."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar

from patience import PATIENCE_S
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.links.datagrams import Batch

ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
SECOND = 1_000_000_000
Result = TypeVar("Result")


def wait_until(probe: Callable[[], Result | None], timeout_s: float = PATIENCE_S) -> Result:
    """The first true answer of `probe`; AssertionError when none comes in time."""
    deadline = time.monotonic() + timeout_s
    pause = 0.02
    while True:
        answer = probe()
        if answer:
            return answer
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(pause)
        # What takes long is asked for less often: each question costs the one that answers, too.
        pause = min(1.1 * pause, 0.1)


class Vehicle:
    """Frames of one component with a continuous sequence and a boot clock."""

    def __init__(self, system: int = 1, component: int = 1) -> None:
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.boot_ms = 0

    def frame(self, message: Any) -> bytes:
        """One frame as it goes over the wire."""
        data = bytes(message.pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256
        return data

    def attitude(self, roll: float = 0.0) -> bytes:
        """ATTITUDE with the present boot time."""
        return self.frame(mavlink.MAVLink_attitude_message(self.boot_ms, roll, 0.0, 0.0, 0.0, 0.0, 0.0))

    def heartbeat(self, armed: bool = True) -> bytes:
        """HEARTBEAT of a fixed wing."""
        flags = ARMED if armed else 0
        return self.frame(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_FIXED_WING, 0, flags, 0, 4, 3))

    def system_time(self) -> bytes:
        """SYSTEM_TIME without UTC."""
        return self.frame(mavlink.MAVLink_system_time_message(0, self.boot_ms))

    def second(self, armed: bool = True, rate_hz: int = 50) -> list[bytes]:
        """One second of telemetry, one datagram per entry."""
        datagrams = [self.heartbeat(armed), self.system_time()]
        for _ in range(rate_hz):
            datagrams.append(self.attitude())
            self.boot_ms += 1000 // rate_hz
        return datagrams


def ground_station_heartbeat(system: int = 255) -> bytes:
    """HEARTBEAT of a ground station."""
    sender = Vehicle(system, 190)
    return sender.frame(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))


def batch(datagrams: list[bytes], start_ns: int, span_ns: int = SECOND) -> Batch:
    """The datagrams spread evenly over a span from `start_ns`."""
    step = span_ns // max(len(datagrams), 1)
    return Batch.of([(data, start_ns + i * step) for i, data in enumerate(datagrams)])


def decode(data: bytes) -> list[Any]:
    """Messages that pymavlink finds in the bytes."""
    return list(mavlink.MAVLink(None).parse_buffer(data) or [])
