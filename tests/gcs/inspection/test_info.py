"""What `gcs info` says of rates, gaps, links, attachments and metadata."""

import json
from pathlib import Path

import numpy as np
import pytest
from mavlink_frames import Sender

from gcs.cli import main
from gcs.inspection.pace import Pace
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import scan
from gcs.recording.writer import McapWriter

START = 1_790_000_000_000_000_000
SECOND = 1_000_000_000


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """10 Hz over two links for 20 s, but for a gap from 5.0 to 8.5 s; the second link falls silent at 12 s."""
    dialect, sender = Dialect.load(), Sender(seed=1)
    path = tmp_path / "flight.mcap"
    with McapWriter(path, dialect) as writer:
        writer.metadata("versions", {"writer": "9.8"})
        for i in range(201):
            if 50 < i < 85:
                continue
            frame = sender.send("HEARTBEAT" if i == 100 else "ATTITUDE", time_boot_ms=100 * i).frame
            buffer = np.frombuffer(frame, np.uint8)
            for link in ("radio", "wifi")[: 2 if i <= 120 else 1]:
                at = START + i * SECOND // 10 + (1000 if link == "wifi" else 0)
                writer.write(link, buffer, scan(buffer, dialect, final=True), at)
        writer.attach("mine.toml", "application/toml", b"name = 'x'")
    return path


def test_rates_and_gaps_are_those_of_the_flight(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(flight), "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    topics = {entry["topic"]: entry for entry in info["topics"]}
    attitude = topics["/mavlink/1/1/ATTITUDE"]
    assert attitude["rate_hz"] == pytest.approx(165 / 20.0, rel=1e-3)  # 166 messages, each counted once
    assert attitude["longest_gap_s"] == pytest.approx(3.5, abs=1e-5)
    assert attitude["longest_gap_at_s"] == pytest.approx(5.0, abs=1e-5)
    assert topics["/mavlink/1/1/HEARTBEAT"]["longest_gap_s"] == pytest.approx(1e-6)
    links = {entry["link"]: entry for entry in info["links"]}
    assert (links["radio"]["messages"], links["wifi"]["messages"]) == (167, 87)
    assert links["wifi"]["duration_s"] == pytest.approx(12.0)
    assert links["radio"]["longest_silence_at_s"] == pytest.approx(5.0)
    assert info["attachments"] == [{"name": "mine.toml", "media_type": "application/toml", "size_bytes": 10}]
    assert info["metadata"]["versions"] == {"writer": "9.8"}


def test_the_text_names_gaps_attachments_and_metadata(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(flight)]) == 0
    text = capsys.readouterr().out
    assert "3.50 at 5.0" in text
    assert "wifi: 87 messages" in text
    assert "attached: mine.toml, 10 bytes" in text
    assert "versions: writer = 9.8" in text


def test_a_gap_between_two_parts_of_a_file_counts() -> None:
    pace = Pace()
    for part in ([0, 5], [], [30, 31], [33]):
        pace.add(np.array(part, np.int64) * SECOND)
    assert (pace.count, pace.duration_s) == (5, 33.0)
    assert pace.gap(-SECOND) == (25.0, 6.0)
    assert Pace().gap(0) == (None, None)
    together = Pace()
    together.add(np.full(3, 7 * SECOND))
    assert together.gap(SECOND) == (0.0, 6.0)
