"""A service that a crowd holds on to records all the same, says that it is well, and stops when it is asked to."""

from __future__ import annotations

import socket
import time
from contextlib import ExitStack
from pathlib import Path
from urllib.parse import urlsplit

import httpx
from patience import PATIENCE_S
from processes import free_port, service
from traffic import Vehicle, wait_until


def test_idle_connections_beyond_every_limit_cost_no_message(tmp_path: Path) -> None:
    port, vehicle, sent = free_port(), Vehicle(7), 0
    arguments = ["--data", tmp_path, "--connect", f"udpin:127.0.0.1:{port}", "--no-identify"]
    with service(*arguments, descriptors=300) as url, ExitStack() as held:
        address = (urlsplit(url).hostname or "", urlsplit(url).port or 0)
        sender = held.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        sender.connect(("127.0.0.1", port))
        with httpx.Client(base_url=url, timeout=PATIENCE_S) as client:
            for second in range(4):
                for _ in range(150):
                    held.enter_context(socket.create_connection(address))
                for datagram in vehicle.second():
                    sender.send(datagram)
                    sent += 1
                    time.sleep(0.002)
                # By a connection of its own: one kept from before may be the one that has waited longest.
                begun = httpx.get(f"{url}/api/health", timeout=PATIENCE_S)
                assert begun.status_code == 200, second
                assert begun.json()["problem"] == ""
            flight = wait_until(lambda: client.get("/api/flights").json()["flights"])[0]
            wait_until(lambda: client.get("/api/links").json()[0]["frames"] >= sent)
            health = client.get("/api/health").json()
            assert health["status"] == "ok"
            assert health["unrecorded_bytes"] == 0
            assert health["recording"] == [flight["id"]]


def test_what_a_killed_service_left_of_uploads_and_jobs_is_removed(tmp_path: Path) -> None:
    left = [tmp_path / "upload-abc", tmp_path / "jobs" / "job-1-xyz"]
    for folder in left:
        folder.mkdir(parents=True)
        (folder / "file").write_bytes(b"x")
    kept = tmp_path / "flights" / "upload-notes.txt"
    kept.parent.mkdir()
    kept.write_text("mine")
    with service("--data", tmp_path) as url:
        assert httpx.get(f"{url}/api/health", timeout=PATIENCE_S).status_code == 200
        assert not any(folder.exists() for folder in left)
    assert kept.read_text() == "mine"
