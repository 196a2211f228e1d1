"""Every request has an id: in its answer, in an error, in the log; and the access log has no query."""

import asyncio
import logging

import httpx
import pytest
from api_bench import TOKEN, Bench
from serving import serving

from gcs.text.json_log import ACCESS_LOG


def test_a_sane_id_is_kept_and_another_is_replaced(client: httpx.Client) -> None:
    assert client.get("/api/health", headers={"X-Request-ID": "proxy-7.a_B"}).headers["x-request-id"] == "proxy-7.a_B"
    made = set()
    for wrong in ("", "x" * 65, "a b", "-x", 'a"', "a;b"):
        answer = client.get("/api/health", headers={"X-Request-ID": wrong})
        made.add(answer.headers["x-request-id"])
        assert len(answer.headers["x-request-id"]) == 16
    assert len(made) == 6


def test_an_error_names_the_request(client: httpx.Client) -> None:
    for path, headers in (("/api/flights/none", {}), ("/api/flights", {"Origin": "http://evil.example"})):
        answer = client.get(path, headers={"X-Request-ID": "r1", **headers})
        assert answer.status_code >= 400
        assert answer.json()["request_id"] == answer.headers["x-request-id"] == "r1"


def test_an_error_that_nobody_thought_of_names_the_request_too(bench: Bench) -> None:
    @bench.app.get("/api/broken")
    def broken() -> None:
        raise RuntimeError("not thought of")

    bench.app.router.routes.insert(0, bench.app.router.routes.pop())  # before the page's
    with serving(bench.app) as client:
        answer = client.get("/api/broken", headers={"X-Request-ID": "r2"})
        assert answer.status_code == 500
        assert answer.headers["content-type"] == "application/problem+json"
        assert answer.json()["request_id"] == answer.headers["x-request-id"] == "r2"


def test_the_access_log_has_method_path_status_and_time_but_no_query(
    client: httpx.Client, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO, ACCESS_LOG):
        client.get(f"/api/flights?token={TOKEN}")
        client.get(f"/api/flights/none?token={TOKEN}")
    found = [record for record in caplog.records if record.name == ACCESS_LOG]
    values = [(vars(one)["method"], vars(one)["path"], vars(one)["status"]) for one in found]
    assert values == [("GET", "/api/flights", 200), ("GET", "/api/flights/none", 404)]
    assert all(vars(one)["ms"] > 0.0 for one in found)
    assert TOKEN not in caplog.text


def test_no_access_log_where_nobody_asked_for_it(client: httpx.Client, caplog: pytest.LogCaptureFixture) -> None:
    client.get("/api/health")
    assert not [record for record in caplog.records if record.name == ACCESS_LOG]


def test_a_request_that_a_stop_ends_hears_so_as_any_other_error(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    @bench.app.get("/api/endless")
    async def endless() -> None:
        raise asyncio.CancelledError  # as uvicorn has it raised where a request waits, once it waits no longer

    bench.app.router.routes.insert(0, bench.app.router.routes.pop())  # before the page's
    with serving(bench.app) as client:
        answer = client.get("/api/endless", headers={"X-Request-ID": "r3"})
    assert (answer.status_code, answer.headers["content-type"]) == (503, "application/problem+json")
    assert answer.json()["detail"] == "the service is being stopped; ask again when it is back"
    assert answer.json()["request_id"] == answer.headers["x-request-id"] == "r3"
    assert answer.headers["retry-after"] == "30"
    assert "Traceback" not in caplog.text
