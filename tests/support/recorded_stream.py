"""A vehicle's frames as a slow link brings them to a writer of recordings, and what a recording gives back."""

from pathlib import Path

from mavlink_frames import Sender
from wire_streams import wire_streams

from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import Framer
from gcs.recording.reader import Recording
from gcs.recording.writer import McapWriter

DIALECT = Dialect.load()
START = 1_760_000_000_000_000_000
SECOND = 1_000_000_000
NAMES = ("ATTITUDE", "HIGHRES_IMU", "GPS_RAW_INT", "STATUSTEXT")


class Stream:
    """Frames of one vehicle with random contents, written 100 a second by the clock of the test."""

    def __init__(self, seed: int = 1) -> None:
        self.sender = Sender(seed=seed)
        self.framer = Framer(DIALECT)
        self.time = START
        self.frames: list[bytes] = []

    def feed(self, writer: McapWriter, count: int, link: str = "udp") -> None:
        """Write the next frames, each in a batch of its own as a slow link brings them."""
        for _ in range(count):
            frame = self.sender.send(NAMES[len(self.frames) % len(NAMES)]).frame
            self.frames.append(frame)
            self.time += SECOND // 100
            writer.write(link, *self.framer.feed(frame), self.time)

    @property
    def bytes(self) -> bytes:
        return b"".join(self.frames)


def stream_of(path: Path, link: str = "udp") -> bytes:
    return b"".join(data for _, data in wire_streams(Recording(path))[link])
