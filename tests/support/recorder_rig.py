"""A recorder on a clock that the test holds."""

from pathlib import Path

from traffic import SECOND, batch
from wire_streams import wire_streams

from gcs.catalogue.flight_table import Flight
from gcs.catalogue.store import Catalogue
from gcs.mavlink.dialect import Dialect
from gcs.recording.reader import Recording
from gcs.station.recorder import FlightRecorder

START = 1_800_000_000 * SECOND
LINK = "udpin:0.0.0.0:14550"


class Rig:
    """A recorder with a clock of its own."""

    def __init__(self, folder: Path, key: bytes | None = None, *, require_signed: bool = False) -> None:
        self.folder = folder
        self.catalogue = Catalogue(folder / "catalogue.sqlite")
        self.ended: list[Flight] = []
        self.recorder = FlightRecorder(
            folder,
            Dialect.load(),
            self.catalogue,
            silence_s=10.0,
            disarm_s=2.0,
            on_flight_end=self.ended.append,
            key=key,
            require_signed=require_signed,
        )
        self.now = START
        self.sent: dict[str, bytes] = {}

    def feed(self, datagrams: list[bytes], link: str = LINK, span_ns: int = SECOND) -> None:
        """Hand the datagrams over in batches of five, as they would come in time."""
        step = span_ns // len(datagrams)
        for i in range(0, len(datagrams), 5):
            part = datagrams[i : i + 5]
            self.recorder.feed(link, batch(part, self.now + i * step, step * len(part)))
        self.now += span_ns
        self.recorder.tick(self.now)
        self.recorder.settle()
        self.sent[link] = self.sent.get(link, b"") + b"".join(datagrams)

    def wait(self, seconds: float) -> None:
        """Let time pass without any bytes."""
        end = self.now + round(seconds * SECOND)
        while self.now < end:
            self.now = min(self.now + SECOND // 4, end)
            self.recorder.tick(self.now)
        self.recorder.settle()

    def finish(self) -> list[Flight]:
        """All flights, and what was recorded on the ground behind them, in the order of their start."""
        self.recorder.close(self.now)
        return list(reversed(self.catalogue.flights(ground=True)))

    def recording(self, flight: Flight) -> Recording:
        return Recording(self.folder / flight.file)

    def stream(self, link: str = LINK) -> bytes:
        """The link's bytes from all recordings, one after the other."""
        return b"".join(
            data
            for flight in reversed(self.catalogue.flights(ground=True))
            for name, pieces in wire_streams(self.recording(flight)).items()
            if name == link
            for _, data in pieces
        )
