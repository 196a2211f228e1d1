"""A flight while it is being recorded."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.catalogue.flight_table import Flight
from gcs.mavlink.framing import Frames
from gcs.recording.parts import WARNINGS, Metadata, RecordingParts
from gcs.station.same_number import SameNumber
from gcs.station.segmentation import FlightSegmenter
from gcs.station.unarmed_motion import MOVING_M_S, fastest

# So many seconds in which it moves; a gust or a step of GPS is no flight.
_MOVING_S = 3
# First and longest pause between two questions for the board.
_ASK_NS, _ASK_SELDOM_NS = 1_000_000_000, 60_000_000_000
#: What a recording follows in which nobody was heard who is believed.
NOBODY = ""


@dataclass
class LiveFlight:
    """A flight that is being recorded. Times are UTC ns; catalogued_ns: how far the catalogue knows it.

    same_number: whether two vehicles are in it. follows: the flight that this is ground data behind, as long as the
    vehicle neither was armed nor moved.
    board: of the autopilot, None while it has not said it; ask_ns: when to ask it next, and ask_again_ns how long after
    that again.
    """

    id: str
    writer: RecordingParts
    segmenter: FlightSegmenter
    start_ns: int
    end_ns: int
    same_number: SameNumber
    catalogued_ns: int = 0
    follows: str | None = None
    moving_s: set[int] = field(default_factory=set)
    board: str | None = None
    ask_ns: int = 0
    ask_again_ns: int = _ASK_NS

    def look_for_motion(self, frames: Frames, newest_ns: int) -> None:
        """Take what the vehicle has sent: once it moves, this is a flight of its own."""
        if fastest(frames) > MOVING_M_S:
            self.moving_s.add(newest_ns // 1_000_000_000)
        if len(self.moving_s) >= _MOVING_S:
            self.follows = None

    def is_to_ask(self, now_ns: int) -> bool:
        """Whether the vehicle is to be asked now which board it has; each time the next one is due twice as late."""
        if self.board is not None or self.segmenter.system is None or now_ns < self.ask_ns:
            return False
        self.ask_ns = now_ns + self.ask_again_ns
        self.ask_again_ns = min(2 * self.ask_again_ns, _ASK_SELDOM_NS)
        return True

    def entry(self, state: str, reason: str) -> Flight:
        """How the catalogue is to list it."""
        return Flight(
            id=self.id,
            file=self.writer.path.name,
            name=self.writer.path.name,
            source="live",
            state=state,
            system=self.segmenter.system,
            start_ns=self.start_ns,
            end_ns=self.end_ns,
            messages=self.writer.counts.messages - self.writer.lost.messages,
            bytes=self.writer.size,
            end_reason=reason,
            parts=len(self.writer.parts),
            follows=self.follows,
            board=self.board,
        )

    def statistics(self, reason: str) -> Metadata:
        """Metadata of what is known only at the end."""
        counts = self.writer.counts
        warned = {WARNINGS: {"same number": self.same_number.words}} if self.same_number.words else {}
        return warned | {
            "statistics": {
                "messages": str(counts.messages),
                "bytes": str(counts.bytes),
                "raw_bytes": str(counts.raw_bytes),
                "unknown_frames": str(counts.unknown_frames),
                "parts": str(len(self.writer.parts)),
                "end_reason": reason,
            }
        }
