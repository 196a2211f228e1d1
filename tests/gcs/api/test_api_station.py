"""Health, links and the live side over REST: the real application, with flights recorded from MAVLink bytes."""

import json
import os
import socket
import sys
import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import pytest
from api_bench import START, WORKER, Bench, problem
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from serving import serving
from traffic import SECOND, Vehicle, batch, wait_until

from gcs.api import create_app
from gcs.catalogue.intake import Leftover, Recovery
from gcs.catalogue.retention import Retention, RetentionRule
from gcs.jobs.runner import JobRunner
from gcs.links.datagrams import Batch
from gcs.links.opening import UdpLink, open_link
from gcs.recording.reader import Recording
from gcs.station.station import RecordingStation

pytestmark = pytest.mark.whole_flight


def test_health_and_links(client: httpx.Client) -> None:
    health = client.get("/api/health").json()
    assert health["status"] == "ok"
    assert (health["links_connected"], health["links_total"]) == (1, 1)
    assert health["disk_free_bytes"] > 0
    (link,) = client.get("/api/links").json()
    assert link["connected"] is True
    assert link["frames"] == link["raw_bytes"] == 0


def test_a_note_made_in_flight_is_kept_in_the_recording(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench()
    with serving(bench.app) as client:
        assert "no flight is being recorded" in problem(client.post("/api/live/notes", json={"text": "x"}), 409)
        vehicle = Vehicle()
        for second in range(25):
            bench.recorder.feed("udpin:test", batch(vehicle.second(), START + second * SECOND))
        long = "rough air over the trees behind the runway, flew the second doublet again"
        made = client.post("/api/live/notes", json={"text": f"  {long} "}).json()
        (flight,) = made["flights"]
        assert made["text"] == long
        assert client.post("/api/live/notes", json={"text": "mark"}).status_code == 201
        bench.station.voice.heartbeat()
        umlauts = "ä" * 60
        assert client.post("/api/live/notes", json={"text": umlauts}).status_code == 201
        for wrong in ({"text": "  "}, {"text": "x" * 201}, {}, {"text": "a\0b"}, {"text": "a\n\x1b[2J"}):
            problem(client.post("/api/live/notes", json=wrong), 422)
        for second in range(25, 40):
            bench.recorder.feed("udpin:test", batch(vehicle.second(), START + second * SECOND))
        bench.recorder.end_flights(START + 41 * SECOND)
        texts = wait_until(lambda: client.get(f"/api/flights/{flight}").json().get("texts"))
        assert [(one["text"], one["note"]) for one in texts] == [(long, True), ("mark", True), (umlauts, True)]
        # The station's clock stands half a minute behind the beginning.
        assert texts[0]["time"] == pytest.approx(30.0, abs=1.5)
    (kept,) = Recording(bench.settings.flights / f"{flight}.mcap").columns("STATUSTEXT", system=255)
    assert kept.fields.size == 6
    # What the station says to vehicles meanwhile, under the same number, is no gap between notes.
    assert not any(Recording(bench.settings.flights / f"{flight}.mcap").lost().values())


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


def test_health_names_a_peer_that_sends_more_than_one_may(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench()
    jobs = JobRunner(bench.settings, bench.catalogue, (sys.executable, "-c", WORKER))
    with serving(create_app(bench.settings, bench.catalogue, bench.station, jobs)) as client:
        assert client.get("/api/health").json()["status"] == "ok"
        peer = bench.link.sources.of(("192.0.2.7", 5000), "192.0.2.7:5000")
        bench.link._take(peer, Batch.of([(bytes(1_000_000), START)] * 22))
        health = client.get("/api/health").json()
        assert health["status"] == "degraded"
        assert "192.0.2.7:5000 sends more than 8 MB a second" in health["problem"]
        assert "(6.0 MB so far)" in health["problem"]
        (link,) = client.get("/api/links").json()
        assert link["refused"] == link["sources"][0]["refused"] == 6_000_000


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
        wait_until(lambda: "the data folder cannot be looked after" in client.get("/api/health").json()["problem"])
        assert client.get("/api/health").json()["status"] == "degraded"


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


def test_two_vehicles_of_one_number_are_said_by_health_and_by_their_flight(bench: Bench, client: httpx.Client) -> None:
    one, other = Vehicle(7), Vehicle(7)
    other.boot_ms = 800_000
    start = START + 24 * SECOND  # the station's clock stands 6 s later
    for second in range(6):
        for part in range(10):
            for source, vehicle in (("udpin:one", one), ("udpin:other", other)):
                frames = [vehicle.heartbeat(), vehicle.attitude()]
                bench.recorder.feed(source, batch(frames, start + second * SECOND + part * SECOND // 10, SECOND // 10))
                vehicle.boot_ms += 100
    health = client.get("/api/health").json()
    assert health["status"] == "degraded"
    assert health["problem"].startswith("two vehicles send as system 7, their clocks 800 s apart")
    bench.recorder.end_flights(start + 6 * SECOND)
    (flight,) = bench.catalogue.flights()
    assert client.get(f"/api/flights/{flight.id}").json()["warnings"][0] == health["problem"]
