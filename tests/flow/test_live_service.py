"""The service while an aircraft flies: what it says over REST and in its stream of events."""

from __future__ import annotations

import json
import threading
from itertools import pairwise
from pathlib import Path
from typing import Any

import httpx
from processes import free_port, run, service
from traffic import wait_until


class Events(threading.Thread):
    """Reads the stream of events over a socket of its own until the service ends it."""

    def __init__(self, url: str) -> None:
        super().__init__()
        self._url = url
        self.heard: list[tuple[str, dict[str, Any]]] = []

    def run(self) -> None:
        with httpx.stream("GET", f"{self._url}/api/live/stream", timeout=60) as answer:
            assert answer.headers["content-type"].startswith("text/event-stream")
            name = ""
            for line in answer.iter_lines():
                if line.startswith("event: "):
                    name = line[7:]
                elif line.startswith("data: "):
                    self.heard.append((name, json.loads(line[6:])))

    def of(self, name: str) -> list[dict[str, Any]]:
        return [data for kind, data in self.heard if kind == name]


def test_signals_come_while_the_aircraft_flies(tmp_path: Path) -> None:
    port = free_port()
    with service("--connect", f"udpin:127.0.0.1:{port}", "--data", tmp_path) as url:
        events = Events(url)
        events.start()
        before = httpx.get(f"{url}/api/live").json()
        assert (before["schema"], before["state"], before["flight"], before["signals"]) == (
            "live/1",
            "waiting",
            None,
            {},
        )
        assert before["identification"] is None
        assert "--vehicle FILE" in before["why"]
        wait_until(lambda: httpx.get(f"{url}/api/live").json()["process"]["state"] == "running")
        run("sim-vehicle", "fly", "--manoeuvre", "multisine", "--duration", "4", "--out", f"udpout:127.0.0.1:{port}")
        after = httpx.get(f"{url}/api/live").json()
        assert after["flight"] is not None
        assert 3.5 < after["time_s"] < 4.1
        assert after["signals"]["az"]["unit"] == "m/s^2"
        assert -40.0 < after["signals"]["az"]["value"] < 20.0
        wait_until(lambda: len(events.of("state")) >= 3)
    events.join(30)  # the service ends the stream when it is told to stop
    assert [event["state"] for event in events.of("state")] == ["waiting", "live", "lost"]
    signals = events.of("signals")
    assert len(signals) >= 15  # of about forty: the machine may be busy
    assert all(later["time_s"] > earlier["time_s"] for earlier, later in pairwise(signals))
    assert {"phi", "alpha", "airspeed", "servo2"} <= signals[-1]["signals"].keys()
