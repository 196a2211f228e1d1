"""A station that was started without a vehicle file: what flies is identified with the aircraft it was told of."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import httpx
from patience import PATIENCE_S
from processes import free_port, run, service, start
from traffic import wait_until

from gcs.vehicles.document import with_points_inside
from sim_vehicle.vehicle.vehicle_file import load_vehicle


def fly(client: httpx.Client, port: int) -> dict[str, Any]:
    """What is said of a flight of 24 s, sent at four times its pace, once it is over.

    Which board it is, and so which aircraft, is known only after it has answered, and the first estimate takes 8 s.
    """
    flight = ["fly", "--manoeuvre", "elevator-multisine", "--duration", 24, "--speed", 4]
    done = run("sim-vehicle", *flight, "--out", f"udpout:127.0.0.1:{port}")
    assert done.returncode == 0, done.stderr

    def known() -> dict[str, Any] | None:
        told = client.get("/api/live").json()
        found = told["identification"]
        return told if told["flight"] is None and found and found["coefficients"]["CL_alpha"]["known"] else None

    return wait_until(known)


def lift(told: dict[str, Any]) -> float:
    return float(told["identification"]["coefficients"]["CL_alpha"]["value"])


def test_live_estimates_go_by_the_aircraft_that_a_flight_is_known_to_be(tmp_path: Path) -> None:
    craft = load_vehicle("iitb-mav")
    text = with_points_inside(craft.path.read_text(encoding="utf-8"), craft)
    heavy = text.replace('name = "iitb-mav"', 'name = "heavy"').replace("\nmass = 1.0", "\nmass = 2.0")
    port = free_port()
    with (
        service(
            "--connect", f"udpin:127.0.0.1:{port}", "--data", tmp_path / "data", "--no-identify", "--silence", 2
        ) as url,
        httpx.Client(base_url=url, timeout=PATIENCE_S) as client,
    ):
        wait_until(lambda: client.get("/api/live").json()["process"]["state"] == "running")
        assert "no aircraft is known: describe it under Aircraft" in client.get("/api/live").json()["why"]
        assert client.post("/api/vehicles", json={"toml": text}).status_code == 201
        first = fly(client, port)
        assert first["vehicle"] == "iitb-mav"
        assert client.post("/api/vehicles", json={"toml": heavy}).status_code == 201
        (flight,) = client.get("/api/flights").json()["flights"]
        assert client.patch(f"/api/flights/{flight['id']}", json={"vehicle": "heavy"}).status_code == 200
        second = fly(client, port)
        assert second["vehicle"] == "heavy"
        # The same motion of twice the mass takes twice the lift.
        assert 1.8 < lift(second) / lift(first) < 2.2
        flights = client.get("/api/flights").json()["flights"]
        (board,) = {one["board"] for one in flights}  # the station asked for it
        assert re.fullmatch("[0-9a-f]{16}", board)
        aircraft = client.get(f"/api/flights/{flights[0]['id']}").json()["aircraft"]
        assert aircraft["why"] == f"as for flight {flight['id']}, which had the same autopilot board"


def test_an_aircraft_chosen_in_flight_counts_at_once(tmp_path: Path) -> None:
    port = free_port()
    arguments = ("--connect", f"udpin:127.0.0.1:{port}", "--data", tmp_path / "data", "--vehicle", "iitb-mav")
    with (
        service(*arguments, "--no-identify") as url,
        httpx.Client(base_url=url, timeout=PATIENCE_S) as client,
    ):
        craft = load_vehicle("aerosonde")
        text = with_points_inside(craft.path.read_text(encoding="utf-8"), craft)
        assert client.post("/api/vehicles", json={"toml": text}).status_code == 201
        wait_until(lambda: client.get("/api/live").json()["process"]["state"] == "running")
        out = f"udpout:127.0.0.1:{port}"
        with start("sim-vehicle", ["fly", "--manoeuvre", "cruise", "--duration", 600, "--out", out]) as flying:
            flight = wait_until(lambda: client.get("/api/live").json()["flight"])
            wait_until(lambda: client.get("/api/live").json()["vehicle"] == "iitb-mav")
            assert client.patch(f"/api/flights/{flight}", json={"vehicle": "aerosonde"}).status_code == 200
            wait_until(lambda: client.get("/api/live").json()["vehicle"] == "aerosonde")
            flying.kill()
