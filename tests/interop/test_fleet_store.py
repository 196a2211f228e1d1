"""A fleet's recordings in a store that speaks S3: a batch on a cluster whose workers read them there themselves."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from dask_cluster import cluster
from processes import free_port, run
from traffic import wait_until


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Moto's server, told to whoever reads of S3 by the environment."""
    address = f"http://127.0.0.1:{free_port()}"
    monkeypatch.setenv("AWS_ENDPOINT_URL_S3", address)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "flights")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "flights-of-the-fleet")
    server = [str(Path(sys.executable).with_name("moto_server")), "--port", address.rpartition(":")[2]]
    with subprocess.Popen(server, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            wait_until(lambda: is_there(address), 60.0)
            yield address
        finally:
            process.terminate()


def is_there(address: str) -> bool:
    try:
        return httpx.get(address, timeout=5.0).status_code < 500
    except httpx.TransportError:
        return False


def results(folder: Path) -> list[dict[str, Any]]:
    found = [json.loads(path.read_text()) for path in sorted((folder / "results").glob("*.json"))]
    assert not any("error" in one for one in found), found
    return [one["model"]["coefficients"] for one in found]


def test_workers_read_flights_from_a_store_and_find_what_they_find_in_a_folder(tmp_path: Path, store: str) -> None:
    import s3fs

    flights = tmp_path / "flights"
    flights.mkdir()
    for seed in (1, 2):
        flown = run("sim-vehicle", "fly", "--manoeuvre", "multisine", "--duration", 12, "--seed", seed,
                    "--record", flights / f"flight{seed}.mcap")  # fmt: skip
        assert flown.returncode == 0, flown.stderr
    files = s3fs.S3FileSystem()
    files.mkdir("club")
    files.put(str(flights), "club/flights", recursive=True)
    with cluster(1) as (address, _):
        there = run("gcs", "batch", "s3://club/flights", "--vehicle", "iitb-mav", "-o", tmp_path / "there",
                    "--scheduler", address)  # fmt: skip
    assert there.returncode == 0, there.stderr
    here = run("gcs", "batch", flights, "--vehicle", "iitb-mav", "-o", tmp_path / "here", "--workers", 1)
    assert here.returncode == 0, here.stderr
    assert len(results(tmp_path / "there")) == 2
    assert results(tmp_path / "there") == results(tmp_path / "here")
    files.rm("club/flights/flight1.mcap")
    one = run("gcs", "batch", "s3://club/flights", "--vehicle", "iitb-mav", "-o", tmp_path / "one", "--workers", 1)
    assert "1 of 1 flights identified" in one.stdout
    gone = run("gcs", "batch", "s3://club/none", "--vehicle", "iitb-mav", "-o", tmp_path / "none", "--workers", 1)
    assert gone.returncode == 2
    assert "s3://club/none: no recording or log there" in gone.stderr
