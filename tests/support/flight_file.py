"""Recordings made message by message with pymavlink's own encoder."""

from __future__ import annotations

import os
from pathlib import Path
from types import TracebackType

os.environ.setdefault("MAVLINK20", "1")

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import Framer
from gcs.recording.reader import Recording
from gcs.recording.writer import McapWriter

UTC_NS = 1_790_000_000_000_000_000
DELAY_NS = 2_000_000


class FlightFile:
    """A recording under construction; every (link, system, component) numbers its frames itself."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._dialect = Dialect.load()
        self._writer = McapWriter(path, self._dialect)
        self._framers: dict[str, Framer] = {}
        self._senders: dict[tuple[str, int, int], mavlink.MAVLink] = {}

    def __enter__(self) -> FlightFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.close()

    def open(self) -> Recording:
        """The finished recording."""
        return Recording(self._path)

    def frame(
        self, message: mavlink.MAVLink_message, system: int = 1, component: int = 1, link: str = "radio"
    ) -> bytes:
        """The message as the next frame of that sender."""
        key = (link, system, component)
        sender = self._senders.setdefault(key, mavlink.MAVLink(None, srcSystem=system, srcComponent=component))
        data = bytes(message.pack(sender))
        sender.seq = (sender.seq + 1) % 256
        return data

    def put(self, time_s: float, frame: bytes, link: str = "radio", delay_ns: int = DELAY_NS) -> None:
        """Record a frame as received `delay_ns` after `time_s` seconds of the vehicle's time since boot."""
        buffer, frames = self._framers.setdefault(link, Framer(self._dialect)).feed(frame)
        self._writer.write(link, buffer, frames, UTC_NS + round(time_s * 1e9) + delay_ns)

    def send(
        self,
        time_s: float,
        message: mavlink.MAVLink_message,
        *,
        system: int = 1,
        component: int = 1,
        link: str = "radio",
    ) -> None:
        """Record one message as sent at `time_s`."""
        self.put(time_s, self.frame(message, system, component, link), link)
