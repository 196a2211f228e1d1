"""The ground station's writer, lent to the simulator: it records what it sends as if a link had received it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from gcs.errors import RecordingError
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import Framer
from gcs.recording.writer import McapWriter
from sim_vehicle.errors import SinkError

LINK_NAME = "simulator"


@contextmanager
def _as_sink() -> Iterator[None]:
    """What a recording cannot do, in the simulator's own terms."""
    try:
        yield
    except RecordingError as error:
        raise SinkError(str(error)) from None


class McapSink:
    """Takes the bytes of one vehicle and writes a recording. Raises SinkError where that cannot be done."""

    def __init__(self, path: str) -> None:
        dialect = Dialect.load()
        self._framer = Framer(dialect)
        with _as_sink():
            self._writer = McapWriter(path, dialect)
        self._last_ns = 0

    def write(self, data: bytes, utc_ns: int) -> None:
        """Record bytes sent at `utc_ns` (UTC, ns)."""
        buffer, frames = self._framer.feed(data)
        self._last_ns = utc_ns
        if buffer.size:
            with _as_sink():
                self._writer.write(LINK_NAME, buffer, frames, utc_ns)

    def close(self) -> None:
        """Write what is left and close the file."""
        buffer, frames = self._framer.flush()
        with _as_sink():
            if buffer.size:
                self._writer.write(LINK_NAME, buffer, frames, self._last_ns)
            self._writer.close()


def open_mcap_sink(path: str) -> McapSink:
    """Create the recording `path`; SinkError if that cannot be done."""
    return McapSink(path)
