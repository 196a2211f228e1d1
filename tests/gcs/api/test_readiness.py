"""Ready, and what is not."""

import sqlite3
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest
from api_bench import START, TOKEN, WORKER, Bench, problem
from processes import free_port
from serving import serving
from traffic import SECOND, wait_until

from gcs.api import create_app
from gcs.errors import CatalogueFileError
from gcs.jobs.runner import JobRunner
from gcs.links.opening import open_link
from gcs.station.station import RecordingStation


def test_a_service_whose_parts_are_up_is_ready_without_a_token(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(token=TOKEN, host="0.0.0.0")
    with serving(bench.app) as client:
        wait_until(lambda: client.get("/api/ready").status_code == 200)
        answer = client.get("/api/ready").json()
        link = {"url": bench.link.name, "role": "vehicle", "up": True, "problem": ""}
        assert answer == {"ready": True, "links": [link]}


def test_links_that_are_not_up_are_named_with_their_problems(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench()
    nobody, missing = f"tcp:127.0.0.1:{free_port()}", "/dev/no-such-board,57600"
    links = [bench.link, open_link(nobody), open_link(missing)]
    waiting = open_link("tcpin:127.0.0.1:0")  # listens, which is all that it can do
    bench.station = RecordingStation(links, bench.recorder, [waiting], clock=lambda: START + 30 * SECOND)
    jobs = JobRunner(bench.settings, bench.catalogue, (sys.executable, "-c", WORKER))
    with serving(create_app(bench.settings, bench.catalogue, bench.station, jobs)) as client:
        wait_until(lambda: all(one["problem"] for one in client.get("/api/ready").json()["links"][1:3]))
        answer = client.get("/api/ready")
        words = problem(answer, 503)
        first, second = answer.json()["not_ready"]
        assert first.startswith(f"link {nobody}: ")
        assert second.startswith(f"link {missing}: ")
        assert first in words
        assert second in words
        assert [(one["role"], one["up"]) for one in answer.json()["links"]] == [
            ("vehicle", True), ("vehicle", False), ("vehicle", False), ("forward", True)
        ]  # fmt: skip
        assert client.get("/api/health").status_code == 200  # it lives all the same


def test_parts_that_do_not_work_are_named(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    with serving(bench.app) as client:

        def missing() -> Any:
            return client.get("/api/ready").json().get("not_ready", [])

        wait_until(lambda: missing() == [])
        bench.recorder.state.report(OSError("no room"))
        assert missing()[0].startswith("recorder: ")
        bench.recorder.state.recovered()

        broken = threading.Event()

        def check() -> None:
            if broken.is_set():
                raise CatalogueFileError("the catalogue cannot be read")
            time.sleep(0.5)

        monkeypatch.setattr(bench.catalogue, "check", check)
        monkeypatch.setattr("gcs.api.readiness._PATIENCE_S", 0.05)
        assert missing() == ["catalogue: no answer within 0.05 s"]
        broken.set()
        assert missing() == ["catalogue: the catalogue cannot be read"]
        monkeypatch.undo()

        monkeypatch.setattr("gcs.station.station._LATE_S", 0.0)  # as where the thread hangs
        assert missing()[0].startswith("recorder: one of its threads has ended")
        monkeypatch.undo()

        monkeypatch.setattr(JobRunner, "alive", False)
        assert missing()[0].startswith("jobs: their thread has ended")


def test_a_catalogue_that_cannot_be_read_is_named_as_such(bench: Bench) -> None:
    bench.catalogue.check()
    bench.catalogue.close()
    with pytest.raises(CatalogueFileError) as raised:
        bench.catalogue.check()
    assert isinstance(raised.value.__cause__, sqlite3.Error)


def test_a_station_lives_from_its_start_to_the_end_of_a_thread(bench: Bench) -> None:
    assert not bench.station.alive
    bench.station.start()
    assert bench.station.alive
    bench.station.stop()
    assert not bench.station.alive
