"""Jobs over REST, from request to model, and requests that cannot work."""

import io
import zipfile
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import httpx
import pytest
from api_bench import START, Bench, problem
from serving import serving
from traffic import SECOND, wait_until

pytestmark = pytest.mark.whole_flight


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (b'{"kind": identify}', "the body is no JSON (Expecting value, at character 9); send a JSON object such as"),
        (b'{"kind": "\xff"}', "the body is no JSON; send a JSON object such as"),
        (b"", "the body is missing or no JSON object; send"),
        (b"[]", "the body is missing or no JSON object; send"),
        (b"{}", "kind is missing"),
        (b'{"kind": "identify", "valdate": [], "x": 1}', "valdate, x: no such key in a job; did you mean validate?"),
        (b'{"kind": "identify", "aircraft": "a"}', "aircraft: no such key in a job; there are kind, model, structure"),
        (b'{"kind": "fly"}', "kind: Input should be 'identify', 'discrepancy' or 'design'"),
    ],
)
def test_a_job_that_cannot_be_read_says_what_to_send(
    bench: Bench, client: httpx.Client, body: bytes, told: str
) -> None:
    flight = bench.record(1, 1, START)
    kind = {"Content-Type": "application/json"}
    answer = client.post(f"/api/flights/{flight}/jobs", content=body, headers=kind)
    assert told in problem(answer, 400 if b"\xff" in body else 422)


def test_json_without_its_content_type_is_told_so(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(1, 1, START)
    answer = client.post(f"/api/flights/{flight}/jobs", content=b'{"kind": "identify"}')
    assert "Content-Type: application/json" in problem(answer, 422)


def test_a_result_that_nobody_judged_does_not_hide_the_validated_one_in_silence(
    bench: Bench, client: httpx.Client
) -> None:
    flight = bench.record(1, 1, START)
    judged = bench.catalogue.add_job(flight, "identify", {"kind": "identify", "validate": ["other"]})
    result = {"schema": "identification/1", "validation": {"flights": ["other"]}}
    bench.catalogue.finish_job(judged, result)
    started = client.post(f"/api/flights/{flight}/jobs", json={"kind": "identify"}).json()
    place = f"/api/flights/{flight}/identification?job={judged.id}"
    assert "validated on other" in started["log"][0]
    assert started["log"][0].endswith(place)
    wait_until(lambda: client.get(f"/api/jobs/{started['id']}").json()["state"] == "done")
    assert "validation" not in client.get(f"/api/flights/{flight}/identification").json()
    assert client.get(place).json() == result
    assert "of job 'x'" in problem(client.get(f"/api/flights/{flight}/identification?job=x"), 404)
    # A job that is judged itself, and one behind a result that was not, need no warning.
    for request in ({"kind": "identify", "validate": [flight]}, {"kind": "identify"}):
        log = client.post(f"/api/flights/{flight}/jobs", json=request).json()["log"]
        assert not any("validated on" in line for line in log)


@pytest.mark.whole_flight
def test_a_job_from_request_to_model(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(1, 1, START)
    assert "no identify result" in problem(client.get(f"/api/flights/{flight}/identification"), 404)
    answer = client.post(f"/api/flights/{flight}/jobs", json={"kind": "identify", "from": 0.5, "validate": [flight]})
    assert answer.status_code == 202
    job = answer.json()
    assert job["request"]["from"] == 0.5

    def done() -> dict[str, Any] | None:
        state = client.get(f"/api/jobs/{job['id']}").json()
        return state if state["state"] in ("done", "failed") else None

    ended = wait_until(done)
    assert (ended["state"], ended["progress"], ended["log"]) == ("done", 1.0, ["half way"])
    assert client.get(f"/api/flights/{flight}/identification").json()["schema"] == "identification/1"
    (model,) = client.get("/api/models").json()
    assert model["flight_id"] == flight
    assert client.get(f"/api/models/{model['id']}").json()["coefficients"] == {"CL_0": {"value": 0.25}}
    assert client.get(f"/api/flights/{flight}").json()["jobs"][0]["state"] == "done"
    table = client.get(f"/api/models/{model['id']}/export?to=csv")
    assert table.headers["content-disposition"] == f'attachment; filename="model-{model["id"]}-csv.zip"'
    with zipfile.ZipFile(io.BytesIO(table.content)) as archive:
        assert archive.read(f"model-{model['id']}.csv").splitlines()[1].startswith(b"CL_0,0.25,")
    paper = client.get(f"/api/models/{model['id']}/export?to=latex")
    assert (paper.headers["content-disposition"][-5:], paper.text.count("toprule")) == ('.tex"', 1)
    gazebo = client.get(f"/api/models/{model['id']}/export?to=gazebo").content
    with zipfile.ZipFile(io.BytesIO(gazebo)) as archive:
        assert [name.partition("/")[2] for name in archive.namelist()] == ["model.config", "model.sdf"]
    with zipfile.ZipFile(io.BytesIO(client.get(f"/api/models/{model['id']}/export?to=jsbsim").content)) as archive:
        assert any(name.endswith("/flat.xml") for name in archive.namelist())
        assert len(archive.namelist()) == 3
    assert b"<DAVEfunc" in client.get(f"/api/models/{model['id']}/export?to=daveml").content
    unknown = problem(client.get(f"/api/models/{model['id']}/export?to=x"), 422)
    assert "'jsbsim', 'gazebo', 'daveml', 'csv' or 'latex'" in unknown
    assert "no model 'x'" in problem(client.get("/api/models/x/export?to=csv"), 404)
    assert job["report"] is None
    page = client.get(ended["report"])
    assert page.headers["content-type"] == "text/html; charset=utf-8"
    assert "default-src 'none'" in page.headers["content-security-policy"]
    assert "img-src data:" in page.headers["content-security-policy"]  # pictures of figures that are no drawings
    assert "<title>Flight model of found from one</title>" in page.text
    assert '<data value="0.25">0.25</data>' in page.text
    assert "no discrepancy result" in problem(client.get(f"/api/flights/{flight}/report?of=discrepancy"), 404)
    assert "'identification' or 'discrepancy'" in problem(client.get(f"/api/flights/{flight}/report?of=x"), 422)
    other = bench.catalogue.add_job(flight, "discrepancy", {})
    bench.catalogue.finish_job(other, {"schema": "unheard/9"})
    assert "unheard/9" in problem(client.get(f"/api/flights/{flight}/report?of=discrepancy"), 400)


@pytest.mark.parametrize(
    ("body", "status", "words"),
    [
        ({"kind": "paint"}, 422, "kind"),
        ({}, 422, "kind"),
        ({"kind": "identify", "vehicle": "/etc/passwd"}, 404, "names no aircraft"),
        ({"kind": "identify", "vehicle": "../../etc"}, 404, "names no aircraft"),
        ({"kind": "identify", "method": "magic"}, 422, "method"),
        ({"kind": "discrepancy"}, 409, "model"),
        ({"kind": "discrepancy", "model": "../../etc/passwd"}, 404, "no model"),
        ({"kind": "identify", "validate": ["../x"]}, 404, "no flight"),
        ({"kind": "identify", "from": 30, "to": 10}, 422, "to (10 s) is not later than from (30 s): give a part"),
        ({"kind": "identify", "to": 0}, 422, "to (0 s) is not later than from (0 s)"),
        ({"kind": "identify", "from": 30}, 409, "from (30 s) is beyond the flight's end: it lasts 1.0 s"),
        ({"kind": "identify", "validate": ["noise"]}, 409, "flight noise holds no message of a vehicle"),
    ],
)
def test_job_requests_that_cannot_work(
    bench: Bench, client: httpx.Client, body: dict[str, Any], status: int, words: str
) -> None:
    flight = bench.record(1, 1, START)
    known = bench.catalogue.flight(flight)
    bench.catalogue.put_flight(replace(known, id="noise", system=None))
    bench.catalogue.put_flight(replace(known, vehicle_s=1.0))
    assert words in problem(client.post(f"/api/flights/{flight}/jobs", json=body), status)
    assert bench.catalogue.jobs_of(flight) == []


def test_without_an_aircraft_jobs_say_what_to_do(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(vehicle=None)
    with serving(bench.app) as client:
        flight = bench.record(1, 1, START)
        assert "--vehicle" in problem(client.post(f"/api/flights/{flight}/jobs", json={"kind": "identify"}), 409)
        assert client.get(f"/api/flights/{flight}").json()["messages"] == 52


def test_jobs_are_cancelled_run_again_with_other_settings_and_deleted(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(1, 1, START)
    first = client.post(f"/api/flights/{flight}/jobs", json={"kind": "identify", "method": "ee"}).json()
    wait_until(lambda: client.get(f"/api/jobs/{first['id']}").json()["state"] == "done")
    assert "is over (done)" in problem(client.post(f"/api/jobs/{first['id']}/cancel"), 409)
    again = client.post(f"/api/jobs/{first['id']}/rerun", json={"method": "oe", "from": 0.25}).json()
    assert again["request"] == {**first["request"], "method": "oe", "from": 0.25}
    assert again["id"] != first["id"]
    assert first["owner"] == again["owner"] == "127.0.0.1"
    assert client.post(f"/api/jobs/{first['id']}/rerun").json()["request"] == first["request"]
    assert "from" in problem(client.post(f"/api/jobs/{first['id']}/rerun", json={"from": 5, "to": 3}), 422)
    assert "to" in problem(client.post(f"/api/jobs/{again['id']}/rerun", json={"to": 0.1}), 422)
    assert "kind: no such key" in problem(client.post(f"/api/jobs/{first['id']}/rerun", json={"kind": "fly"}), 422)
    wait_until(lambda: client.get(f"/api/jobs/{again['id']}").json()["state"] == "done")
    assert client.delete(f"/api/jobs/{first['id']}").status_code == 204
    assert first["id"] in problem(client.get(f"/api/jobs/{first['id']}"), 404)
    for address in ("cancel", "rerun"):
        assert "there is no job" in problem(client.post(f"/api/jobs/nothing/{address}"), 404)


def test_a_deleted_flight_is_gone_until_it_is_restored(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(1, 1, START)
    assert client.delete(f"/api/flights/{flight}").status_code == 204
    assert client.get("/api/flights").json()["flights"] == []
    assert [one["id"] for one in client.get("/api/flights?deleted=true").json()["flights"]] == [flight]
    for answer in (
        client.get(f"/api/flights/{flight}"),
        client.get(f"/api/flights/{flight}/recording"),
        client.delete(f"/api/flights/{flight}"),
        client.post(f"/api/flights/{flight}/jobs", json={"kind": "identify"}),
    ):
        assert f"POST /api/flights/{flight}/restore takes that back until" in problem(answer, 404)
    assert client.post(f"/api/flights/{flight}/restore").json()["id"] == flight
    assert client.get(f"/api/flights/{flight}").json()["messages"] > 0
    assert client.get(f"/api/flights/{flight}/recording").status_code == 200


def test_what_a_plan_promised_stands_beside_what_the_flight_gave(bench: Bench, client: httpx.Client) -> None:
    before, after = (bench.record(1, 1, START + 600 * number * SECOND) for number in range(2))
    entry = {"name": "Cm_q", "value": -10.0, "std": 0.5, "percent": 5.0}
    plan = {"schema": "design/1", "gusts": 0.3, "coefficients": [entry, {**entry, "name": "CL_q", "std": 0.2}]}
    assert "no design result" in problem(client.post(f"/api/flights/{before}/design/upload"), 404)
    bench.catalogue.finish_job(bench.catalogue.add_job(before, "design", {"kind": "design"}), {**plan, "files": {}})
    assert "no script was made" in problem(client.post(f"/api/flights/{before}/design/upload"), 409)
    files = {"plan.lua": "-- fly"}
    bench.catalogue.finish_job(bench.catalogue.add_job(before, "design", {"kind": "design"}), {**plan, "files": files})
    assert "no vehicle with system id 1 is heard" in problem(client.post(f"/api/flights/{before}/design/upload"), 409)
    assert "no identify result" in problem(client.get(f"/api/flights/{after}/planned"), 404)
    for flight in (before, after):
        model = {"schema": "model/1", "name": "a", "coefficients": {"Cm_q": {"value": -9.0, "std": 0.4}}}
        bench.catalogue.finish_job(bench.catalogue.add_job(flight, "identify", {"kind": "identify"}), {"model": model})
    late = "no flight of this aircraft was planned"
    for seconds in (900, 300):
        with bench.catalogue._transaction() as db:
            db.execute("UPDATE results SET created_ns = ? WHERE kind = 'design'", (START + seconds * SECOND,))
        if seconds == 900:
            assert late in problem(client.get(f"/api/flights/{after}/planned"), 404)  # flown before it was planned
    found = client.get(f"/api/flights/{after}/planned").json()
    assert (found["flight"], found["made"], found["gusts"]) == (before, "2027-01-15T08:05:00.000Z", 0.3)
    assert found["coefficients"] == [
        {"name": "Cm_q", "expected_std": 0.5, "reached_std": 0.4},
        {"name": "CL_q", "expected_std": 0.2, "reached_std": None},
    ]
    assert late in problem(client.get(f"/api/flights/{before}/planned"), 404)
    with bench.catalogue._transaction() as db:  # a plan of another aircraft
        db.execute("UPDATE jobs SET request = ? WHERE kind = 'design'", ('{"vehicle": "thor@1"}',))
    assert late in problem(client.get(f"/api/flights/{after}/planned"), 404)


MODEL = {"schema": "model/1", "name": "mine", "coefficients": {"CL_0": {"value": 0.25}}, "effects": []}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"prior": {**MODEL, "name": 201 * "N"}}, "NNNNNNNNNNNNNNNNNNNN… has 201 characters"),
        ({"prior": {**MODEL, "validity": {201 * "v": [0, 1]}}}, "vvvvvvvvvvvvvvvvvvvv… has 201 characters"),
        ({"structure": 201 * "s"}, "has 201 characters"),
        ({"prior": {**MODEL, "coefficients": {f"C{n}": {} for n in range(501)}}}, "at most 500 coefficients"),
        ({"as_recorded": [201 * "s"]}, "at most 200 characters"),
    ],
)
def test_a_model_of_longer_texts_than_any_has_is_refused(
    bench: Bench, client: httpx.Client, given: dict[str, object], said: str
) -> None:
    flight = bench.record(1, 1, START)
    assert said in problem(client.post(f"/api/flights/{flight}/jobs", json={"kind": "identify", **given}), 422)
    assert client.get(f"/api/flights/{flight}").json()["jobs"] == []


def test_models_that_came_with_jobs_are_named_in_a_summary_and_whole_in_the_job(
    bench: Bench, client: httpx.Client
) -> None:
    flight = bench.record(1, 1, START)
    asked = {"kind": "identify", "prior": MODEL, "structure": {**MODEL, "name": "other"}}
    job = client.post(f"/api/flights/{flight}/jobs", json=asked).json()["id"]
    wait_until(lambda: client.get(f"/api/jobs/{job}").json()["state"] == "done")
    second = client.post(f"/api/flights/{flight}/jobs", json={"kind": "identify", "prior": job}).json()["id"]
    newest, oldest = (one["request"] for one in client.get(f"/api/flights/{flight}").json()["jobs"])
    assert client.get(f"/api/jobs/{second}").json()["request"]["prior"] == newest["prior"] == job
    assert (oldest["prior"], oldest["structure"]) == ({"name": "mine"}, {"name": "other"})
    assert "model" not in oldest
    assert client.get(f"/api/jobs/{job}").json()["request"]["prior"] == MODEL


def test_what_is_cancelled_and_asked_for_again_does_not_grow_without_end(bench: Bench, client: httpx.Client) -> None:
    flight, other = bench.record(1, 1, START), bench.record(1, 1, START + 60 * SECOND)
    made = [bench.catalogue.add_job(flight, "discrepancy", {"kind": "discrepancy"}) for _ in range(100)]
    for one in made:
        bench.catalogue.cancel_job(one.id)
    assert len(client.get(f"/api/flights/{flight}").json()["jobs"]) == 50
    wanted = {"kind": "identify"}
    said = problem(client.post(f"/api/flights/{flight}/jobs", json=wanted), 409)
    assert "100 jobs of flight" in said
    assert client.post(f"/api/flights/{other}/jobs", json=wanted).status_code == 202
    client.delete(f"/api/jobs/{made[0].id}").raise_for_status()
    assert client.post(f"/api/flights/{flight}/jobs", json=wanted).status_code == 202


def test_a_job_done_again_with_one_large_model_after_another_stays_small(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(1, 1, START)
    large = {**MODEL, "validity": {f"{n}{190 * 'v'}": [0.0, 1.0] for n in range(700)}}
    asked = {"kind": "identify", "prior": large}
    job = client.post(f"/api/flights/{flight}/jobs", json=asked)
    assert job.status_code == 202
    again = client.post(f"/api/jobs/{job.json()['id']}/rerun", json={"structure": large})
    assert "may take 256 kB" in problem(again, 409)
