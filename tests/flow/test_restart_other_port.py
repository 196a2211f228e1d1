"""A vehicle that is switched on again while its flight is recorded, and speaks from another port: another flight."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

from processes import free_port, run, service
from rest import asked
from traffic import wait_until


def fly(port: int, seconds: float) -> None:
    """Each time from a socket of its own."""
    run("sim-vehicle", "fly", "--manoeuvre", "elevator-multisine", "--duration", seconds,
        "--out", f"udpout:127.0.0.1:{port}")  # fmt: skip


def test_a_restart_from_another_port_ends_the_flight_and_live_begins_anew(tmp_path: Path) -> None:
    port = free_port()
    with service("--connect", f"udpin:127.0.0.1:{port}", "--vehicle", "iitb-mav", "--data", tmp_path,
                 "--no-identify", "--silence", 25) as url:  # fmt: skip

        def ask(path: str) -> Any:
            return asked(f"{url}{path}")

        wait_until(lambda: ask("/api/live")["process"]["state"] == "running")
        fly(port, 8)
        first = wait_until(lambda: ask("/api/live")["flight"])
        again = threading.Thread(target=fly, args=(port, 5))
        again.start()

        def begun() -> dict[str, Any] | None:
            told: dict[str, Any] = ask("/api/live")
            estimates = told["identification"]
            return told if told["flight"] != first and estimates and estimates["time_s"] else None

        told = wait_until(begun)
        assert told["time_s"] < 6.0
        assert told["identification"]["time_s"] < 6.0
        again.join()
        wait_until(lambda: len(ask("/api/flights")["flights"]) == 2)
        ended = wait_until(lambda: next((one for one in ask("/api/flights")["flights"] if one["id"] == first
                                         and one["state"] == "complete"), None))  # fmt: skip
        assert ask(f"/api/flights/{first}")["end_reason"] == ended["end_reason"] == "clock reset"
