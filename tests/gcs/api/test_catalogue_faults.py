"""A catalogue that is damaged, or that another program holds: what is said, and what goes on."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import httpx
import pytest
from api_bench import START, Bench, problem
from serving import serving
from traffic import SECOND, wait_until

pytestmark = pytest.mark.whole_flight


def damage(path: Path) -> dict[int, bytes]:
    """Overwrite the pages of the notes and outlines; what stood there."""
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        (size,) = db.execute("PRAGMA page_size").fetchone()
        tables = "('flight_notes', 'sqlite_autoindex_flight_notes_1', 'flight_outlines')"
        pages = [page for (page,) in db.execute(f"SELECT rootpage FROM sqlite_master WHERE name IN {tables}")]
    before = {}
    with path.open("r+b") as file:
        for page in pages:
            file.seek((page - 1) * size)
            before[(page - 1) * size] = file.read(size)
            file.seek((page - 1) * size)
            file.write(bytes(range(1, 256)) * (size // 255) + bytes(size % 255))
    return before


def test_damage_under_a_running_service_is_said_until_it_starts_again(bench: Bench, client: httpx.Client) -> None:
    bench.record(1, 3, START)
    wait_until(lambda: client.get("/api/ready").status_code == 200)
    whole = damage(bench.settings.database)
    # Nobody but who asks for readiness has read it, and it is the disk that is read.
    assert "damaged" in problem(client.get("/api/ready"), 503)
    assert "gcs repair" in client.get("/api/health").json()["problem"]
    problem(client.get("/api/flights"), 503)
    # Recording goes on, which is no sign that all is well again.
    bench.record(2, 3, START + 100 * SECOND)
    with bench.settings.database.open("r+b") as file:
        for at, content in whole.items():
            file.seek(at)
            file.write(content)
    assert client.get("/api/health").json()["status"] == "degraded"
    assert "damaged" in problem(client.get("/api/ready"), 503)


def test_damage_from_before_the_start_is_found_and_flights_are_recorded_all_the_same(
    make_bench: Callable[..., Bench],
) -> None:
    first = make_bench()
    first.record(1, 3, START)
    first.catalogue.close()
    damage(first.settings.database)
    second = make_bench()
    with serving(second.app) as client:
        # Nothing else is asked for that would come upon it.
        wait_until(lambda: "the catalogue is damaged" in client.get("/api/health").json()["problem"])
        made = second.record(3, 3, START + 100 * SECOND)
        assert (second.settings.flights / f"{made}.mcap").is_file()


def test_who_reads_waits_for_nobody_that_writes(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(1, 3, START)

    def write(_: int) -> tuple[int, str | None]:
        answer = httpx.patch(f"{client.base_url}/api/flights/{flight}", json={"title": "x"}, timeout=60.0)
        return answer.status_code, answer.headers.get("retry-after")

    def health() -> str:
        return str(client.get("/api/health").json()["problem"])

    with closing(sqlite3.connect(bench.settings.database, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        assert "another program holds" in health()
        with ThreadPoolExecutor(45) as pool:
            writing = pool.map(write, range(45))
            assert client.get("/api/flights", timeout=10.0).status_code == 200
            assert "another program holds" in health()
            assert "another program holds" in problem(client.get("/api/ready"), 503)
            assert set(writing) == {(503, "30")}
        other.execute("ROLLBACK")
        assert health() == ""
    assert client.get("/api/ready").status_code == 200
    assert client.patch(f"/api/flights/{flight}", json={"title": "x"}).status_code == 200
