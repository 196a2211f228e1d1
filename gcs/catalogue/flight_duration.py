"""How long a flight was by the vehicle's own clock, which differs in a flight sent faster than flown."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gcs.errors import GcsError
from gcs.flights.streams import load_streams
from gcs.recording.reader import Recording

# Messages with a stamp that nearly every vehicle sends, the commonest first: one of them suffices.
_STAMPED = ("ATTITUDE", "HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "GLOBAL_POSITION_INT", "LOCAL_POSITION_NED")


def vehicle_seconds(paths: Sequence[Path], system: int | None) -> float | None:
    """Seconds between the vehicle's first and last stamp; None where no message of it carries one."""
    if system is None:
        return None
    try:
        recording = Recording(list(paths))
        there = {topic.rsplit("/", 1)[-1] for topic in recording.counts()}
        message = next((name for name in _STAMPED if name in there), None)
        return load_streams(recording, [message], system).duration_s if message else None
    except GcsError:
        return None
