"""A disk that takes no more: what is there stays whole, it is said once, and recording goes on when there is room."""

import os
import resource
import shutil
import signal
import socket
import subprocess
from collections import namedtuple
from pathlib import Path

import httpx
import pytest
from patience import PATIENCE_S
from processes import free_port, start
from recorder_rig import LINK, Rig
from traffic import Vehicle, wait_until
from wire_streams import wire_streams

from gcs.recording.reader import Recording

pytestmark = pytest.mark.whole_flight

Usage = namedtuple("Usage", "total used free")
MEGABYTE = 1 << 20


def disk_with(free: int) -> os.statvfs_result:
    """What the system tells of a disk with so many bytes left."""
    return os.statvfs_result((4096, 4096, 10**6, 10**6, free // 4096, 9, 9, 9, 0, 255))


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


def test_below_the_reserve_a_flight_ends_and_the_next_begins_when_there_is_room(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    vehicle = Vehicle()
    rig.feed(vehicle.second())
    wait_until(lambda: sum(path.stat().st_size for path in rig.folder.glob("*.mcap")) > 1000)
    free = 10 * MEGABYTE
    monkeypatch.setattr(
        os, "fstatvfs", lambda handle: os.statvfs_result((4096, 4096, 9, 9, free // 4096, 9, 9, 9, 0, 255))
    )
    monkeypatch.setattr(shutil, "disk_usage", lambda path: Usage(free, 0, free))
    while rig.recorder.live_flights():  # the thread that writes tells a moment later
        rig.feed(vehicle.second())
    for _ in range(3):
        rig.feed(vehicle.second())
    assert "reserve" in rig.recorder.state.problem
    (stopped,) = rig.ended
    assert stopped.end_reason.startswith("recording stopped: ")
    assert "MB" in stopped.end_reason
    monkeypatch.undo()
    rig.feed(vehicle.second())
    rig.feed(vehicle.second())
    assert rig.recorder.state.problem == ""
    first, second = rig.finish()
    assert rig.catalogue.flight(stopped.id) == first
    assert not rig.recording(first).damage.truncated
    assert first.messages == sum(rig.recording(first).counts().values())
    assert second.end_reason == "service stopped"
    sent = rig.sent[LINK]
    kept = rig.stream()
    assert len(kept) == len(sent) - rig.recorder.state.unrecorded_bytes
    last = sum(len(data) for _, data in wire_streams(rig.recording(second))[LINK])
    assert kept == sent[: len(kept) - last] + sent[-last:]
    errors = [record for record in caplog.records if record.levelname == "ERROR"]
    assert len(errors) == 1


def test_a_file_of_which_nothing_was_taken_is_no_flight(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fstatvfs", lambda handle: disk_with(0))
    vehicle = Vehicle()
    rig.feed(vehicle.second())
    while rig.recorder.live_flights():
        rig.feed(vehicle.second())
    assert rig.catalogue.flights() == []
    assert list(rig.folder.glob("*.mcap")) == []


def limit(process: subprocess.Popen[str], size: int) -> None:
    """Let no file of the process grow beyond `size`, which stands for a full disk."""
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))


def test_the_service_goes_on_without_and_then_with_room(tmp_path: Path) -> None:
    port = free_port()
    process = start(
        "gcs", ["serve", "--connect", f"udpin:127.0.0.1:{port}", "--data", tmp_path, "--port", "0", "--fsync", "chunk"]
    )
    vehicle = Vehicle()
    with process, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        assert process.stdout is not None
        url = process.stdout.readline().split()[-1]
        with httpx.Client(base_url=url, timeout=PATIENCE_S) as client:

            def health_while_sending() -> dict[str, object]:
                for frame in vehicle.second(rate_hz=10):
                    sender.sendto(frame, ("127.0.0.1", port))
                return dict(client.get("/api/health").json())

            wait_until(lambda: health_while_sending()["recording"])
            limit(process, 16_000)  # neither the recording nor the catalogue may grow any more
            told = wait_until(lambda: (state := health_while_sending())["unrecorded_bytes"] and state)
            assert told["status"] == "degraded"
            assert told["problem"]
            limit(process, resource.RLIM_INFINITY)
            wait_until(lambda: (state := health_while_sending())["status"] == "ok" and state["recording"])
            flights = wait_until(lambda: client.get("/api/flights").json()["flights"])
            assert client.get("/api/links").json()[0]["frames"] > 0
        process.send_signal(signal.SIGTERM)
        _, error = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, error
    assert "Traceback" not in error
    assert flights
    for path in tmp_path.glob("flights/*.mcap"):
        assert not Recording(path).damage


def test_gcs_record_stops_with_one_line_and_keeps_what_there_is(tmp_path: Path) -> None:
    port, path = free_port(), tmp_path / "flight.mcap"
    process = start("gcs", ["record", "--connect", f"udpin:127.0.0.1:{port}", "-o", path])
    vehicle = Vehicle()
    with process, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:

        def ended() -> bool:
            for frame in vehicle.second(rate_hz=20):
                sender.sendto(frame, ("127.0.0.1", port))
            if path.exists() and path.stat().st_size > 5_000:
                limit(process, 12_000)
            return process.poll() is not None

        wait_until(ended)
        _, error = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    *_, line = error.splitlines()
    assert line.startswith(f"gcs record: {path} cannot be written: File too large; ")
    counts = sum(Recording(path).counts().values())
    assert f"{counts} messages until then are in {path}" in line
    assert counts > 0
    assert Recording(path).damage.bytes == 0
