"""A busy link while live identification runs: whatever the live side manages, the recording holds every datagram."""

from __future__ import annotations

import socket
import time
from pathlib import Path
from typing import Any

from processes import ANSWERS, free_port, service
from rest import asked
from traffic import Vehicle, wait_until

from gcs.recording.reader import Recording

RATE = 3000.0  # datagrams a second; a vehicle sends some hundreds
SECONDS = 5
TURN_S = 0.005


def sent(port: int, frames: list[bytes]) -> int:
    """Send the frames, one in each datagram, at RATE; how many were sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.connect(("127.0.0.1", port))
        number, begin = 0, time.monotonic()
        while number < len(frames):
            due = min(round((time.monotonic() - begin) * RATE), len(frames), number + round(4 * RATE * TURN_S))
            for frame in frames[number:due]:
                sock.send(frame)
            number = due
            time.sleep(TURN_S)
    return number


def test_recording_loses_nothing_while_live_identification_runs(tmp_path: Path) -> None:
    vehicle, frames = Vehicle(), list[bytes]()
    while len(frames) < RATE * SECONDS:
        frames += vehicle.second()
    port = free_port()
    options = ("--connect", f"udpin:127.0.0.1:{port}", "--vehicle", "iitb-mav", "--no-identify", "--data", tmp_path)
    with service(*options) as url:

        def live() -> Any:
            return asked(f"{url}/api/live")

        wait_until(lambda: live()["process"]["state"] == "running")
        count = sent(port, frames)
        wait_until(lambda: "phi" in live()["signals"])
        wait_until(lambda: live()["links"][0]["frames"] == count)
        assert live()["links"][0]["dropped"] == 0
    recordings = [Recording(path) for path in tmp_path.rglob("*.mcap")]
    kept = [n for one in recordings for topic, n in one.counts().items() if not topic.endswith(ANSWERS)]
    assert sum(kept) == count
    assert sum(lost for one in recordings for lost in one.lost().values()) == 0
