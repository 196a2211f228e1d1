"""What goes wrong between a client and a station: one exception, one line, and never the token."""

from __future__ import annotations

import asyncio
import json
import pickle
import socket
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any

import pytest
from api_bench import START, TOKEN, Bench
from other_servers import Reply, answering, replying

from gcs.client import AsyncStation, Station, StationError, operations
from gcs.errors import SettingsError

pytestmark = pytest.mark.whole_flight

JOB = {
    **dict.fromkeys(("started_ns", "ended_ns", "cpu_s", "peak_bytes", "error"), None),
    **{"id": "a1", "flight_id": "f", "kind": "identify", "request": {}, "state": "running", "progress": 0.25},
    **{"attempts": 1, "created_ns": 0, "owner": "", "priority": 1, "log": []},
}
PROBLEM = {"title": "x", "status": 503, "detail": f"busy\n\x1b[31m{TOKEN}"}


def ask_plainly(url: str, token: str, timeout: float) -> None:
    with Station(url, token, timeout) as station:
        station.links()


def ask_from_asyncio(url: str, token: str, timeout: float) -> None:
    async def ask() -> None:
        async with AsyncStation(url, token, timeout) as station:
            await station.links()

    asyncio.run(ask())


def silent(handler: BaseHTTPRequestHandler) -> None:
    time.sleep(1.0)


Ask = Callable[[str, str, float], None]
both = pytest.mark.parametrize("ask", [ask_plainly, ask_from_asyncio])


def refused(ask: Callable[[], Any]) -> StationError:
    with pytest.raises(StationError) as error:
        ask()
    text = str(error.value)
    assert text.isprintable()
    assert TOKEN not in text
    assert len(text) < 700
    return error.value


@both
def test_a_wrong_token_and_none_are_named(url: str, ask: Ask) -> None:
    wrong = refused(lambda: ask(url, "another-token", 30.0))
    assert (wrong.status, str(wrong)) == (401, f"{url} demands its token, and it is not the one given")
    none = refused(lambda: ask(url, "", 30.0))
    assert (none.status, "none was given" in str(none)) == (401, True)


@both
def test_where_nobody_listens_it_says_where(ask: Ask) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        url = f"http://127.0.0.1:{free.getsockname()[1]}"
    error = refused(lambda: ask(url, TOKEN, 30.0))
    assert error.status is None
    assert str(error).startswith(f"{url} cannot be reached")


@both
@pytest.mark.parametrize(
    ("reply", "status", "words"),
    [
        (silent, None, "was silent for 0.4 s"),
        (replying(200, b"<html>a printer</html>"), None, "not a ground station's"),
        (replying(200, b'{"printers": 2}'), None, "not a ground station's"),
        (replying(200, b"[", length=9), None, "the connection with"),
        (replying(404, b"<html>not found</html>"), 404, "HTTP 404 and no reason"),
        (replying(302, b"", Location="/login"), 302, "sends elsewhere"),
        (replying(503, json.dumps(PROBLEM).encode()), 503, "busy [31mTOKEN"),
        (replying(500, json.dumps({**PROBLEM, "detail": "x" * 9000}).encode()), 500, "xxx…"),
    ],
)
def test_what_is_no_station_or_a_broken_one_is_one_line(ask: Ask, reply: Reply, status: int | None, words: str) -> None:
    with answering(reply) as url:
        error = refused(lambda: ask(url, TOKEN, 0.4 if reply is silent else 30.0))
    assert (error.status, words in str(error)) == (status, True), str(error)


def test_a_refusal_is_the_stations_own_sentence(url: str, bench: Bench, tmp_path: Path) -> None:
    flight = bench.record(1, 1, START)
    noise = tmp_path / "noise.mcap"
    noise.write_bytes(b"no recording")
    large = tmp_path / "large.tlog"
    large.write_bytes(bytes(bench.settings.max_upload_bytes + 1))
    with Station(url, TOKEN) as station:
        for status, words, ask in (
            (404, "nothing at /api/flights/x/../y", lambda: station.flight("x/../y")),
            (404, "no flight 'x?y#z'", lambda: station.flight("x?y#z")),
            (422, "did you mean validate", lambda: station.identify(flight, valdate=[])),
            (409, "model", lambda: station.discrepancy(flight)),
            (404, "no job 'x'", lambda: station.job("x")),
            (404, "no job 'x'", lambda: station.wait("x")),
            (404, "no identify result", lambda: station.result(flight, "identify")),
            (404, "has 1 parts, no part 2", lambda: station.download(flight, tmp_path / "no.mcap", part=2)),
            (422, "part", lambda: station.download(flight, tmp_path / "no.mcap", part=0)),
            (422, "noise.mcap", lambda: station.upload(noise)),
            (413, "larger than", lambda: station.upload(large)),
            (None, "is no id", lambda: station.delete("..")),
        ):
            error = refused(ask)
            assert (error.status, words in str(error)) == (status, True), str(error)
        assert not list(tmp_path.glob("*no.mcap*"))
        assert len(station.flights()) == 1
    assert pickle.loads(pickle.dumps(error)).status == error.status


def test_files_of_this_computer_fail_as_files_do(url: str, bench: Bench, tmp_path: Path) -> None:
    flight = bench.record(1, 1, START)
    with Station(url, TOKEN) as station:
        with pytest.raises(FileNotFoundError, match=r"none\.mcap"):
            station.upload(tmp_path / "none.mcap")
        for place in (tmp_path, tmp_path / "no" / "folder.mcap"):
            with pytest.raises(OSError, match=str(place.parent)):
                station.download(flight, place)


def test_half_a_recording_leaves_what_was_there(tmp_path: Path) -> None:
    target = tmp_path / "copy.mcap"
    target.write_bytes(b"what was there")
    with answering(replying(200, b"half", length=8)) as url, Station(url) as station:
        refused(lambda: station.download("a", target))
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"what was there"]


@pytest.mark.parametrize(
    ("url", "token", "timeout"),
    [
        ("ftp://host", "", 1.0),
        ("http://", "", 1.0),
        ("http://host:99999", "", 1.0),
        ("http://ho st\n", "", 1.0),
        ("http://host/?a=1", "", 1.0),
        ("http://me:secret-of-mine@host", "", 1.0),
        ("http://host", "secret-of-\nmine", 1.0),
        ("http://host", "secret-of-mine…", 1.0),
        ("http://host", "", 0.0),
    ],
)
def test_what_cannot_be_meant_is_refused_without_its_secret(url: str, token: str, timeout: float) -> None:
    for client in (Station, AsyncStation):
        with pytest.raises(SettingsError) as error:
            client(url, token, timeout)
        assert str(error.value).isprintable()
        assert "secret" not in str(error.value)


def test_an_address_needs_no_scheme_and_may_have_a_path() -> None:
    def reply(handler: BaseHTTPRequestHandler) -> None:
        replying(404, json.dumps({**PROBLEM, "detail": handler.path}).encode())(handler)

    with answering(reply) as url, Station(f"{url.removeprefix('http://')}/behind/a/proxy/") as station:
        assert str(refused(station.links)) == "/behind/a/proxy/api/links"


def jobs(*replies: Reply) -> tuple[Reply, list[float]]:
    """One reply after the other, the last for ever; and when each was asked for."""
    asked: list[float] = []

    def reply(handler: BaseHTTPRequestHandler) -> None:
        asked.append(time.monotonic())
        replies[min(len(asked), len(replies)) - 1](handler)

    return reply, asked


def job_reply(**changes: Any) -> Reply:
    return replying(200, json.dumps({**JOB, **changes}).encode())


def test_waiting_sits_out_an_outage_but_not_a_wrong_address(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = replying(200, b"[", length=9)
    busy = replying(503, json.dumps(PROBLEM).encode())
    failed = job_reply(state="failed", error="no lift", log=["one", "two"], progress=1.0)
    reply, asked = jobs(job_reply(state="queued"), busy, broken, failed)
    shown: list[tuple[float, str]] = []
    with answering(reply) as url, Station(url) as station:
        over = station.wait("a1", 60.0, lambda share, text: shown.append((share, text)))
    assert (over.state, over.error, len(asked)) == ("failed", "no lift", 4)
    assert shown == [(0.25, "queued"), (1.0, "two")]
    reply, asked = jobs(busy)
    with answering(reply) as url, Station(url, TOKEN) as station:
        assert refused(lambda: station.wait("a1")).status == 503
    assert len(asked) == 1
    monkeypatch.setattr(operations, "_LONGEST_OUTAGE_S", 0.5)
    reply, asked = jobs(job_reply(), broken)
    with answering(reply) as url, Station(url) as station:
        assert refused(lambda: station.wait("a1")).status is None
    assert asked[-1] - asked[0] >= 0.5


def test_waiting_ends_in_time_and_says_that_the_job_goes_on() -> None:
    began = time.monotonic()
    with answering(job_reply()) as url, Station(url) as station:
        error = refused(lambda: station.wait("a1", 0.3))
    assert str(error) == "job a1 is still running after 0.3 s; it goes on at the station"
    assert 0.3 <= time.monotonic() - began < 60.0
