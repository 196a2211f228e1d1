"""A flight while it is being recorded."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.catalogue.flight_table import Flight
from gcs.recording.parts import Metadata, RecordingParts
from gcs.station.segmentation import FlightSegmenter


@dataclass
class LiveFlight:
    """A flight that is being recorded. Times are UTC ns; catalogued_ns: how far the catalogue knows it."""

    id: str
    writer: RecordingParts
    segmenter: FlightSegmenter
    start_ns: int
    end_ns: int
    catalogued_ns: int = 0

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
        )

    def statistics(self, reason: str) -> Metadata:
        """Metadata of what is known only at the end."""
        counts = self.writer.counts
        return {
            "statistics": {
                "messages": str(counts.messages),
                "bytes": str(counts.bytes),
                "raw_bytes": str(counts.raw_bytes),
                "unknown_frames": str(counts.unknown_frames),
                "parts": str(len(self.writer.parts)),
                "end_reason": reason,
            }
        }
