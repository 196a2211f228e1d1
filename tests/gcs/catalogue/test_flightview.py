"""Summaries of recordings: read once as long as the file stays as it is."""

from pathlib import Path

import pytest
from recorded_stream import DIALECT, Stream

from gcs.catalogue.flight_table import Flight
from gcs.catalogue.flightview import FlightViewer
from gcs.recording.container import Container
from gcs.recording.records import ChunkInfo
from gcs.recording.writer import McapWriter
from gcs.settings import Settings


def test_a_summary_reads_the_recording_again_only_when_it_has_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[int] = []
    usual = Container.content_of

    def counted(self: Container, chunk: ChunkInfo) -> bytes | None:
        read.append(chunk.offset)
        return usual(self, chunk)

    monkeypatch.setattr(Container, "content_of", counted)
    settings = Settings(data=tmp_path)
    settings.flights.mkdir()
    viewer = FlightViewer(settings)
    flight = Flight("a", "a.mcap", "a", "live", "recording", 1, 1, 2, 0, 0)
    stream = Stream()
    with McapWriter(settings.flights / "a.mcap", DIALECT, chunk_seconds=0.1) as writer:
        stream.feed(writer, 100)
        writer.flush()
        first = viewer.summary(flight)
        assert sum(first["topics"].values()) == 100
        assert len(read) > 0
        read.clear()
        assert viewer.summary(flight) == first
        assert read == []
        stream.feed(writer, 100)
        writer.flush()
        assert sum(viewer.summary(flight)["topics"].values()) == 200
        assert len(read) > 0
