"""The REST interface over the real application, with flights recorded from MAVLink bytes."""

import json
import os
import re
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from serving import serving
from traffic import SECOND, Vehicle, batch, wait_until

from gcs.api import create_app
from gcs.catalogue.decimate import decimate
from gcs.catalogue.intake import Leftover, Recovery
from gcs.catalogue.retention import Retention, RetentionRule
from gcs.catalogue.store import Catalogue
from gcs.jobs.runner import JobRunner
from gcs.links.opening import UdpLink, open_link
from gcs.mavlink.dialect import Dialect
from gcs.settings import Settings
from gcs.station.recorder import FlightRecorder
from gcs.station.station import RecordingStation

START = 1_800_000_000 * SECOND
TOKEN = "correct-horse-battery"
WORKER = """
import json, sys
order = json.loads(sys.stdin.readline())
print(json.dumps({"progress": 0.5, "log": "half way"}), flush=True)
model = {"schema": "model/1", "name": "found", "coefficients": {"CL_0": {"value": 0.25}}, "effects": []}
json.dump({"schema": "identification/1", "flights": ["one"], "model": model}, open(order["output"], "w"))
"""


class Bench:
    """The application on a data folder of its own."""

    def __init__(self, folder: Path, **changes: Any) -> None:
        settings = Settings(data=folder, vehicle="iitb-mav", max_upload_bytes=1_000_000)
        self.settings = replace(settings, **changes)
        self.catalogue = Catalogue(self.settings.database)
        # The station's clock stands still ahead of the flights, whose silence must not end them meanwhile.
        self.recorder = FlightRecorder(self.settings.flights, Dialect.load(), self.catalogue, silence_s=1000.0)
        self.link = open_link("udpin:127.0.0.1:0")
        self.station = RecordingStation([self.link], self.recorder, clock=lambda: START + 30 * SECOND)
        jobs = JobRunner(self.settings, self.catalogue, (sys.executable, "-c", WORKER))
        self.app = create_app(self.settings, self.catalogue, self.station, jobs)

    def record(self, system: int, seconds: int, start_ns: int) -> str:
        """A flight of ATTITUDE with a growing roll angle; its id."""
        vehicle = Vehicle(system)
        vehicle.boot_ms = 5000
        for second in range(seconds):
            frames = [vehicle.heartbeat(), vehicle.system_time()]
            for i in range(50):
                frames.append(vehicle.attitude(0.01 * (50 * second + i)))
                vehicle.boot_ms += 20
            self.recorder.feed("udpin:test", batch(frames, start_ns + second * SECOND))
        self.recorder.end_flights(start_ns + seconds * SECOND)
        return self.catalogue.flights()[0].id


@pytest.fixture
def make_bench(tmp_path: Path) -> Iterator[Callable[..., Bench]]:
    made: list[Bench] = []

    def make(**changes: Any) -> Bench:
        made.append(Bench(tmp_path, **changes))
        return made[-1]

    yield make
    for bench in made:
        bench.station.stop()
        bench.catalogue.close()


@pytest.fixture
def bench(make_bench: Callable[..., Bench]) -> Bench:
    return make_bench()


@pytest.fixture
def client(bench: Bench) -> Iterator[httpx.Client]:
    with serving(bench.app) as made:
        yield made


def problem(answer: Any, status: int) -> str:
    """The sentence of an error, after checking its form."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    body = answer.json()
    assert body["status"] == status
    assert body["detail"]
    assert "\n" not in body["detail"]
    return str(body["detail"])


def test_health_and_links(client: httpx.Client) -> None:
    health = client.get("/api/health").json()
    assert health["status"] == "ok"
    assert (health["links_connected"], health["links_total"]) == (1, 1)
    assert health["disk_free_bytes"] > 0
    (link,) = client.get("/api/links").json()
    assert link["connected"] is True
    assert link["frames"] == link["raw_bytes"] == 0


def test_health_tells_of_jobs_that_wait_and_of_frames_that_are_not_passed_on(
    make_bench: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs.jobs.runner._RETRY_S", 0.01)
    bench = make_bench()
    other = open_link("udpin:127.0.0.1:0")
    bench.station = RecordingStation([bench.link], bench.recorder, [other], clock=lambda: START + 30 * SECOND)
    jobs = JobRunner(bench.settings, bench.catalogue, (sys.executable, "-c", WORKER))
    app = create_app(bench.settings, bench.catalogue, bench.station, jobs)
    broken = threading.Event()
    take_job, send_frames = bench.catalogue.take_job, other.send_frames

    def unless_broken(do: Callable[..., Any], *arguments: Any) -> Any:
        if broken.is_set():
            raise ValueError("out of order")
        return do(*arguments)

    monkeypatch.setattr(bench.catalogue, "take_job", lambda: unless_broken(take_job))
    monkeypatch.setattr(other, "send_frames", lambda frames: unless_broken(send_frames, frames))
    with serving(app) as client, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        assert isinstance(bench.link, UdpLink)
        sender.connect(("127.0.0.1", bench.link.port))
        vehicle = Vehicle()

        def health(words: str) -> bool:
            sender.send(vehicle.attitude())
            told = client.get("/api/health").json()
            return words in told["problem"] and (told["status"] == "degraded") == bool(words)

        broken.set()
        wait_until(lambda: health("frames are not passed on: ValueError: out of order"))
        monkeypatch.setattr(other, "send_frames", send_frames)
        jobs._wake.set()
        wait_until(lambda: health("jobs wait: ValueError: out of order"))
        broken.clear()
        wait_until(lambda: client.get("/api/health").json()["status"] == "ok")


def test_health_tells_of_recordings_that_cannot_be_deleted_or_recovered(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench()
    bench.settings.flights.mkdir(exist_ok=True)
    whole = bench.record(1, 1, START)
    recording = bench.settings.flights / f"{whole}.mcap"
    jobs = JobRunner(bench.settings, bench.catalogue, (sys.executable, "-c", WORKER))
    retention = Retention(bench.settings.flights, bench.catalogue, RetentionRule(keep_bytes=0))
    left = Leftover("gone", (recording.with_name("gone.mcap"),), None)
    recovery = Recovery([left], bench.catalogue, lambda flight: None)
    app = create_app(bench.settings, bench.catalogue, bench.station, jobs, (retention, recovery))
    job = bench.catalogue.add_job(whole, "identify", {})
    bench.catalogue.finish_job(job, {"schema": "identification/1"})
    recording.unlink()
    recording.mkdir()  # nothing that unlinking can delete
    with serving(app) as client, closing(retention):
        recovery.start()
        wait_until(lambda: "flight gone is not recovered yet" in client.get("/api/health").json()["problem"])
        retention.start()
        wait_until(lambda: "recordings cannot be deleted" in client.get("/api/health").json()["problem"])
        assert client.get("/api/health").json()["status"] == "degraded"


def test_flights_come_in_pages_newest_first(bench: Bench, client: httpx.Client) -> None:
    made = [bench.record(system, 1, START + 60 * system * SECOND) for system in (1, 2, 3)]
    first = client.get("/api/flights", params={"limit": 2}).json()
    assert [flight["id"] for flight in first["flights"]] == made[:0:-1]
    rest = client.get("/api/flights", params={"limit": 2, "after": first["next"]}).json()
    assert [flight["id"] for flight in rest["flights"]] == made[:1]
    assert rest["next"] is None
    found = client.get("/api/flights", params={"search": made[1]}).json()
    assert [flight["id"] for flight in found["flights"]] == [made[1]]


def test_a_flights_summary(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(7, 2, START)
    summary = client.get(f"/api/flights/{flight}").json()
    assert summary["system"] == 7
    assert summary["start"] == "2027-01-15T08:00:00.000Z"
    assert summary["messages"] == 2 * 52
    assert summary["topics"]["/mavlink/7/1/ATTITUDE"] == 100
    assert summary["lost"] == 0
    assert {"phi", "p"} <= set(summary["signals"])
    assert summary["jobs"] == []


def test_the_recording_with_ranges(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(1, 1, START)
    whole = (bench.settings.flights / f"{flight}.mcap").read_bytes()
    path = f"/api/flights/{flight}/recording"
    assert client.get(path).content == whole
    part = client.get(path, headers={"Range": "bytes=10-19"})
    assert (part.status_code, part.content) == (206, whole[10:20])
    assert client.get(path, headers={"Range": "bytes=-5"}).content == whole[-5:]
    assert client.get(path, headers={"Range": f"bytes={len(whole) + 1}-"}).status_code == 416


def test_signals_are_thinned_and_cut_to_a_time(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(1, 4, START)
    path = f"/api/flights/{flight}/signals"
    whole = client.get(path, params={"names": "phi"}).json()["signals"]["phi"]
    assert (whole["unit"], len(whole["value"])) == ("rad", 200)
    assert whole["value"] == pytest.approx([0.01 * i for i in range(200)], abs=1e-6)
    thin = client.get(path, params={"names": "phi,theta", "points": 20}).json()["signals"]
    assert set(thin) == {"phi", "theta"}
    assert len(thin["phi"]["value"]) <= 20
    assert (min(thin["phi"]["value"]), max(thin["phi"]["value"])) == pytest.approx((0.0, 1.99), abs=1e-6)
    part = client.get(path, params={"names": "phi", "start": 1.0, "end": 2.0}).json()["signals"]["phi"]
    assert all(1.0 <= at <= 2.0 for at in part["time"])
    assert 49 <= len(part["time"]) <= 51
    assert "nope" in problem(client.get(path, params={"names": "phi,nope"}), 404)


def test_thinning_keeps_every_peak_and_the_order_of_time() -> None:
    generator = np.random.default_rng(5)
    time = np.arange(10_000) / 50.0
    values = generator.normal(size=time.size)
    values[[777, 8888]] = 50.0, -60.0
    values[5000:5400] = np.nan
    kept_time, kept = decimate(time, values, 200)
    assert kept.size <= 200
    assert (np.diff(kept_time) > 0).all()
    assert {50.0, -60.0} <= set(kept.tolist())
    assert np.isnan(kept).any()


def tlog(frames: list[bytes], start_us: int = START // 1000) -> bytes:
    """A telemetry log as Mission Planner writes it: 8-byte big-endian microseconds before each frame."""
    return b"".join((start_us + 20_000 * i).to_bytes(8, "big") + frame for i, frame in enumerate(frames))


def test_uploads_as_form_and_as_body(client: httpx.Client) -> None:
    data = tlog(Vehicle(3).second())
    form = client.post("/api/flights", files={"file": ("../../flight one.tlog", data)})
    assert form.status_code == 201, form.text
    made = form.json()
    assert (made["name"], made["source"], made["system"]) == ("flight one.tlog", "upload", 3)
    assert made["messages"] == 52
    body = client.post("/api/flights", params={"name": "flight.tlog"}, content=data)
    assert body.status_code == 201
    assert body.json()["id"] != made["id"]
    recording = client.get(f"/api/flights/{made['id']}/recording").content
    again = client.post("/api/flights", params={"name": "copy.mcap"}, content=recording)
    assert again.json()["messages"] == 52
    assert made["note"] == ""
    for copy in (body.json(), again.json()):
        assert copy["note"].startswith(f"flight {made['id']} has as many messages between the same instants")
    other = client.post("/api/flights", params={"name": "x.tlog"}, content=tlog(Vehicle(3).second(), START)).json()
    assert other["note"] == ""


def test_an_upload_that_was_cut_off_says_so_for_good(bench: Bench, client: httpx.Client) -> None:
    whole = client.get(f"/api/flights/{bench.record(5, 4, START)}/recording").content
    made = client.post("/api/flights", params={"name": "cut.mcap"}, content=whole[:-60]).json()
    told = client.get(f"/api/flights/{made['id']}").json()
    assert made["messages"] > 0
    assert any("cut off before it was taken in" in line for line in told["damage"])


def test_uploads_that_are_no_recordings_leave_nothing_behind(bench: Bench, client: httpx.Client) -> None:
    assert ".exe" in problem(client.post("/api/flights", files={"file": ("x.exe", b"MZ")}), 422)
    problem(client.post("/api/flights", files={"file": ("x.mcap", b"this is no MCAP file")}), 422)
    problem(client.post("/api/flights", files={"other": (None, b"no file")}), 422)
    assert "holds no file; send it" in problem(client.post("/api/flights", content=b""), 422)
    for empty in (
        client.post("/api/flights", files={"file": ("none.mcap", b"")}),
        client.post("/api/flights", params={"name": "none.mcap"}, content=b""),
    ):
        assert problem(empty, 422).startswith("none.mcap is empty; send")
    large = bytes(bench.settings.max_upload_bytes + 1)
    assert "larger" in problem(client.post("/api/flights", params={"name": "x.tlog"}, content=large), 413)
    chunked = client.post("/api/flights", params={"name": "x.tlog"}, content=iter([large[:600_000], large[:600_000]]))
    assert "larger" in problem(chunked, 413)
    assert client.get("/api/flights").json()["flights"] == []
    assert list(bench.settings.flights.iterdir()) == []
    assert not list(bench.settings.data.glob("upload-*"))


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (b'{"kind": identify}', "the body is no JSON (Expecting value, at character 9); send a JSON object such as"),
        (b'{"kind": "\xff"}', "the body is no JSON; send a JSON object such as"),
        (b"", "the body is missing or no JSON object; send"),
        (b"[]", "the body is missing or no JSON object; send"),
        (b"{}", "kind is missing"),
        (b'{"kind": "identify", "valdate": [], "x": 1}', "valdate, x: no such key in a job; did you mean validate?"),
        (b'{"kind": "identify", "vehicle": "a"}', "vehicle: no such key in a job; there are kind, model, structure"),
        (b'{"kind": "fly"}', "kind: Input should be 'identify' or 'discrepancy'"),
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
    assert job["report"] is None
    page = client.get(ended["report"])
    assert page.headers["content-type"] == "text/html; charset=utf-8"
    assert "default-src 'none'" in page.headers["content-security-policy"]
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
        ({"kind": "identify", "vehicle": "/etc/passwd"}, 422, "vehicle"),
        ({"kind": "identify", "method": "magic"}, 422, "method"),
        ({"kind": "discrepancy"}, 409, "model"),
        ({"kind": "discrepancy", "model": "../../etc/passwd"}, 404, "no model"),
        ({"kind": "identify", "validate": ["../x"]}, 404, "no flight"),
    ],
)
def test_job_requests_that_cannot_work(
    bench: Bench, client: httpx.Client, body: dict[str, Any], status: int, words: str
) -> None:
    flight = bench.record(1, 1, START)
    assert words in problem(client.post(f"/api/flights/{flight}/jobs", json=body), status)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("/api/flights/..%2f..%2fetc%2fpasswd", "nothing at"),
        ("/api/flights/nope", "no flight 'nope'"),
        ("/api/jobs/x", "no job 'x'"),
        ("/api/models/x", "no model 'x'"),
        ("/api/none", "nothing at /api/none"),
    ],
)
def test_what_is_not_there_is_a_problem_with_a_sentence(client: httpx.Client, path: str, words: str) -> None:
    assert words in problem(client.get(path), 404)


def test_without_a_vehicle_file_jobs_and_signals_say_so(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(vehicle=None)
    with serving(bench.app) as client:
        flight = bench.record(1, 1, START)
        assert "--vehicle" in problem(client.post(f"/api/flights/{flight}/jobs", json={"kind": "identify"}), 409)
        assert "--vehicle" in problem(client.get(f"/api/flights/{flight}/signals", params={"names": "p"}), 404)
        assert client.get(f"/api/flights/{flight}").json()["messages"] == 52


def test_a_token_is_demanded_everywhere_but_for_health(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(token=TOKEN, host="0.0.0.0")
    with serving(bench.app) as client:
        assert client.get("/api/health").status_code == 200
        schema = client.get("/openapi.json").json()
        right = {"Authorization": f"Bearer {TOKEN}"}
        for path, methods in schema["paths"].items():
            for method in methods:
                if path == "/api/health":
                    continue
                url = path.replace("{flight_id}", "x").replace("{job_id}", "x").replace("{model_id}", "x")
                for headers in ({}, {"Authorization": "Bearer wrong"}, {"Authorization": f"Basic {TOKEN}"}):
                    answer = client.request(method, url, headers=headers)
                    assert answer.headers["www-authenticate"] == "Bearer"
                    assert "Authorization" in problem(answer, 401)
                # Events never end: what matters comes before the body.
                with client.stream(method, url, headers=right) as allowed:
                    assert allowed.status_code != 401
        assert "<title>Ground station</title>" in client.get("/").text
        assert not bench.catalogue.flights()


def test_pages_of_other_sites_get_nothing(client: httpx.Client) -> None:
    problem(client.get("/api/flights", headers={"Origin": "http://evil.example"}), 403)
    problem(client.get("/api/flights", headers={"Host": "evil.example"}), 403)
    assert client.get("/api/flights", headers={"Origin": str(client.base_url)}).status_code == 200


def test_openapi_describes_every_route_of_the_interface(client: httpx.Client) -> None:
    schema = client.get("/openapi.json").json()
    routes = {f"{method.upper()} {path}" for path, methods in schema["paths"].items() for method in methods}
    assert routes == {
        "GET /api/health",
        "GET /api/links",
        "GET /api/flights",
        "POST /api/flights",
        "GET /api/flights/{flight_id}",
        "GET /api/flights/{flight_id}/recording",
        "GET /api/flights/{flight_id}/signals",
        "POST /api/flights/{flight_id}/jobs",
        "GET /api/jobs/{job_id}",
        "GET /api/flights/{flight_id}/identification",
        "GET /api/flights/{flight_id}/discrepancy",
        "GET /api/flights/{flight_id}/report",
        "GET /api/models",
        "GET /api/models/{model_id}",
        "GET /api/live",
        "GET /api/live/stream",
    }
    body = schema["components"]["schemas"]["JobRequest"]["properties"]
    assert {"kind", "model", "structure", "prior", "validate", "method", "from", "to", "system"} == set(body)
    assert client.get("/docs").status_code == 200


def test_links_show_losses_noise_and_the_vehicles_clock(bench: Bench) -> None:
    vehicle = Vehicle(9)
    for second in range(30):
        frames = vehicle.second()
        del frames[10:15]
        # The vehicle's clock runs 100 ppm fast.
        at = START + round(second * SECOND * (1 - 100e-6))
        bench.recorder.feed(bench.link.name, batch([b"noise!", *frames], at))
    (status,) = bench.station.link_status()
    (system,) = status["systems"]  # type: ignore[misc]
    assert status["raw_bytes"] == 30 * 6
    assert system["components"] == [
        {"component": 1, "received": 30 * 47, "lost": 150, "duplicates": 0, "loss": pytest.approx(5 / 52)}
    ]
    assert system["clock_drift_ppm"] == pytest.approx(100.0, abs=5.0)
    assert system["clock_offset_s"] == pytest.approx(START / 1e9, abs=0.1)
    assert status["frames_per_s"] == pytest.approx(47, rel=0.2)
    json.dumps(status)


def test_a_message_of_an_unknown_dialect_is_counted(bench: Bench) -> None:
    frame = bytearray(Vehicle().attitude())
    frame[7:10] = (60_000).to_bytes(3, "little")  # an id that no dialect of ours has
    crc = mavlink.x25crc(bytes(frame[1:-2]))
    crc.accumulate(bytes([77]))
    frame[-2:] = crc.crc.to_bytes(2, "little")
    bench.recorder.feed("udpin:test", batch([bytes(frame)] * 3, START))
    assert bench.recorder.statistics("udpin:test", START)["unknown_messages"] == 3


def test_a_vehicle_that_is_renamed_has_its_new_name_on_the_live_page(
    make_bench: Callable[..., Bench], tmp_path: Path
) -> None:
    file = tmp_path / "plane.toml"
    text = (
        "name = 'first'\n[mass]\nmass = 1\nIxx = 0.02\nIyy = 0.03\nIzz = 0.045\n[geometry]\nS = 0.2\nb = 1\nc = 0.2\n"
    )
    file.write_text(text, encoding="utf-8")
    with serving(make_bench(vehicle=str(file)).app) as client:
        assert client.get("/api/live").json()["vehicle"] == "first"
        for changed, name in ((text.replace("first", "second"), "second"), ("half writ", "plane"), (text, "first")):
            file.write_text(changed, encoding="utf-8")
            os.utime(file, ns=(0, file.stat().st_mtime_ns + SECOND))  # however coarse the disk's clock
            assert client.get("/api/live").json()["vehicle"] == name
            with client.stream("GET", "/api/live/stream") as events:
                told = next(line for line in events.iter_lines() if line.startswith("data: "))
            assert json.loads(told.removeprefix("data: "))["vehicle"] == name


def test_captions_of_wide_tables_stay_in_sight() -> None:
    """Both the page's and the report's; the browser's test measures it where there is one."""
    for style in ("gcs/page/static/page.css", "gcs/report/style.css"):
        text = (Path(__file__).resolve().parents[3] / style).read_text(encoding="utf-8")
        assert re.search(r"\.wide \{[^}]*container-type: inline-size", text), style
        assert re.search(r"caption \{[^}]*max-width: 100cqi; position: sticky; left: 0", text), style
