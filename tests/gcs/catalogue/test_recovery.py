"""A restart in flight: the service receives at once, however long it takes to complete what the last run left."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from patience import PATIENCE_S
from processes import free_port
from recorded_stream import DIALECT, Stream
from traffic import Vehicle, wait_until

from gcs.recording.reader import Recording
from gcs.recording.writer import McapWriter
from gcs.settings import Settings

# The service with a disk so slow that a file is complete only when `go` is there.
SLOW = """
import sys, time, pathlib
import gcs.catalogue.intake, gcs.cli
complete = gcs.catalogue.intake.complete
def slow(path):
    while not pathlib.Path(sys.argv[1]).exists():
        time.sleep(0.02)
    return complete(path)
gcs.catalogue.intake.complete = slow
sys.exit(gcs.cli.main(sys.argv[2:]))
"""


@contextmanager
def slow_service(go: Path, *arguments: object) -> Iterator[httpx.Client]:
    """The service, its URL asked for on its standard output."""
    command = [sys.executable, "-c", SLOW, str(go), "serve", "--port", "0", *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "GCS_TOKEN": ""})
    with process:
        try:
            assert process.stdout is not None
            url = process.stdout.readline().split()[-1]
            with httpx.Client(base_url=url, timeout=PATIENCE_S) as client:
                yield client
        finally:
            process.terminate()
    assert process.returncode == 0


@pytest.mark.whole_flight
def test_the_service_records_while_it_completes_what_the_last_run_left(tmp_path: Path) -> None:
    settings, go, port = Settings(data=tmp_path / "data"), tmp_path / "go", free_port()
    settings.flights.mkdir(parents=True)
    cut = settings.flights / "cut.mcap"
    with McapWriter(cut, DIALECT, chunk_seconds=0.1) as writer:
        Stream().feed(writer, 300)
    cut.write_bytes(cut.read_bytes()[:-2000])
    with (
        slow_service(go, "--connect", f"udpin:127.0.0.1:{port}", "--data", settings.data) as client,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        vehicle = Vehicle()

        def flying() -> str | None:
            for frame in vehicle.second():
                sender.sendto(frame, ("127.0.0.1", port))
            live = client.get("/api/health").json()["recording"]
            return live[0] if live else None

        live = wait_until(flying)
        assert Recording(cut).damage.truncated
        go.touch()

        def state_of(flight: str) -> str:
            listed = client.get("/api/flights").json()["flights"]
            return next((one["state"] for one in listed if one["id"] == flight), "")

        wait_until(lambda: state_of("cut") == "recovered")
        assert state_of(live) == "recording"
        wait_until(lambda: flying() == live)
    assert not Recording(cut).damage.truncated
    flown = Recording(settings.flights / f"{live}.mcap")
    assert flown.lost()[(f"udpin:127.0.0.1:{port}", 1, 1)] == 0
    assert not flown.damage.truncated
