"""What the ground station says of a flight over a bad link, against what the link did to it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from wire_streams import wire_streams

from gcs.recording.reader import Recording
from sim_vehicle.cli.main import main

FLIGHT = ("fly", "--manoeuvre", "cruise", "--duration", "6", "--seed", "2")


def recorded(path: Path, *arguments: str) -> Recording:
    assert main([*FLIGHT, *arguments, "--record", str(path)]) == 0
    return Recording(path)


def frames(recording: Recording) -> list[bytes]:
    """Header and payload of every MAVLink 2 frame, in order of arrival; the rest of the stream must be frames too."""
    stream = b"".join(data for _, data in wire_streams(recording)["simulator"])
    found, at = [], 0
    while at < len(stream):
        assert stream[at] == 0xFD
        end = at + 12 + stream[at + 1]
        found.append(stream[at:end])
        at = end
    return found


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return recorded(tmp_path_factory.mktemp("good") / "f.mcap")


def test_every_frame_lost_is_counted_in_spite_of_late_ones(tmp_path: Path, good: Recording) -> None:
    bad = recorded(tmp_path / "f.mcap", "--fault", "loss=0.05,reorder=0.05,late=0.2:0.02,jitter=0.01")
    sent, came = frames(good), frames(bad)
    assert 0 in [frame[4] for frame in came[:20]]  # the first and the last one came: what is missing lies between
    assert sent[-1] in came
    assert len(sent) - len(came) > 50
    assert sum(bad.lost().values()) == len(sent) - len(came)


def test_a_frame_that_comes_twice_makes_up_for_none(tmp_path: Path, good: Recording) -> None:
    bad = recorded(tmp_path / "f.mcap", "--fault", "duplicate=0.1")
    assert len(frames(bad)) > 1.05 * len(frames(good))
    assert sum(bad.lost().values()) == 0


def test_bytes_that_are_no_frame_are_kept_beside_the_frames(tmp_path: Path, good: Recording) -> None:
    bad = recorded(tmp_path / "f.mcap", "--fault", "garbage=0.05,corrupt=1e-4")
    stream = b"".join(data for _, data in wire_streams(bad)["simulator"])
    alike = [frame for frame in frames(good) if frame[7] != 2 and frame in stream]
    counts = sum(bad.counts().values())
    assert 0.8 * sum(good.counts().values()) < counts < sum(good.counts().values())
    assert abs(len(alike) + 7 - counts) <= 7  # but for SYSTEM_TIME, of which there are seven
    assert len(stream) > sum(map(len, frames(good)))


def test_a_restart_is_seen_by_the_stamps(tmp_path: Path, good: Recording) -> None:
    flight = recorded(tmp_path / "f.mcap", "--fault", "clock-reset=3")
    stamps = flight.columns("HIGHRES_IMU")[0].fields["time_usec"].astype(np.int64)
    assert np.flatnonzero(np.diff(stamps) < 0).tolist() == [149]
    assert (
        sum(flight.lost().values()) <= 256
    )  # the counter starts at 0 again, which one component cannot tell from loss
