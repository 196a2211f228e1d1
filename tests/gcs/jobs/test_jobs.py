"""Jobs run in processes of their own; their workers here are small programs with known behaviour."""

import json
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from processes import service
from traffic import SECOND, Vehicle, batch, wait_until

from gcs.catalogue.job_table import Job
from gcs.catalogue.store import Catalogue
from gcs.errors import CatalogueError, CatalogueFileError, JobError, QueueFullError
from gcs.jobs.runner import JobRunner
from gcs.mavlink.dialect import Dialect
from gcs.settings import Settings
from gcs.station.recorder import FlightRecorder

pytestmark = pytest.mark.whole_flight

GOOD = """
import json, sys, os
order = json.loads(sys.stdin.readline())
assert all(os.path.isfile(path) for path in order["recordings"])
print(json.dumps({"progress": 0.5, "log": "half way"}), flush=True)
print("a library that prints", flush=True)
models = {name: json.load(open(path)) for name, path in order["models"].items()}
result = {"kind": order["kind"], "method": order["method"], "start": order["start"], "models": models,
          "model": {"schema": "model/1", "name": "found", "coefficients": {"CL_0": {"value": 0.25}}, "effects": []}}
json.dump(result, open(order["output"], "w"))
"""
NAMED_ERROR = """
import json
print(json.dumps({"error": "no airborne part was found; give --from and --to"}), flush=True)
raise SystemExit(1)
"""
NOTHING = """
import json
print(json.dumps({"nothing": "the aircraft never flew"}), flush=True)
"""
ODD_PROGRESS = """
import sys
sys.stdin.readline()
for odd in ('"n/a"', "NaN", "[]", "1e999", "null"):
    print('{"progress": %s, "log": "odd"}' % odd, flush=True)
raise SystemExit("gave up")
"""
NOT_TEXT = r"""
import os, sys
os.write(1, b"\xff\xfe\n")
sys.stdin.read()
"""
CRASH = "raise RuntimeError('boom')"
KILLED = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"
ENDLESS = """
import json, sys, threading
sys.stdin.readline()
print(json.dumps({"progress": 0.1, "log": "running"}), flush=True)
sys.stdin.read()
"""


class Bench:
    """A data folder with one recorded flight."""

    def __init__(self, folder: Path) -> None:
        self.settings = Settings(data=folder, vehicle="iitb-mav")
        self.catalogue = Catalogue(self.settings.database)
        recorder = FlightRecorder(self.settings.flights, Dialect.load(), self.catalogue)
        recorder.feed("test", batch(Vehicle().second(), 1_800_000_000 * SECOND))
        recorder.close(1_800_000_001 * SECOND)
        self.flight = self.catalogue.flights()[0].id
        self.runners: list[JobRunner] = []

    def runner(self, program: str) -> JobRunner:
        runner = JobRunner(self.settings, self.catalogue, (sys.executable, "-c", program))
        self.runners.append(runner)
        runner.start()
        return runner

    def run(self, program: str, request: dict[str, Any]) -> Job:
        """One job from start to end."""
        job = self.runner(program).submit(self.flight, request)
        return wait_until(lambda: self.ended(job.id))

    def ended(self, job_id: str) -> Job | None:
        job = self.catalogue.job(job_id)
        return job if job.state in ("done", "failed", "skipped") else None


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path)
    yield made
    for runner in made.runners:
        runner.stop()
    made.catalogue.close()


def test_a_job_leaves_its_result_its_model_and_its_log(bench: Bench) -> None:
    job = bench.run(GOOD, {"kind": "identify", "method": "ee", "from": 0.5})
    assert (job.state, job.progress, job.error) == ("done", 1.0, None)
    assert job.log == ["half way", "a library that prints"]
    result = bench.catalogue.result(bench.flight, "identify")
    assert (result["method"], result["start"]) == ("ee", 0.5)
    assert bench.catalogue.model(job.id)["coefficients"]["CL_0"]["value"] == 0.25
    wait_until(lambda: not list(bench.settings.jobs.iterdir()))  # the folder goes after the job is told to be done


def test_a_model_reaches_the_worker_by_id_and_as_json(bench: Bench) -> None:
    found = bench.run(GOOD, {"kind": "identify"})
    given = {"schema": "model/1", "name": "given", "coefficients": {"Cm_q": {"value": -9.0}}, "effects": []}
    bench.runners[0].stop()
    bench.run(GOOD, {"kind": "discrepancy", "model": found.id, "prior": given})
    result = bench.catalogue.result(bench.flight, "discrepancy")
    assert result["models"]["model"]["name"] == "found"
    assert result["models"]["prior"]["coefficients"]["Cm_q"]["value"] == -9.0


@pytest.mark.parametrize(
    ("program", "words"),
    [
        (NAMED_ERROR, "no airborne part"),
        (CRASH, "RuntimeError: boom"),
        (KILLED, "signal 9"),
        (ODD_PROGRESS, "gave up"),
        (NOT_TEXT, "UnicodeDecodeError"),
    ],
)
def test_a_job_that_fails_says_why(bench: Bench, program: str, words: str) -> None:
    job = bench.run(program, {"kind": "identify"})
    assert job.state == "failed"
    assert words in (job.error or "")
    assert "\n" not in (job.error or "")
    following = bench.runners[0].submit(bench.flight, {"kind": "identify"})  # the thread is still there
    assert wait_until(lambda: bench.ended(following.id)).state == "failed"


def test_a_worker_that_dies_before_it_has_read_its_order_leaves_nothing_open(bench: Bench) -> None:
    longer_than_a_pipe = [bench.flight] * 5000
    job = bench.run(KILLED, {"kind": "identify", "validate": longer_than_a_pipe})
    assert (job.state, job.error) == ("failed", "the worker was ended by signal 9; is there enough memory?")


@pytest.mark.parametrize(
    ("longest_s", "memory_bytes", "program", "words"),
    [
        (0.5, None, "import time; time.sleep(600)", "not done after"),
        (60.0, 300_000_000, "", "more memory than 300 MB"),
    ],
)
def test_a_job_that_takes_too_much_is_ended_and_says_what_to_do(
    bench: Bench, longest_s: float, memory_bytes: int | None, program: str, words: str
) -> None:
    greedy = (
        "import sys\nfrom gcs.jobs import worker\n"
        "worker.run = lambda order: bytearray(10**9)\nsys.exit(worker.main())\n"
    )
    command = (sys.executable, "-c", program or greedy)
    runner = JobRunner(bench.settings, bench.catalogue, command, longest_s, memory_bytes)
    bench.runners.append(runner)
    runner.start()
    job = runner.submit(bench.flight, {"kind": "identify"})
    ended = wait_until(lambda: bench.ended(job.id))
    assert ended.state == "failed"
    assert ended.error is not None
    assert words in ended.error
    assert "take a part of the flight" in ended.error


def test_a_job_with_nothing_to_do_is_skipped_and_says_why(bench: Bench) -> None:
    job = bench.run(NOTHING, {"kind": "identify", "automatic": True})
    assert (job.state, job.progress, job.error) == ("skipped", 1.0, None)
    assert job.log[-1] == "the aircraft never flew"
    with pytest.raises(CatalogueError, match=r"no identify result yet \(the aircraft never flew\)"):
        bench.catalogue.result(bench.flight, "identify")


NO_MODEL = {"schema": "model/1", "coefficients": {}}


@pytest.mark.parametrize(
    ("request_", "error", "words"),
    [
        ({"kind": "paint"}, JobError, "kind"),
        ({"kind": "discrepancy"}, JobError, "model"),
        ({"kind": "discrepancy", "model": "nope"}, CatalogueError, "nope"),
        ({"kind": "discrepancy", "model": {"schema": "model/1", "coefficients": {"CX_9": {}}}}, JobError, "CX_9"),
        ({"kind": "identify", "validate": ["nope"]}, CatalogueError, "nope"),
        ({"kind": "discrepancy", "model": NO_MODEL, "rule_out": ["mass"]}, JobError, "unknown effect 'mass'"),
        ({"kind": "identify", "rule_out": ["mass_error"]}, JobError, "looks for no effects"),
        ({"kind": "discrepancy", "model": NO_MODEL, "method": "oe"}, JobError, "one of auto, map, fe, not oe"),
    ],
)
def test_what_cannot_work_is_refused_at_once(
    bench: Bench, request_: dict[str, Any], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        bench.runner(GOOD).submit(bench.flight, request_)


def test_a_job_interrupted_by_a_stop_runs_again_at_the_next_start(bench: Bench) -> None:
    job = bench.runner(ENDLESS).submit(bench.flight, {"kind": "identify"})
    wait_until(lambda: bench.catalogue.job(job.id).log)
    bench.runners[0].stop()
    assert bench.catalogue.job(job.id).state == "running"
    bench.runner(GOOD)
    done = wait_until(lambda: bench.ended(job.id))
    assert (done.state, done.attempts) == ("done", 2)


@pytest.mark.whole_flight
def test_the_real_worker_reports_a_recording_without_a_flight_in_words(bench: Bench) -> None:
    runner = JobRunner(bench.settings, bench.catalogue)
    bench.runners.append(runner)
    runner.start()
    job = runner.submit(bench.flight, {"kind": "identify"})
    ended = wait_until(lambda: bench.ended(job.id))
    assert ended.state == "failed"
    assert ended.error
    assert "Error" not in ended.error
    assert "Traceback" not in json.dumps(ended.to_json())


@pytest.mark.whole_flight
def test_a_flight_that_ended_just_before_the_service_did_is_identified_after_its_next_start(bench: Bench) -> None:
    assert bench.catalogue.jobs_of(bench.flight) == []
    with service("--data", bench.settings.data, "--vehicle", "iitb-mav"):
        (job,) = wait_until(lambda: bench.catalogue.jobs_of(bench.flight))
    assert (job.kind, job.request["automatic"], job.request["system"]) == ("identify", True, 1)


def test_a_cancelled_job_ends_at_once_and_the_next_one_runs(bench: Bench) -> None:
    runner = bench.runner(ENDLESS)
    running = runner.submit(bench.flight, {"kind": "identify"})
    waiting = runner.submit(bench.flight, {"kind": "identify"})
    wait_until(lambda: bench.catalogue.job(running.id).log == ["running"])
    assert runner.cancel(waiting.id).state == "cancelled"
    assert runner.cancel(running.id).state == "cancelled"
    following = runner.submit(bench.flight, {"kind": "identify"})
    wait_until(lambda: bench.catalogue.job(following.id).log == ["running"])
    assert [bench.catalogue.job(job.id).state for job in (running, waiting)] == ["cancelled", "cancelled"]
    with pytest.raises(JobError, match=r"is over .cancelled.; there is nothing to cancel"):
        runner.cancel(running.id)


def test_a_result_that_comes_after_its_job_was_cancelled_is_not_kept(bench: Bench) -> None:
    job = bench.catalogue.add_job(bench.flight, "identify", {"kind": "identify"})
    assert bench.catalogue.cancel_job(job.id)
    bench.catalogue.finish_job(job, {"model": {"name": "late"}})
    bench.catalogue.fail_job(job.id, "late")
    assert (bench.catalogue.job(job.id).state, bench.catalogue.models()) == ("cancelled", [])


def test_what_a_person_asks_for_comes_before_what_the_station_queued_itself(bench: Bench) -> None:
    runner = JobRunner(bench.settings, bench.catalogue)
    automatic = [runner.submit(bench.flight, {"kind": "identify", "automatic": True}) for _ in range(3)]
    asked = runner.submit(bench.flight, {"kind": "identify"}, "somebody")
    taken = [bench.catalogue.take_job() for _ in range(2)]
    assert [job.id for job in taken if job is not None] == [asked.id, automatic[0].id]
    assert [job.owner for job in taken if job is not None] == ["somebody", "station"]


def test_the_queue_has_an_end_and_what_the_station_queues_leaves_room_for_a_person(bench: Bench) -> None:
    runner = JobRunner(bench.settings, bench.catalogue)
    for _ in range(50):
        runner.submit(bench.flight, {"kind": "identify", "automatic": True})
    with pytest.raises(QueueFullError, match="50 jobs wait already"):
        runner.submit(bench.flight, {"kind": "identify", "automatic": True})
    for _ in range(100):
        runner.submit(bench.flight, {"kind": "identify"})
    with pytest.raises(QueueFullError, match="100 jobs wait already; cancel some"):
        runner.submit(bench.flight, {"kind": "identify"})


def test_a_job_that_is_over_is_forgotten_with_its_result_and_model(bench: Bench) -> None:
    job = bench.run(GOOD, {"kind": "identify"})
    bench.runners[0].delete(job.id)
    assert bench.catalogue.models() == []
    for missing in (
        lambda: bench.catalogue.job(job.id),
        lambda: bench.catalogue.result(bench.flight, "identify"),
        lambda: bench.runners[0].delete(job.id),
    ):
        with pytest.raises(CatalogueError):
            missing()
    bench.runners[0].stop()
    waiting = bench.runners[0].submit(bench.flight, {"kind": "identify"})
    with pytest.raises(JobError, match=r"is not over; POST .*cancel ends it"):
        bench.runners[0].delete(waiting.id)


def test_what_a_job_took_of_the_machine_is_kept(bench: Bench) -> None:
    runner = JobRunner(bench.settings, bench.catalogue)
    bench.runners.append(runner)
    runner.start()
    job = runner.submit(bench.flight, {"kind": "identify"})
    over = wait_until(lambda: bench.ended(job.id))
    assert over.cpu_s is not None
    assert 0.1 < over.cpu_s < 120.0
    assert over.peak_bytes is not None
    assert 20e6 < over.peak_bytes < 4e9


def test_an_identification_that_a_person_deleted_is_not_made_again_by_itself(bench: Bench) -> None:
    assert [flight.id for flight in bench.catalogue.unidentified_flights()] == [bench.flight]
    job = bench.run(GOOD, {"kind": "identify"})
    bench.runners[0].delete(job.id)
    assert bench.catalogue.unidentified_flights() == []
    assert bench.catalogue.identified_flights() == {bench.flight}


def test_a_job_that_ran_while_the_disk_was_full_runs_again_when_there_is_room(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = threading.Event()
    full.set()
    report, requeue = bench.catalogue.report_progress, bench.catalogue.requeue_interrupted_jobs

    def refused(*given: Any) -> None:
        if full.is_set():
            raise CatalogueFileError("the disk is full")
        report(*given)

    def not_now(*given: Any) -> None:
        if full.is_set():
            raise CatalogueFileError("the disk is full")
        requeue(*given)

    runner = bench.runner(GOOD)
    monkeypatch.setattr(bench.catalogue, "report_progress", refused)
    monkeypatch.setattr(bench.catalogue, "requeue_interrupted_jobs", not_now)
    monkeypatch.setattr("gcs.jobs.runner._RETRY_S", 0.05)
    job = runner.submit(bench.flight, {"kind": "identify"})
    wait_until(lambda: "the disk is full" in runner.problem)
    wait_until(lambda: bench.catalogue.job(job.id).state == "running")
    full.clear()
    over = wait_until(lambda: bench.ended(job.id))
    assert over.state == "done"
    assert "the catalogue could not be written while this job ran; queued again" in over.log
