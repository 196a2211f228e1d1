"""A station whose jobs are carried out by a Dask cluster: the same result, the same words, and nothing left behind."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest
from dask_cluster import cluster
from distributed import Client
from patience import PATIENCE_S
from processes import service
from traffic import wait_until

from gcs.cli import main
from sim_vehicle.cli.main import main as sim_vehicle

pytestmark = pytest.mark.whole_flight

WORKER = [sys.executable, "-m", "gcs.jobs.clusterworker"]


@pytest.fixture(scope="module")
def workers() -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    with cluster(1) as found:
        yield found


@pytest.fixture(scope="module", autouse=True)
def asking_nobody() -> Iterator[subprocess.Popen[str]]:
    """One that asks where no scheduler is: it waits 10 s for it, beside the other tests."""
    with socket.socket() as nobody:  # who has the port, and does not listen
        nobody.bind(("127.0.0.1", 0))
        command = [*WORKER, f"tcp://127.0.0.1:{nobody.getsockname()[1]}"]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as asking:
            assert asking.stdin is not None
            asking.stdin.write("{}\n")
            asking.stdin.flush()
            yield asking
            asking.kill()


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "flight.mcap"
    assert (
        sim_vehicle(["fly", "--manoeuvre", "multisine", "--duration", "15", "--seed", "4", "--record", str(path)]) == 0
    )
    return path


def test_a_station_sends_its_jobs_to_a_cluster_and_gets_what_it_would_find_itself(
    tmp_path: Path, log: Path, workers: tuple[str, list[subprocess.Popen[bytes]]]
) -> None:
    found: dict[str, dict[str, Any]] = {}
    worker, worked = psutil.Process(workers[1][0].pid), set[str]()

    def ended(station: httpx.Client, job: str, name: str) -> dict[str, Any] | None:
        if worker.children():
            worked.add(name)
        seen: dict[str, Any] = station.get(f"/api/jobs/{job}").json()
        return seen if seen["state"] in ("done", "failed") else None

    # By the quickest method: what is compared is where it is carried out.
    identify = {"kind": "identify", "method": "ee"}
    for name, options in (("here", ()), ("there", ("--scheduler", workers[0]))):
        with (
            service("--data", tmp_path / name, "--vehicle", "iitb-mav", "--no-identify", *options) as url,
            httpx.Client(base_url=url, timeout=PATIENCE_S) as station,
        ):
            flight = station.post(f"/api/flights?name={log.name}", content=log.read_bytes()).json()["id"]
            job = station.post(f"/api/flights/{flight}/jobs", json=identify).json()["id"]
            done = wait_until(lambda: ended(station, job, name), 120.0)  # noqa: B023
            assert done["state"] == "done", done
            assert any("axes" in line for line in done["log"])
            assert done["cpu_s"] > 0.0
            found[name] = station.get(f"/api/flights/{flight}/identification").json()
            cut = station.post(f"/api/flights/{flight}/jobs", json={**identify, "from": 14.9}).json()["id"]
            found[name]["reason"] = wait_until(lambda: ended(station, cut, name), 120.0)["error"]  # noqa: B023
    assert found["here"]["model"]["coefficients"] == found["there"]["model"]["coefficients"]
    assert worked == {"there"}
    assert found["here"]["reason"] == found["there"]["reason"]


def test_a_job_that_nobody_waits_for_any_more_ends(
    tmp_path: Path, log: Path, workers: tuple[str, list[subprocess.Popen[bytes]]]
) -> None:
    # The worker believes a silence of 5 s, not of 20; a station that waits speaks every 2 s. What is asked for by a
    # module, not by a program, is carried out by the module that the worker itself has.
    program = "import sys; from gcs.jobs import clusterworker; sys.exit(clusterworker.main())"
    with Client(workers[0], timeout="60s") as client:  # type: ignore[no-untyped-call]
        client.run(lambda: setattr(import_module("gcs.jobs.clusterworker"), "_GONE_S", 5.0))
    order = {
        "kind": "identify", "recordings": [str(log)], "validate": [], "vehicle": "iitb-mav", "models": {},
        "method": "auto", "start": None, "stop": None, "system": None, "rule_out": [], "as_recorded": [],
        "automatic": False, "plan": {}, "memory_bytes": 4 * 1024**3, "output": str(tmp_path / "result.json"),
    }  # fmt: skip
    command = [sys.executable, "-c", program, workers[0]]
    asking = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert asking.stdin is not None
    asking.stdin.write(json.dumps(order) + "\n")
    asking.stdin.flush()
    worker = psutil.Process(workers[1][0].pid)
    wait_until(worker.children, 60.0)
    for child in worker.children():
        child.suspend()  # as one that takes long
    asking.kill()
    asking.communicate()
    wait_until(lambda: not [one for one in worker.children() if one.status() != psutil.STATUS_ZOMBIE], 60.0)


def test_without_a_scheduler_the_job_says_so(asking_nobody: subprocess.Popen[str]) -> None:
    assert asking_nobody.stdout is not None
    assert "no scheduler answers" in json.loads(asking_nobody.stdout.readline())["error"]
    assert asking_nobody.wait(PATIENCE_S) == 1


def test_what_is_no_address_of_a_scheduler_is_said_at_the_start(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["serve", "--port", "0", "--data", str(tmp_path), "--scheduler", "nonsense"]) == 2
    assert "give the address of a Dask scheduler, tcp://HOST:PORT" in capsys.readouterr().err
