"""The whole way on real links: the simulator over UDP into the service, its jobs, and everything REST tells of them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from own_bars import own_bar
from patience import PATIENCE_S
from processes import free_port, run, service
from traffic import wait_until

from gcs.flights.signals import extract
from gcs.formats.conversion import import_file
from gcs.recording.reader import Recording
from sim_vehicle.model.model_file import BUILT_IN
from sim_vehicle.vehicle.vehicle_file import load_vehicle

TOKEN = "token-of-the-flow-test"
AUTHORISED = {"Authorization": f"Bearer {TOKEN}"}
MODEL = json.loads((BUILT_IN / "iitb-mav.model.json").read_text(encoding="utf-8"))
ENDED = ("done", "failed", "skipped")


@dataclass(frozen=True)
class Station:
    """The running service: a client that has the token, its address, where it listens, and its data folder."""

    client: httpx.Client
    url: str
    link: str
    data: Path

    def get(self, path: str) -> Any:
        answer = self.client.get(path)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def newest(self) -> dict[str, Any]:
        """Summary of the newest flight once it has ended."""

        def ended() -> dict[str, Any] | None:
            flights = self.get("/api/flights")["flights"]
            return flights[0] if flights and flights[0]["state"] == "complete" else None

        return dict(self.get(f"/api/flights/{wait_until(ended)['id']}"))

    def ended(self, job: str) -> dict[str, Any]:
        """A job once it is over."""

        def over() -> dict[str, Any] | None:
            found = self.get(f"/api/jobs/{job}")
            return found if found["state"] in ENDED else None

        return wait_until(over)

    def run_job(self, flight: str, **request: Any) -> dict[str, Any]:
        answer = self.client.post(f"/api/flights/{flight}/jobs", json=request)
        assert answer.status_code == 202, answer.text
        return self.ended(answer.json()["id"])


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """A service that others could reach, so that it demands its token."""
    data = tmp_path_factory.mktemp("service")
    port = free_port()
    link = f"udpin:127.0.0.1:{port}"
    options = ("--connect", link, "--vehicle", "iitb-mav", "--data", data, "--host", "0.0.0.0", "--silence", "2")
    with service(*options, GCS_TOKEN=TOKEN) as url:
        url = url.replace("0.0.0.0", "127.0.0.1")
        with httpx.Client(base_url=url, headers=AUTHORISED, timeout=PATIENCE_S) as client:
            yield Station(client, url, f"udpout:127.0.0.1:{port}", data)


@pytest.fixture(scope="module")
def flown(station: Station) -> dict[str, Any]:
    """Summary of a flight that the simulator sent at ten times its pace, its automatic job over."""
    done = run("sim-vehicle", "fly", "--manoeuvre", "elevator-3211", "--seed", 4, "--out", station.link, "--speed", 10)
    assert done.returncode == 0, done.stderr
    summary = station.newest()
    assert f", {summary['messages']} messages" in done.stderr
    assert summary["lost"] == 0

    def queued() -> list[dict[str, Any]]:  # a moment after the flight is listed as complete
        return list(station.get(f"/api/flights/{summary['id']}")["jobs"])

    (job,) = summary["jobs"] = wait_until(queued)
    assert station.ended(job["id"])["state"] == "done"
    return summary


def test_every_flight_is_identified_when_it_ends(station: Station, flown: dict[str, Any]) -> None:
    (job,) = flown["jobs"]
    found = station.ended(job["id"])
    assert (found["kind"], found["progress"], found["error"]) == ("identify", 1.0, None)
    assert found["log"]
    result = station.get(f"/api/flights/{flown['id']}/identification")
    assert result["schema"] == "identification/1"
    for name in ("CL_0", "CL_alpha", "CL_de", "CD_0", "CD_k", "Cm_0", "Cm_alpha", "Cm_de"):
        entry, true = result["model"]["coefficients"][name], MODEL["coefficients"][name]["value"]
        assert entry["value"] == pytest.approx(true, rel=0.03, abs=4.0 * own_bar(entry)), name
    newest = station.get("/api/models")[0]
    assert (newest["flight_id"], newest["kind"]) == (flown["id"], "identify")
    assert station.get(f"/api/models/{newest['id']}") == result["model"]


def test_signals_and_recording_are_those_on_disk(station: Station, flown: dict[str, Any]) -> None:
    path = station.data / "flights" / f"{flown['id']}.mcap"
    on_disk = extract(Recording(path), load_vehicle("iitb-mav"))
    flight = f"/api/flights/{flown['id']}"
    answer = station.get(f"{flight}/signals?names=alpha,q&start=2&end=6&points=100")
    for name in ("alpha", "q"):
        given, full = answer["signals"][name], on_disk.signals[name]
        inside = (full.time_s >= 2.0) & (full.time_s <= 6.0)
        assert given["unit"] == full.unit
        assert len(given["time"]) <= 110
        # Thinning keeps the extremes.
        assert min(given["value"]) == np.min(full.values[inside])
        assert max(given["value"]) == np.max(full.values[inside])
    content = path.read_bytes()
    part = station.client.get(f"{flight}/recording", headers={"Range": "bytes=1000-2999"})
    assert (part.status_code, part.content) == (206, content[1000:3000])
    assert station.client.get(f"{flight}/recording").content == content


def test_a_model_is_judged_by_its_content_or_its_id(station: Station, flown: dict[str, Any]) -> None:
    wrong = json.loads(json.dumps(MODEL))
    wrong["coefficients"]["Cm_alpha"]["value"] *= 1.2
    for model, verdicts in ((MODEL, ("none", "parameter_error")), (wrong, ("parameter_error",))):
        job = station.run_job(flown["id"], kind="discrepancy", model=model, method="map")
        assert (job["state"], job["error"]) == ("done", None)
        result = station.get(f"/api/flights/{flown['id']}/discrepancy")
        assert result["schema"] == "discrepancy/1"
        assert result["verdict"] in verdicts
        refitted = result["model"]["coefficients"]["Cm_alpha"]["value"]
        assert refitted == pytest.approx(MODEL["coefficients"]["Cm_alpha"]["value"], rel=0.03)
        gap = result["gap"]["estimation"]
        assert gap["after"]["q"] <= gap["given"]["q"] * 1.01
    newest = station.get("/api/models")[0]["id"]
    again = station.run_job(flown["id"], kind="identify", prior=newest, method="ee")
    assert (again["state"], again["request"]["prior"]) == ("done", newest)


@pytest.mark.parametrize("model", [str(BUILT_IN / "iitb-mav.model.json"), "iitb-mav", "../catalogue.sqlite"])
def test_no_name_or_path_of_a_client_reaches_the_file_system(
    station: Station, flown: dict[str, Any], model: str
) -> None:
    answer = station.client.post(f"/api/flights/{flown['id']}/jobs", json={"kind": "discrepancy", "model": model})
    assert answer.status_code == 404
    assert "there is no model" in answer.json()["detail"]


def test_a_recording_of_the_ground_is_no_failure(station: Station, flown: dict[str, Any], tmp_path: Path) -> None:
    taxi, ground = tmp_path / "taxi.tlog", tmp_path / "ground.mcap"
    done = run("sim-vehicle", "fly", "--taxi", "--manoeuvre", "cruise", "--duration", 5, "--record", taxi)
    assert done.returncode == 0, done.stderr
    whole = taxi.read_bytes()
    taxi.write_bytes(whole[: len(whole) // 20])
    import_file(taxi, ground)
    seconds = (Recording(ground).end_ns - Recording(ground).start_ns) / 1e9
    assert 2.5 < seconds < 5.5  # it stands for the first 5 s
    done = run("gcs", "replay", ground, "--out", station.link, "--speed", 10)
    assert done.returncode == 0, done.stderr

    def stood() -> dict[str, Any] | None:
        newest = station.newest()
        return newest if newest["id"] != flown["id"] else None

    summary = wait_until(stood)
    (job,) = summary["jobs"]
    over = station.ended(job["id"])
    assert (over["state"], over["error"]) == ("skipped", None)
    assert "never flew" in over["log"][-1]
    missing = station.client.get(f"/api/flights/{summary['id']}/identification")
    assert missing.status_code == 404
    assert "never flew" in missing.json()["detail"]


@pytest.mark.parametrize("path", ["/api/flights", "/api/models", "/api/links", "/api/live"])
def test_without_the_token_only_health_answers(station: Station, path: str) -> None:
    assert httpx.get(f"{station.url}/api/health", timeout=PATIENCE_S).status_code == 200
    for headers in ({}, {"Authorization": "Bearer wrong-token-of-someone"}, {"Authorization": TOKEN}):
        assert httpx.get(station.url + path, headers=headers, timeout=PATIENCE_S).status_code == 401
