"""Clients that take more than their share: connections, bodies, disk, forms, threads."""

from __future__ import annotations

import contextlib
import socket
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from types import SimpleNamespace

import h11
import httpx
import pytest
from api_bench import START, Bench, problem
from fastapi import FastAPI, Request
from fastapi.responses import StreamingResponse
from mcap.writer import Writer
from patience import PATIENCE_S
from serving import serving
from traffic import wait_until

from gcs.access.token_file import TokenFile
from gcs.api.bodies import BodyLimit
from gcs.api.connections import _silent, limited
from gcs.jobs.places import Places
from gcs.jobs.uploads import Uploads
from gcs.recording.storage import StorageOptions

pytestmark = pytest.mark.whole_flight


def ask(connection: socket.socket, path: str = "/api/health") -> bytes:
    """The first bytes of the answer to a request."""
    connection.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
    return connection.recv(100)


def connect(client: httpx.Client) -> socket.socket:
    connection = socket.create_connection(("127.0.0.1", client.base_url.port or 0))
    connection.settimeout(PATIENCE_S)
    return connection


def is_ended(connection: socket.socket) -> bool:
    """Whether the server has ended a connection from which nothing is to come."""
    connection.settimeout(0.01)
    try:
        return connection.recv(1) == b""
    except TimeoutError:
        return False
    except ConnectionError:
        return True


def test_beyond_the_limit_those_connections_end_that_have_waited_longest(bench: Bench) -> None:
    with serving(bench.app, limited(most=5)) as client, ExitStack() as held:
        idle = []
        for _ in range(30):
            idle.append(held.enter_context(connect(client)))
            time.sleep(0.005)
        wait_until(lambda: all(is_ended(one) for one in idle[:20]))
        assert client.get("/api/health").status_code == 200
        idle[-1].settimeout(PATIENCE_S)
        assert ask(idle[-1]).startswith(b"HTTP/1.1 200")


@pytest.mark.parametrize(
    "begun",
    [b"", b"GET /api/hea", b"POST /api/flights/x/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Length: 20\r\n\r\n{"],
)
def test_a_client_that_never_says_the_rest_is_waited_for_so_long_and_no_longer(bench: Bench, begun: bytes) -> None:
    with serving(bench.app, limited(patience_s=0.3)) as client, connect(client) as connection:
        connection.sendall(begun)
        asked = time.monotonic()
        wait_until(lambda: is_ended(connection))
        # Not at once: it was waited for.
        assert time.monotonic() - asked > 0.2
        assert client.get("/api/health").status_code == 200


def test_an_answer_takes_as_long_as_it_takes() -> None:
    app = FastAPI()

    @app.get("/slow")
    def slow() -> StreamingResponse:
        def parts() -> Iterator[bytes]:
            for _ in range(5):
                time.sleep(0.2)
                yield b"part "

        return StreamingResponse(parts())

    with serving(app, limited(patience_s=0.3)) as client:
        assert client.get("/slow").text == "part " * 5


@pytest.mark.parametrize("declared", [True, False])
def test_a_body_larger_than_any_model_is_refused_while_it_comes(client: httpx.Client, declared: bool) -> None:
    large = b'{"kind": "identify", "prior": {"x": "' + 5_000_000 * b"x" + b'"}}'
    body = large if declared else (large[i : i + 65536] for i in range(0, len(large), 65536))
    answer = client.post("/api/flights/x/jobs", content=body, headers={"Content-Type": "application/json"})
    assert "larger than 256 kB" in problem(answer, 413)


def test_names_that_are_no_hosts_are_said_to_be_none(client: httpx.Client) -> None:
    for headers in ({"Host": "["}, {"Origin": "http://["}):
        assert "names no host" in problem(client.get("/api/flights", headers=headers), 400)


@pytest.mark.parametrize(
    "body", [b"no boundary at all", b"--x\r\nContent-Disposition: form-data; name=" + 20_000 * b"y"]
)
def test_a_form_that_is_none_is_refused_in_words(client: httpx.Client, body: bytes) -> None:
    headers = {"Content-Type": "multipart/form-data; boundary=x"}
    assert "not well made" in problem(client.post("/api/flights", content=body, headers=headers), 422)


def test_an_upload_leaves_what_recordings_keep_in_reserve(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(storage=StorageOptions(reserve_bytes=10**18))
    with serving(bench.app) as client:
        assert "in reserve for what is recorded" in problem(client.post("/api/flights?name=a.tlog", content=b"x"), 507)
    assert not list(bench.settings.data.glob("upload-*"))


def test_a_recording_of_after_2262_is_refused_in_words(bench: Bench, client: httpx.Client) -> None:
    path = bench.settings.data / "late.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("x", "ros2msg", b"int8 x")
        channel = writer.register_channel("/x", "cdr", schema)
        writer.add_message(channel, log_time=2**64 - 1, publish_time=2**64 - 1, data=b"\0\1\0\0\1")
        writer.finish()
    answer = client.post("/api/flights?name=late.mcap", content=path.read_bytes())
    assert problem(answer, 422)
    assert not bench.catalogue.flights()


def test_uploads_have_so_many_places_and_leave_threads_to_others(
    bench: Bench, client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs.jobs.uploads._MOST_OF_ONE", 8)
    service = bench.app.state.service
    service.uploads = Uploads(bench.settings, bench.catalogue, (sys.executable, "-c", "import time; time.sleep(600)"))

    def send(_: int) -> httpx.Response:
        return httpx.post(f"{client.base_url}/api/flights?name=a.tlog", content=b"x", timeout=PATIENCE_S)

    with ThreadPoolExecutor(45) as pool:
        sent = [pool.submit(send, number) for number in range(45)]
        wait_until(lambda: sum(one.done() for one in sent) == 37)
        assert client.get("/api/flights").json()["flights"] == []
        refused = [one.result() for one in sent if one.done()]
        service.uploads.close()
        answers = [one.result() for one in sent]
    for one in refused:
        assert "8 files are being taken in already; come again" in problem(one, 503)
        assert one.headers["retry-after"] == "30"
    assert Counter(problem(one, 503).partition(";")[0] for one in answers)["the service is being stopped"] == 8
    assert bench.catalogue.flights() == []
    assert not list(bench.settings.data.glob("upload-*"))
    # A place that is left is free.
    service.uploads = Uploads(bench.settings, bench.catalogue, (sys.executable, "-c", "print('no answer')"))
    for _ in range(9):
        assert problem(send(0), 422)


def test_an_upload_whose_client_leaves_leaves_nothing_behind(
    bench: Bench, client: httpx.Client, caplog: pytest.LogCaptureFixture
) -> None:
    with connect(client) as connection:
        connection.sendall(b"POST /api/flights?name=a.tlog HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99\r\n\r\nx")
        wait_until(lambda: list(bench.settings.data.glob("upload-*")))
    wait_until(lambda: not list(bench.settings.data.glob("upload-*")))
    client.get("/api/health")
    assert "Traceback" not in caplog.text
    assert bench.catalogue.flights() == []


def test_health_answers_while_every_thread_is_taken(bench: Bench, client: httpx.Client) -> None:
    free, service = threading.Event(), bench.app.state.service
    entered = threading.Semaphore(0)

    def slow(*_: object) -> dict[str, object]:
        entered.release()
        assert free.wait(PATIENCE_S)
        return {}

    flight = bench.record(1, 1, START)
    service.views.series = slow
    askers = [
        threading.Thread(target=httpx.get, args=(f"{client.base_url}/api/flights/{flight}/signals?names=phi",),
                         kwargs={"timeout": PATIENCE_S})
        for _ in range(60)
    ]  # fmt: skip
    try:
        for asker in askers:
            asker.start()
        for _ in range(40):
            assert entered.acquire(timeout=PATIENCE_S)
        assert client.get("/api/health").status_code == 200
    finally:
        free.set()
        for asker in askers:
            asker.join()


def test_an_answer_that_nobody_reads_is_not_kept_for_ever() -> None:
    app = FastAPI()

    @app.get("/large")
    def large() -> StreamingResponse:
        return StreamingResponse(bytes(1 << 20) for _ in range(100))

    with serving(app, limited(unread_s=0.3)) as client, connect(client) as connection:
        connection.sendall(b"GET /large HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert connection.recv(1)
        time.sleep(3.0)  # ten times as long as it is waited for
        received = 0
        with contextlib.suppress(ConnectionError):
            while data := connection.recv(1 << 20):
                received += len(data)
        assert 0 < received < 100 << 20


def test_beyond_the_limit_those_end_too_that_do_not_read(bench: Bench) -> None:
    app = FastAPI()

    @app.get("/large")
    def large() -> StreamingResponse:
        return StreamingResponse(bytes(1 << 20) for _ in range(100))

    @app.get("/small")
    def small() -> str:
        return "small"

    with serving(app, limited(most=5)) as client, ExitStack() as held:
        for _ in range(5):
            connection = held.enter_context(connect(client))
            connection.sendall(b"GET /large HTTP/1.1\r\nHost: localhost\r\n\r\n")

        def small_one() -> bool:  # refused until it is seen that the others do not read
            try:
                return bool(httpx.get(f"{client.base_url}/small", timeout=PATIENCE_S).json() == "small")
            except httpx.TransportError:
                return False

        assert wait_until(small_one)


def test_a_rush_of_requests_leaves_none_of_them_out() -> None:
    app = FastAPI()

    @app.get("/busy")
    async def busy() -> None:
        time.sleep(0.5)  # the rush comes meanwhile, and waits to be accepted

    @app.get("/small")
    async def small() -> str:
        return "small"

    request = b"GET /small HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    with serving(app, limited(most=40)) as client, ExitStack() as held:
        held.enter_context(connect(client)).sendall(request.replace(b"small", b"busy"))
        rush = [held.enter_context(connect(client)) for _ in range(110)]
        for one in rush:
            one.sendall(request)
        assert [one.recv(100)[:15] for one in rush] == [b"HTTP/1.1 200 OK"] * 110


def test_who_has_sent_what_is_not_read_yet_is_not_silent() -> None:
    with ExitStack() as held:

        def connection(sent: bytes, left: bytes = b"", waits: bool = True) -> SimpleNamespace:
            ours, theirs = (held.enter_context(one) for one in socket.socketpair())
            theirs.sendall(sent)
            transport = SimpleNamespace(get_extra_info=lambda name: ours)
            return SimpleNamespace(transport=transport, _rest=left, waits_for_client=waits)

        quiet = connection(b"")
        others = [connection(b"GET"), connection(b"", b"GET"), connection(b"", waits=False)]
        assert _silent([quiet, *others]) == [quiet]  # type: ignore[list-item]


def test_a_request_behind_a_body_in_chunks_is_answered() -> None:
    app = FastAPI()

    @app.post("/body")
    async def body(request: Request) -> int:
        return len(await request.body())

    post = b"POST /body HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n"
    behind = b"POST /body HTTP/1.1\r\nHost: localhost\r\nCookie: " + 900 * b"c" + b"\r\nContent-Length: 0\r\n"
    with serving(app) as client, connect(client) as connection:
        chunked = 2 * (b"800\r\n" + 2048 * b"x" + b"\r\n") + b"0\r\n\r\n"
        connection.sendall(post + chunked + behind + b"\r\n" + behind + b"Connection: close\r\n\r\n")
        answers = b""
        while piece := connection.recv(10_000):
            answers += piece
        assert answers.count(b"HTTP/1.1 200 OK") == 3
        assert b"4096" in answers


def test_only_so_many_follow_the_flight_and_a_place_that_is_left_is_free(bench: Bench, client: httpx.Client) -> None:
    bench.app.state.service.following = Places(2, 2, "streams are followed")
    with ExitStack() as held:
        followers = [held.enter_context(connect(client)) for _ in range(2)]
        for one in followers:
            assert ask(one, "/api/live/stream").startswith(b"HTTP/1.1 200")
        assert "2 streams are followed already" in problem(client.get("/api/live/stream"), 503)
        followers[0].close()

        def follows() -> bool:
            with connect(client) as another:
                return ask(another, "/api/live/stream").startswith(b"HTTP/1.1 200")

        wait_until(follows)


def by(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def test_nobody_takes_all_streams_of_events(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench()
    vera, anna = (TokenFile(bench.settings.tokens).add(name, "viewer") for name in ("vera", "anna"))
    with serving(bench.app) as client, ExitStack() as held:
        url = f"{client.base_url}/api/live/stream"

        def follow(token: str) -> int:
            stream = httpx.stream("GET", url, headers=by(token), timeout=PATIENCE_S)
            return held.enter_context(stream).status_code

        assert [follow(vera) for _ in range(8)] == [200] * 8
        refused = client.get(url, headers=by(vera))
        assert "8 streams are followed by vera already" in problem(refused, 503)
        assert refused.headers["retry-after"] == "30"
        assert follow(anna) == 200


def test_nobody_takes_all_places_of_uploads(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench()
    olga, otto = (TokenFile(bench.settings.tokens).add(name, "operator") for name in ("olga", "otto"))
    with serving(bench.app) as client, ExitStack() as held:
        for _ in range(3):
            one = held.enter_context(connect(client))
            head = f"POST /api/flights?name=a.bin HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {olga}"
            one.sendall(f"{head}\r\nContent-Length: 500000\r\n\r\nabc".encode())
        wait_until(lambda: len(list(bench.settings.data.glob("upload-*"))) == 3)
        refused = client.post("/api/flights?name=a.tlog", content=b"x", headers=by(olga))
        assert "3 files are being taken in by olga already" in problem(refused, 503)
        assert refused.headers["retry-after"] == "30"
        problem(client.post("/api/flights?name=a.tlog", content=b"x", headers=by(otto)), 422)


def test_an_upload_that_only_drips_gives_its_place_back(
    bench: Bench, client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where others wait for it; else it may take its time."""
    monkeypatch.setattr("gcs.api.upload._WATCHED_S", 0.2)
    crowded: list[bool] = []

    def full(_: Places) -> bool:
        crowded.append(len(crowded) >= 3)
        return crowded[-1]

    monkeypatch.setattr(Places, "full", property(full))
    with connect(client) as one:
        head = "POST /api/flights?name=a.bin HTTP/1.1\r\nHost: localhost\r\nContent-Length: 500000"
        one.sendall(f"{head}\r\n\r\n".encode())
        one.settimeout(0.02)
        answer = b""
        while not answer:
            one.sendall(b"x")
            with contextlib.suppress(TimeoutError):
                answer = one.recv(1000)
    assert answer.startswith(b"HTTP/1.1 408")
    assert crowded == [False, False, False, True]
    wait_until(lambda: not list(bench.settings.data.glob("upload-*")))


def test_who_logs_in_sends_a_token_and_no_more(client: httpx.Client) -> None:
    large = b'{"token": [' + 1_320_000 * b"{}," + b"{}]}"
    for body in (large, (large[i : i + 65536] for i in range(0, len(large), 65536))):
        answer = client.post("/api/login", content=body, headers={"Content-Type": "application/json"})
        assert problem(answer, 413) == "the body is larger than 4 kB, the most that is taken here"
    assert client.post("/api/login", json={"token": "x"}).status_code == 200


@pytest.mark.parametrize(
    ("body", "status", "said"),
    [
        (b'{"prior": [' + 80_000 * b"{}," + b"{}]}", 413, "more than 20000 values and brackets"),
        (b"[" + 120_000 * b"1," + b"1]", 413, "more than 20000 values and brackets"),
        (b'"\\"", ' + 80_000 * b"[],", 413, "more than 20000 values and brackets"),
        (250_000 * b'"', 413, "more than 20000 values and brackets"),
        (1000 * b"[" + 1000 * b"]", 422, "nested more than 64 deep"),
        (('["\u2200", ' + 30_000 * "{}," + "{}]").encode("utf-16"), 422, "no JSON in UTF-8"),
    ],
)
def test_json_of_more_parts_than_anybody_has_to_say_is_refused_unread(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch, body: bytes, status: int, said: str
) -> None:
    monkeypatch.setattr("json.loads", lambda *_, **__: pytest.fail("it was read"))
    answer = client.post("/api/flights/x/jobs", content=body, headers={"Content-Type": "application/json"})
    monkeypatch.undo()
    assert said in problem(answer, status)


def test_brackets_in_texts_are_none(client: httpx.Client) -> None:
    body = b'{"toml": "# ' + 24_000 * b'[{,\\"' + b'"}'
    answer = client.post("/api/vehicles/check", content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code == 200


def head(path: str, *lines: str) -> bytes:
    """The beginning of a request with a body of JSON."""
    first = (f"POST {path} HTTP/1.1", "Host: localhost", "Content-Type: application/json", *lines)
    return "\r\n".join((*first, "", "")).encode()


def answer_to(connection: socket.socket) -> bytes:
    """All that the service says until it ends the connection."""
    said = b""
    with contextlib.suppress(ConnectionError):
        while data := connection.recv(1 << 16):
            said += data
    return said


def test_large_bodies_have_so_many_places_which_are_free_once_they_are_left(client: httpx.Client) -> None:
    body = b'{"toml": "' + 70_000 * b"#" + b'"}'
    with ExitStack() as held:
        waiting = []
        for _ in range(4):
            one = held.enter_context(connect(client))
            one.sendall(head("/api/vehicles/check", f"Content-Length: {len(body)}", "Expect: 100-continue"))
            assert one.recv(100).startswith(b"HTTP/1.1 100")
            one.sendall(body[:-1])
            waiting.append(one)
        sent = (body[i : i + 10_000] for i in range(0, len(body), 10_000))
        for another in (body, sent):
            refused = client.post("/api/vehicles/check", content=another, headers={"Content-Type": "application/json"})
            assert "4 other large requests are being worked on" in problem(refused, 503)
            assert refused.headers["retry-after"] == "30"
        small = client.post("/api/vehicles/check", json={"toml": "x = 1"})
        assert small.status_code == 200
        for one in waiting[:2]:
            one.sendall(body[-1:])
            assert one.recv(100).startswith(b"HTTP/1.1 200")
        waiting[3].close()
        assert wait_until(lambda: client.post("/api/vehicles/check", content=body,
                          headers={"Content-Type": "application/json"}).status_code == 200)  # fmt: skip


def test_other_json_is_small(client: httpx.Client) -> None:
    large = b'{"way": "swing", "x": "' + 70_000 * b"x" + b'"}'
    answer = client.post("/api/vehicles/x/restore/y", content=large, headers={"Content-Type": "application/json"})
    assert "larger than 64 kB" in problem(answer, 413)


def test_a_body_of_which_a_byte_comes_now_and_then_is_waited_for_so_long_and_no_longer() -> None:
    app = FastAPI()

    @app.post("/taken")
    def taken(body: dict[str, int]) -> int:
        return len(body)

    app.add_middleware(BodyLimit, longest_s=0.3)
    with serving(app) as client, connect(client) as connection:
        connection.sendall(head("/taken", "Content-Length: 2000"))
        assert connection.recv(100).startswith(b"HTTP/1.1 408")
        assert client.post("/taken", json={"a": 1}).json() == 1


def test_of_the_keys_that_nobody_knows_the_first_are_named(client: httpx.Client) -> None:
    given = {"kind": "identify", **{f"key{number}": 1 for number in range(300)}, "k" * 5000: 1}
    said = problem(client.post("/api/flights/x/jobs", json=given), 422)
    assert said.startswith("key0, key1, ")
    assert ", key9 and 291 more: no such key in a job" in said
    assert len(said) < 1000


@pytest.mark.parametrize("path", ["/api/login", "/api/flights/x/jobs"])
def test_a_body_in_tiny_chunks_ends_its_connection(client: httpx.Client, path: str) -> None:
    with connect(client) as connection:
        with contextlib.suppress(ConnectionError):
            connection.sendall(head(path, "Transfer-Encoding: chunked") + 50_000 * b"1\r\n \r\n")
        assert answer_to(connection) == b""


def test_a_body_in_chunks_of_a_line_is_taken(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(1, 1, START)
    data = (bench.settings.flights / f"{flight}.mcap").read_bytes()
    lines = (data[i : i + 100] for i in range(0, len(data), 100))
    assert client.post("/api/flights?name=a.mcap", content=lines).status_code == 201


def test_what_is_left_of_a_body_after_its_answer_is_not_read(
    make_bench: Callable[..., Bench], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make_bench(token="secret")
    read = 0
    receive = h11.Connection.receive_data

    def counted(connection: h11.Connection, data: bytes) -> None:
        nonlocal read
        read += len(data)
        receive(connection, data)

    monkeypatch.setattr(h11.Connection, "receive_data", counted)
    with serving(bench.app, limited(linger_s=0.3)) as client:
        for length in ("Transfer-Encoding: chunked", "Content-Length: 10000000"):
            with connect(client) as connection:
                connection.sendall(head("/api/flights", length))
                said = b""
                while b"send a token" not in said:
                    said += connection.recv(1000)
                assert said.startswith(b"HTTP/1.1 401")
                assert b"connection: close" in said
                read = 0
                with contextlib.suppress(ConnectionError):
                    for _ in range(100):
                        connection.sendall(b"2710\r\n" + 10_000 * b"x" + b"\r\n")
                answer_to(connection)
                assert read == 0


def test_requests_that_come_at_once_are_answered_one_after_another(client: httpx.Client) -> None:
    with connect(client) as connection:
        one = head("/api/login", "Content-Length: 14") + b'{"token": "x"}'
        last = head("/api/login", "Content-Length: 14", "Connection: close") + b'{"token": "x"}'
        connection.sendall(50 * one + last)
        assert answer_to(connection).count(b"HTTP/1.1 200") == 51


def test_an_aircraft_whose_key_has_49000_dots_is_said_to_be_none(client: httpx.Client) -> None:
    text = ".".join(49_000 * "a") + "=1"
    for draft in ({"toml": text}, {"toml": text, "form": {"name": "a"}}):
        said = client.post("/api/vehicles/check", json=draft).json()["problem"]
        assert said == "vehicle file: is not a vehicle file: a key has more than 8 dots in line 1; take that out"
        assert said == problem(client.post("/api/vehicles", json=draft), 422)


def test_a_text_of_which_each_line_takes_longer_than_the_last_is_refused_before_a_form_is_put_into_it(
    client: httpx.Client,
) -> None:
    text = "[zz]\n" + "\n".join(f"a.b.c.d{number} = 1" for number in range(999))
    said = client.post("/api/vehicles/check", json={"toml": text, "form": {"name": "a"}}).json()["problem"]
    assert "more than 50 keys have dots in line 52" in said


def test_half_a_character_in_a_model_is_said(client: httpx.Client, bench: Bench) -> None:
    flight = bench.record(1, 2, START)
    body = b'{"kind": "identify", "structure": {"name": "\\ud800", "coefficients": {}}}'
    answer = client.post(f"/api/flights/{flight}/jobs", content=body, headers={"Content-Type": "application/json"})
    assert "half a character" in problem(answer, 422)
