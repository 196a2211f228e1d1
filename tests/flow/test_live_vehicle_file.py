"""A vehicle file edited between flights of one service: what flies next is identified, recorded and told by it."""

from __future__ import annotations

import shutil
import threading
from pathlib import Path
from typing import Any

import pytest
from asking import Asking
from patience import PATIENCE_S
from processes import free_port, service, start
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rest import asked
from traffic import wait_until

from gcs.recording.reader import Recording
from sim_vehicle.vehicle.vehicle_file import VEHICLES


class Texts(threading.Thread):
    """Another ground station, which keeps what this one says in words."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.station = Asking()
        self.parts: list[str] = []
        self.done = threading.Event()

    def run(self) -> None:
        while not self.done.is_set():
            for message in self.station.receive():
                if message.get_type() == "STATUSTEXT" and message.get_srcComponent() == mavlink.MAV_COMP_ID_USER1:
                    self.parts.append(message.text)

    @property
    def heard(self) -> str:
        return "".join(self.parts)


class Ground:
    """The service on `url`, to whose `port` one flight after another is flown."""

    def __init__(self, url: str, port: int) -> None:
        self.url, self.port = url, port

    def live(self) -> dict[str, Any]:
        told: dict[str, Any] = asked(f"{self.url}/api/live")
        return told

    def fly(self, seconds: float) -> dict[str, Any]:
        """What the service says of a flight, sent at four times its pace, once it is over and all is estimated."""

        def known() -> dict[str, Any] | None:
            told = self.live()
            found = told["identification"]
            return told if told["flight"] is None and found and found["coefficients"]["CL_alpha"]["known"] else None

        arguments = ["fly", "--manoeuvre", "elevator-multisine", "--duration", seconds, "--speed", 4]
        with start("sim-vehicle", [*arguments, "--out", f"udpout:127.0.0.1:{self.port}"]) as flight:
            wait_until(lambda: self.live()["flight"])
            _, error = flight.communicate(timeout=PATIENCE_S)
            assert flight.returncode == 0, error
        return wait_until(known)


def lift(told: dict[str, Any]) -> float:
    return float(told["identification"]["coefficients"]["CL_alpha"]["value"])


def test_an_edited_vehicle_file_counts_from_the_next_flight_on_and_a_bad_one_does_not(tmp_path: Path) -> None:
    for path in VEHICLES.glob("iitb-mav*"):
        shutil.copy(path, tmp_path)
    craft, data = tmp_path / "iitb-mav.toml", tmp_path / "data"
    first = craft.read_text(encoding="utf-8")
    second = first.replace('name = "iitb-mav"', 'name = "repainted"').replace("\nmass = 1.0", "\nmass = 2.0")
    assert second.count("repainted") == second.count("mass = 2.0") == 1
    port, neighbour = free_port(), Texts()
    neighbour.start()
    links = ("--connect", f"udpin:127.0.0.1:{port}", "--forward", neighbour.station.url)
    with service(*links, "--vehicle", craft, "--data", data, "--no-identify", "--silence", 2) as url:
        ground = Ground(url, port)
        wait_until(lambda: ground.live()["process"]["state"] == "running")
        before = ground.fly(9)
        assert before["vehicle"] == "iitb-mav"
        assert before["identification"]["warnings"] == []

        craft.write_text(second, encoding="utf-8")
        changed = ground.fly(9)
        assert changed["vehicle"] == "repainted"
        assert changed["identification"]["warnings"][0].startswith("iitb-mav.toml has changed: coefficients begin anew")
        assert lift(changed) == pytest.approx(2.0 * lift(before), rel=0.1)  # of twice the mass, under the same forces
        wait_until(lambda: "iitb-mav.toml has changed" in neighbour.heard)

        craft.write_text(second.replace("[mass]", "[mess]"), encoding="utf-8")
        kept = ground.fly(9)
        assert kept["vehicle"] == "repainted"
        (note, *_) = kept["identification"]["warnings"]
        assert "the vehicle file cannot be used" in note
        assert "goes on with what was read before (repainted)" in note
        assert lift(kept) == pytest.approx(2.0 * lift(before), rel=0.1)
        wait_until(lambda: "cannot be used" in neighbour.heard)
    neighbour.done.set()
    neighbour.join(PATIENCE_S)
    neighbour.station.socket.close()
    held = [Recording(path).attachments() for path in sorted((data / "flights").glob("*.mcap"))]
    texts = [next(one.data for one in files if one.name == craft.name).decode() for files in held]
    assert texts == [first, second, second]
