"""The station's aircraft over REST: described, changed, chosen for a flight, taken by its jobs."""

import json
import sys
import tomllib
from pathlib import Path
from typing import Any

import httpx
import pytest
from api_bench import START, Bench, problem
from serving import serving
from traffic import SECOND, wait_until

from gcs.api import create_app
from gcs.jobs.runner import JobRunner
from sim_vehicle.vehicle.vehicle_file import load_vehicle

pytestmark = pytest.mark.whole_flight

# Leaves in its result which aircraft it was given.
WORKER = """
import json, sys, tomllib
order = json.loads(sys.stdin.readline())
with open(order["vehicle"], "rb") as file:
    found = tomllib.load(file)
result = {"schema": "identification/1", "name": found["name"], "mass": found["mass"]["mass"],
          "quality": {"verdict": "care", "reasons": ["gusts hide Cl_r"]}}
json.dump(result, open(order["output"], "w"))
"""
NUMBERS = {"mass_kg": 1.05, "span_m": 1.5, "area_m2": 0.26, "chord_m": 0.18}
ELEVATOR = {"servos": [{"servo": 2, "pwm_us": [1100, 1500, 1900], "travel": [-20, 0, 22.5]}]}
FORM = {"name": "Bixler 2", "numbers": NUMBERS, "controls": {"elevator": ELEVATOR}}


class Station(Bench):
    """The application without an aircraft, its jobs saying which one they were given."""

    def __init__(self, folder: Path, **changes: Any) -> None:
        super().__init__(folder, **{"vehicle": None, **changes})
        jobs = JobRunner(self.settings, self.catalogue, (sys.executable, "-c", WORKER))
        self.app = create_app(self.settings, self.catalogue, self.station, jobs)


def result_of(client: httpx.Client, flight: str, **request: object) -> dict[str, Any]:
    """What a job says that was given this request."""
    started = client.post(f"/api/flights/{flight}/jobs", json={"kind": "identify", **request}).raise_for_status()
    job = f"/api/jobs/{started.json()['id']}"
    wait_until(lambda: client.get(job).json()["state"] == "done")
    return {**client.get(f"/api/flights/{flight}/identification").json(), "job": client.get(job).json()}


def test_an_aircraft_described_by_a_form_is_what_a_flight_is_identified_with(tmp_path: Path) -> None:
    station = Station(tmp_path)
    first, second = station.record(1, 1, START), station.record(1, 1, START + 60 * SECOND)
    with serving(station.app) as client:
        said = problem(client.post(f"/api/flights/{first}/jobs", json={"kind": "identify"}), 409)
        assert "no aircraft is known: describe it on the page" in said
        made = client.post("/api/vehicles", json={"form": FORM})
        assert made.status_code == 201
        assert made.json()["id"] == "bixler-2"
        assert any("swing the aircraft" in line for line in made.json()["warnings"])
        found = result_of(client, first)
        assert (found["name"], found["mass"]) == ("Bixler 2", 1.05)
        assert found["job"]["request"]["vehicle"] == "bixler-2@1"
        assert "the only one that there is" in found["job"]["log"][0]

        heavier = {**FORM, "numbers": {**NUMBERS, "mass_kg": 1.2}}
        assert client.put("/api/vehicles/bixler-2", json={"form": heavier}).json()["version"] == 2
        # A job begun anew takes the version that it had; a new one the newest.
        again = client.post(f"/api/jobs/{found['job']['id']}/rerun", json={}).json()
        assert again["request"]["vehicle"] == "bixler-2@1"
        assert result_of(client, first)["mass"] == 1.2
        assert result_of(client, first, vehicle="bixler-2@1")["mass"] == 1.05

        # Chosen by hand for one flight, it is the next one's of the same vehicle too.
        client.post("/api/vehicles", json={"form": {**FORM, "name": "Zagi"}})
        said = problem(client.post(f"/api/flights/{first}/jobs", json={"kind": "identify"}), 409)
        assert "which aircraft flew this? Choose one on the flight's page, or name it: bixler-2, zagi" in said
        assert client.patch(f"/api/flights/{first}", json={"vehicle": "zagi"}).json()["vehicle"] == "zagi"
        assert result_of(client, second)["name"] == "Zagi"
        seen = client.get(f"/api/flights/{second}").json()["aircraft"]
        assert (seen["id"], seen["by_hand"]) == ("zagi", False)
        assert seen["why"] == f"as for flight {first}, whose vehicle had the same system id"
        # A log from elsewhere with the same system id says nothing of what flies here, nor the other way round.
        recording = client.get(f"/api/flights/{first}/recording").content
        upload = client.post("/api/flights?name=a.mcap", content=recording).json()["id"]
        assert not client.get(f"/api/flights/{upload}").json()["aircraft"]["why"].startswith("as for")
        client.patch(f"/api/flights/{upload}", json={"vehicle": "bixler-2"})
        assert client.get(f"/api/flights/{second}").json()["aircraft"]["id"] == "zagi"
        assert client.delete("/api/vehicles/zagi").status_code == 204
        assert client.get(f"/api/flights/{second}").json()["aircraft"]["id"] == "bixler-2"
        # The flight itself keeps what somebody said that it was.
        assert client.get(f"/api/flights/{first}").json()["aircraft"]["id"] == "zagi"
        assert client.patch(f"/api/flights/{first}", json={"vehicle": ""}).json()["vehicle"] is None
        assert client.post("/api/vehicles/zagi/restore").json()["id"] == "zagi"
        assert "no aircraft 'nobody'" in problem(client.patch(f"/api/flights/{first}", json={"vehicle": "nobody"}), 404)
        assert "'x@9'" in problem(
            client.post(f"/api/flights/{first}/jobs", json={"kind": "identify", "vehicle": "x@9"}), 404
        )


def test_a_later_choice_says_nothing_of_earlier_flights(tmp_path: Path) -> None:
    station = Station(tmp_path)
    ids = [station.record(1, 1, START + 60 * number * SECOND) for number in range(4)]
    with serving(station.app) as client:
        for name in ("Old", "Repaired"):
            client.post("/api/vehicles", json={"form": {**FORM, "name": name}})
        client.patch(f"/api/flights/{ids[0]}", json={"vehicle": "old"})
        client.patch(f"/api/flights/{ids[2]}", json={"vehicle": "repaired"})
        client.patch(f"/api/flights/{ids[0]}", json={"comment": "windy"})
        flown = [client.get(f"/api/flights/{one}").json()["aircraft"]["id"] for one in ids]
        assert flown == ["old", "old", "repaired", "repaired"]


def test_what_people_say_of_a_flight_is_kept_found_and_goes_with_it(tmp_path: Path) -> None:
    station = Station(tmp_path, vehicle="iitb-mav")
    flight, other = station.record(1, 1, START), station.record(1, 1, START + 60 * SECOND)
    with serving(station.app) as client:
        said = {"title": "Pulses at 15 m/s", "comment": "light wind from Öst", "tags": ["calm", " calm ", "pulses"]}
        answer = client.patch(f"/api/flights/{flight}", json=said).json()
        assert (answer["title"], answer["tags"]) == ("Pulses at 15 m/s", ["calm", "pulses"])
        client.patch(f"/api/flights/{flight}", json={"title": "Pulses"})
        for words in ("pulses", "Öst", "calm pulses"):
            assert [one["id"] for one in client.get("/api/flights", params={"search": words}).json()["flights"]] == [
                flight
            ]
        summary = client.get(f"/api/flights/{flight}").json()
        assert (summary["title"], summary["comment"]) == ("Pulses", "light wind from Öst")
        assert summary["outcome"] == {"state": None, "verdict": None, "text": ""}
        result_of(client, flight)
        listed = {one["id"]: one for one in client.get("/api/flights").json()["flights"]}
        assert listed[flight]["outcome"] == {"state": "done", "verdict": "care", "text": "gusts hide Cl_r"}
        assert listed[other]["title"] == ""
        problem(client.patch(f"/api/flights/{flight}", json={"titel": "x"}), 422)
        problem(client.patch(f"/api/flights/{flight}", json={"title": "x" * 201}), 422)


def test_an_aircraft_is_checked_before_it_is_kept(tmp_path: Path) -> None:
    with serving(Station(tmp_path).app) as client:
        good = client.post("/api/vehicles/check", json={"form": FORM}).json()
        assert good["problem"] == ""
        assert {one["name"]: one["is_usual"] for one in good["figures"]}["wing loading"]
        assert good["sketch"].startswith("<svg")
        assert good["form"]["controls"]["elevator"]["servos"][0]["travel"] == [-20, 0, 22.5]
        assert tomllib.loads(good["toml"])["geometry"]["b"] == 1.5
        grams = {**FORM, "numbers": {**NUMBERS, "mass_kg": 1050.0}}
        assert any(
            "grams?" in line for line in client.post("/api/vehicles/check", json={"form": grams}).json()["warnings"]
        )
        bad = client.post("/api/vehicles/check", json={"form": {**FORM, "numbers": {"mass_kg": 1.0}}}).json()
        assert bad["problem"] == "vehicle file: geometry is missing"
        assert (
            "b is -1"
            in client.post("/api/vehicles/check", json={"toml": good["toml"].replace("b = 1.5", "b = -1.0")}).json()[
                "problem"
            ]
        )
        assert client.get("/api/vehicles").json() == []
        problem(client.post("/api/vehicles", json={"form": {**FORM, "numbers": {"mass_kg": 1.0}}}), 422)
        problem(client.post("/api/vehicles", json={}), 422)
        problem(client.post("/api/vehicles", json={"form": {**FORM, "numbers": {"wingspan": 1.0}}}), 422)


def test_a_vehicle_file_goes_in_and_comes_out_whole(tmp_path: Path) -> None:
    station = Station(tmp_path, vehicle="iitb-mav")
    with serving(station.app) as client:
        (own,) = client.get("/api/vehicles").json()
        assert (own["id"], own["editable"]) == ("station", False)
        text = client.get("/api/vehicles/station/toml")
        assert text.headers["content-disposition"] == 'attachment; filename="station.toml"'
        path = tmp_path / "elsewhere.toml"
        path.write_text(text.text)
        before, after = load_vehicle("iitb-mav"), load_vehicle(path)
        assert (after.mass, after.controls, after.sensors) == (before.mass, before.controls, before.sensors)
        copy = client.post("/api/vehicles", json={"toml": text.text}).json()
        assert copy["id"] == "iitb-mav"
        problem(client.put("/api/vehicles/station", json={"toml": text.text}), 409)
        problem(client.delete("/api/vehicles/station"), 409)
        view = client.get("/api/vehicles/iitb-mav").json()
        assert view["versions"] == [1]
        assert view["reading"]["toml"] == text.text
        assert len(view["reading"]["form"]["bench"]["alpha"]["points"]) > 20
        problem(client.get("/api/vehicles/..%2F..%2Fetc"), 404)


@pytest.mark.parametrize(
    ("asked", "status"),
    [
        (
            {
                "way": "bifilar",
                "mass_kg": 1.3,
                "length_m": 1.2,
                "spacing_m": 0.5,
                "times_s": [15.9, 15.7],
                "swings": 10,
            },
            200,
        ),
        ({"way": "swing", "mass_kg": 1.3, "length_m": 0.3, "times_s": [13.0, 13.1], "swings": 10}, 200),
        ({"way": "bifilar", "mass_kg": 1.3, "length_m": 1.2, "times_s": [13.0], "swings": 10}, 422),
        ({"way": "swing", "mass_kg": 1.3, "length_m": 9.0, "times_s": [60.2], "swings": 10}, 409),
        ({"way": "swing", "mass_kg": 1.3, "length_m": 1.0, "times_s": [], "swings": 10}, 422),
    ],
)
def test_swings_become_a_moment_of_inertia(tmp_path: Path, asked: dict[str, object], status: int) -> None:
    with serving(Station(tmp_path).app) as client:
        answer = client.post("/api/vehicles/inertia", json=asked)
        if status != 200:
            problem(answer, status)
            return
        found = answer.raise_for_status().json()
        assert 0.0 < found["std"] < found["value"] < 0.2
        assert json.dumps(found)


def test_a_flight_without_a_known_aircraft_shows_its_signals_all_the_same(tmp_path: Path) -> None:
    station = Station(tmp_path)
    flight = station.record(1, 3, START)
    with serving(station.app) as client:
        summary = client.get(f"/api/flights/{flight}").json()
        assert "phi" in summary["signals"]
        assert any("which aircraft this was is not known" in line for line in summary["warnings"])
        assert "no aircraft is known" in summary["aircraft"]["problem"]
        seen = client.get(f"/api/flights/{flight}/signals", params={"names": "phi"}).json()["signals"]["phi"]
        assert seen["value"][1] == pytest.approx(0.01)


@pytest.mark.parametrize(
    "toml",
    [
        "sensors=3",
        "calibration=3",
        "[controls.elevator]\nservo=2\n[mass]\nmass=1\n[controls.rudder]\nservo=4\n[geometry]\nb=1\n",
        "[mass]\nmass=1\n[geometry]\nb=1e200\nS=1\nc=1\n",
        f"[mass]\nmass=1\n[geometry]\nb={'9' * 400}\nS=1\nc=1\n",
        f"[mass]\nmass={'9' * 5000}\n",
        "[mass]\nmass=1\nIxx=0.02\nIyy=0.03\nIzz=0.045\n[geometry]\nS=0.2\nb=1\nc=0.2\n[flight]\nairspeed=1e-320\n",
    ],
)
def test_a_text_that_no_aircraft_has_is_a_sentence(tmp_path: Path, toml: str) -> None:
    with serving(Station(tmp_path).app) as client:
        for draft in ({"toml": toml}, {"toml": toml, "form": {"name": "x"}}):
            answer = client.post("/api/vehicles/check", json=draft)
            assert answer.status_code == 200
            assert answer.json()["problem"]


def test_what_nobody_can_have_measured_is_no_number(tmp_path: Path) -> None:
    tiny = {"way": "bifilar", "mass_kg": 1.0, "length_m": 5e-324, "spacing_m": 1.0, "times_s": [3.0], "swings": 1}
    with serving(Station(tmp_path).app) as client:
        assert "nobody has measured" in problem(client.post("/api/vehicles/inertia", json=tiny), 409)
        flight = client.patch("/api/flights/x", json={"titel": "y"})
        assert "titel: no such key here" in problem(flight, 422)
        assert "send a JSON object, with" in problem(client.patch("/api/flights/x"), 422)
        described = client.get("/openapi.json").json()["paths"]
        assert "application/toml" in described["/api/vehicles/{vehicle_id}/toml"]["get"]["responses"]["200"]["content"]
        assert "400" in described["/api/flights/{flight_id}"]["patch"]["responses"]


def test_a_coefficient_that_changed_is_found_among_an_aircrafts_flights(tmp_path: Path) -> None:
    station = Station(tmp_path)
    with serving(station.app) as client:
        client.post("/api/vehicles", json={"form": FORM})
        assert client.get("/api/vehicles/bixler-2/trends").json() == []
        ids = []
        for number in range(8):
            ids.append(station.record(1, 1, START + 60 * number * SECOND))
            job = station.catalogue.add_job(ids[-1], "identify", {"kind": "identify", "vehicle": "bixler-2@1"})
            chance = 0.004 * (-1) ** number
            coefficients = {
                "CL_alpha": {"value": 4.5 + chance, "std": 0.01},
                "Cm_de": {"value": (-1.0 if number < 4 else -0.9) + chance, "std": 0.01},
                "Cl_r": {"refused": "nothing moved"},
            }
            model = {"schema": "model/1", "name": "x", "coefficients": coefficients}
            station.catalogue.finish_job(job, {"schema": "identification/1", "model": model})
        other = station.record(1, 1, START + 6000 * SECOND)
        station.catalogue.finish_job(
            station.catalogue.add_job(other, "identify", {"kind": "identify", "vehicle": "bixler-22@1"}),
            {"model": {"coefficients": {"CL_alpha": {"value": 9.0, "std": 0.01}}}},
        )
        found = {one["name"]: one for one in client.get("/api/vehicles/bixler-2/trends").json()}
        assert set(found) == {"CL_alpha", "Cm_de"}
        assert [one["flight"] for one in found["CL_alpha"]["estimates"]] == ids
        assert found["CL_alpha"]["change"] is None
        assert found["Cm_de"]["change"]["flight"] == ids[4]
        assert found["Cm_de"]["change"]["after"] == pytest.approx(-0.9, abs=0.01)


def test_a_plan_of_the_next_flight_is_a_job_with_a_model(tmp_path: Path) -> None:
    station = Station(tmp_path, vehicle="iitb-mav")
    flight = station.record(1, 1, START)
    model = {"schema": "model/1", "name": "x", "coefficients": {"CL_0": {"value": 0.2}}, "effects": []}
    with serving(station.app) as client:
        jobs = f"/api/flights/{flight}/jobs"
        assert "design needs a model" in problem(client.post(jobs, json={"kind": "design"}), 409)
        assert "no design result yet" in problem(client.get(f"/api/flights/{flight}/design"), 404)
        problem(client.post(jobs, json={"kind": "design", "model": model, "limits": {"wings": 3}}), 422)
        problem(client.post(jobs, json={"kind": "design", "model": model, "duration": 2}), 422)
        begun = client.post(jobs, json={"kind": "design", "model": model, "duration": 30, "limits": {"alpha": 3}})
        assert begun.status_code == 202
        wait_until(lambda: client.get(f"/api/jobs/{begun.json()['id']}").json()["state"] == "done")
        assert client.get(f"/api/jobs/{begun.json()['id']}").json()["report"] is None
        assert client.get(f"/api/flights/{flight}/design").json()["name"] == "iitb-mav"
