"""The real application behind a real server, demanding its token, and a recording to hand in."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from api_bench import START, TOKEN, Bench
from serving import serving
from traffic import Vehicle


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path / "station", token=TOKEN, host="0.0.0.0")
    yield made
    made.station.stop()
    made.catalogue.close()


@pytest.fixture
def url(bench: Bench) -> Iterator[str]:
    with serving(bench.app) as client:
        yield str(client.base_url).rstrip("/")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A second of telemetry as a telemetry log."""
    path = tmp_path / "a flight.tlog"
    frames = Vehicle(3).second()
    stamps = ((START // 1000 + 20_000 * i).to_bytes(8, "big") for i in range(len(frames)))
    path.write_bytes(b"".join(stamp + frame for stamp, frame in zip(stamps, frames, strict=True)))
    return path
