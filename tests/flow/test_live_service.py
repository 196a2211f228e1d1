"""The service while an aircraft flies: what it says over REST and in its stream of events."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterable
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import httpx
from asking import Asking
from patience import PATIENCE_S
from processes import free_port, run, service
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rest import asked
from traffic import wait_until


class Events(threading.Thread):
    """Reads the stream of events over a socket of its own until the service ends it."""

    def __init__(self, url: str) -> None:
        super().__init__()
        self._url = url
        self.heard: list[tuple[str, dict[str, Any]]] = []

    def run(self) -> None:
        with httpx.stream("GET", f"{self._url}/api/live/stream", timeout=PATIENCE_S) as answer:
            assert answer.headers["content-type"].startswith("text/event-stream")
            name = ""
            for line in answer.iter_lines():
                if line.startswith("event: "):
                    name = line[7:]
                elif line.startswith("data: "):
                    self.heard.append((name, json.loads(line[6:])))

    def of(self, name: str) -> list[dict[str, Any]]:
        return [data for kind, data in self.heard if kind == name]


class Neighbour(threading.Thread):
    """Another ground station, which listens to what this one forwards."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.station = Asking()
        self.heard: list[mavlink.MAVLink_message] = []
        self.done = threading.Event()

    def run(self) -> None:
        while not self.done.is_set():
            self.heard += self.station.receive()


def running(url: str) -> bool:
    return bool(asked(f"{url}/api/live")["process"]["state"] == "running")


def estimated(url: str) -> dict[str, Any] | None:
    """What the service says once the whole flight is in its estimates."""
    told: dict[str, Any] = asked(f"{url}/api/live")
    known = told["identification"] is not None and told["identification"]["coefficients"]["Cl_da"]["known"]
    return told if known else None


def flown(url: str, time_s: float) -> dict[str, Any] | None:
    """What the service says once it has read so much of the flight."""
    told: dict[str, Any] = asked(f"{url}/api/live")
    return told if (told["time_s"] or 0.0) > time_s else None


def test_signals_come_without_a_vehicle_file(tmp_path: Path) -> None:
    port = free_port()
    with service("--connect", f"udpin:127.0.0.1:{port}", "--data", tmp_path) as url:
        events = Events(url)
        events.start()
        before = asked(f"{url}/api/live")
        assert (before["schema"], before["state"], before["flight"], before["signals"]) == (
            "live/1",
            "waiting",
            None,
            {},
        )
        assert before["identification"] is None
        assert "--vehicle FILE" in before["why"]
        wait_until(lambda: running(url))
        run("sim-vehicle", "fly", "--manoeuvre", "multisine", "--duration", "4", "--out", f"udpout:127.0.0.1:{port}")
        after = wait_until(lambda: flown(url, 3.5))
        assert after["flight"] is not None
        assert after["time_s"] < 4.1
        assert after["signals"]["az"]["unit"] == "m/s^2"
        assert -40.0 < after["signals"]["az"]["value"] < 20.0
        wait_until(lambda: events.of("state")[-1]["state"] == "lost")
    events.join(PATIENCE_S)  # the service ends the stream when it is told to stop
    # A new flight or vehicle is told by an event as well, in whatever state the link is.
    states = [state for state, _ in groupby(event["state"] for event in events.of("state"))]
    assert states[:2] == ["waiting", "live"]
    assert states[-1] == "lost"
    # What comes late, when the flight is over already, begins anew with nothing.
    signals = [one for one in events.of("signals") if one["signals"]]
    assert len(signals) >= 2  # of about forty: the machine may be busy
    # Two messages of one instant may be told in two events, where the sender was held up between them.
    assert all(later["time_s"] >= earlier["time_s"] for earlier, later in pairwise(signals))
    assert signals[-1]["time_s"] > signals[0]["time_s"]
    assert {"phi", "alpha", "airspeed", "servo2"} <= signals[-1]["signals"].keys()


def values_of(messages: Iterable[Any]) -> dict[str, float]:
    return {m.name: m.value for m in messages if m.get_type() == "NAMED_VALUE_FLOAT"}


def test_estimates_come_while_the_aircraft_flies_and_a_neighbour_hears_them(tmp_path: Path) -> None:
    port, neighbour = free_port(), Neighbour()
    options = ("--connect", f"udpin:127.0.0.1:{port}", "--forward", neighbour.station.url, "--no-identify")
    with service(*options, "--vehicle", "iitb-mav", "--data", tmp_path) as url:
        events = Events(url)
        events.start()
        neighbour.start()
        wait_until(lambda: running(url))
        flight = ("--manoeuvre", "multisine", "--duration", "14", "--speed", "2")
        run("sim-vehicle", "fly", *flight, "--out", f"udpout:127.0.0.1:{port}")
        after = wait_until(lambda: estimated(url))
        wait_until(lambda: "CL_alpha" in values_of(neighbour.heard))
    events.join(PATIENCE_S)
    neighbour.done.set()
    neighbour.join(PATIENCE_S)
    neighbour.station.socket.close()
    assert after["why"] is None
    assert after["process"]["dropped_bytes"] == 0
    found = after["identification"]
    for name, true in (("CL_alpha", 2.453), ("Cm_alpha", -0.5998), ("Cm_de", 1.5894)):
        entry = found["coefficients"][name]
        assert entry["known"]
        assert entry["unit"] == "1/rad"
        assert abs(entry["value"] - true) < max(4.0 * entry["std"], 0.02 * abs(true))
    assert found["latency_ms"]["median"] > 0.0
    assert found["events"] == after["events"] == []
    assert len(events.of("estimate")) >= 2
    own = [m for m in neighbour.heard if (m.get_srcSystem(), m.get_srcComponent()) == (255, mavlink.MAV_COMP_ID_USER1)]
    assert abs(values_of(own)["CL_alpha"] - 2.453) < 0.3
    assert not any(m.get_type() == "STATUSTEXT" for m in own)
