"""What the interface says of itself, and whom it answers."""

import re
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest
from api_bench import TOKEN, Bench, problem
from serving import serving


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


@pytest.mark.whole_flight
def test_a_token_is_demanded_everywhere_but_for_health_and_readiness(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(token=TOKEN, host="0.0.0.0")
    with serving(bench.app) as client:
        assert client.get("/api/health").status_code == 200
        assert client.get("/api/ready").status_code == 200
        schema = client.get("/openapi.json").json()
        right = {"Authorization": f"Bearer {TOKEN}"}
        for path, methods in schema["paths"].items():
            for method in methods:
                if path in ("/api/health", "/api/ready", "/api/login"):
                    continue
                url = path.replace("{flight_id}", "x").replace("{job_id}", "x").replace("{model_id}", "x")
                for headers in ({}, {"Authorization": f"Basic {TOKEN}"}):
                    answer = client.request(method, url, headers=headers)
                    assert answer.headers["www-authenticate"] == "Bearer"
                    assert "Authorization" in problem(answer, 401)
                # Events never end: what matters comes before the body.
                with client.stream(method, url, headers=right) as allowed:
                    assert allowed.status_code != 401
        wrong = client.get("/api/flights", headers={"Authorization": "Bearer wrong"})
        assert "does not know this token" in problem(wrong, 401)
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
        "GET /api/ready",
        "POST /api/login",
        "POST /api/logout",
        "GET /api/me",
        "GET /api/tokens",
        "GET /api/shares",
        "DELETE /api/shares/{share_id}",
        "GET /api/audit",
        "POST /api/flights/{flight_id}/share",
        "GET /api/links",
        "GET /api/flights",
        "POST /api/flights",
        "GET /api/flights/{flight_id}",
        "DELETE /api/flights/{flight_id}",
        "POST /api/flights/{flight_id}/restore",
        "GET /api/flights/{flight_id}/recording",
        "GET /api/flights/{flight_id}/signals",
        "POST /api/flights/{flight_id}/jobs",
        "GET /api/jobs/{job_id}",
        "DELETE /api/jobs/{job_id}",
        "POST /api/jobs/{job_id}/cancel",
        "POST /api/jobs/{job_id}/rerun",
        "GET /api/flights/{flight_id}/identification",
        "GET /api/flights/{flight_id}/discrepancy",
        "GET /api/flights/{flight_id}/design",
        "GET /api/flights/{flight_id}/report",
        "GET /api/flights/{flight_id}/tuning",
        "GET /api/flights/{flight_id}/tuning/file",
        "GET /api/flights/{flight_id}/margins",
        "GET /api/flights/{flight_id}/performance",
        "PATCH /api/flights/{flight_id}",
        "GET /api/flights/{flight_id}/spectrum",
        "GET /api/flights/{flight_id}/spectrogram",
        "GET /api/flights/{flight_id}/planned",
        "POST /api/flights/{flight_id}/design/upload",
        "GET /api/vehicles",
        "POST /api/vehicles",
        "POST /api/vehicles/check",
        "POST /api/vehicles/inertia",
        "GET /api/vehicles/{vehicle_id}",
        "PUT /api/vehicles/{vehicle_id}",
        "DELETE /api/vehicles/{vehicle_id}",
        "POST /api/vehicles/{vehicle_id}/restore",
        "GET /api/vehicles/{vehicle_id}/toml",
        "GET /api/vehicles/{vehicle_id}/trends",
        "GET /metrics",
        "GET /api/map",
        "GET /api/map/{zoom}/{column}/{row}",
        "GET /api/models",
        "GET /api/models/{model_id}",
        "GET /api/models/{model_id}/export",
        "GET /api/live",
        "GET /api/live/minute",
        "POST /api/live/notes",
        "GET /api/live/stream",
    }
    body = schema["components"]["schemas"]["JobRequest"]["properties"]
    known = {
        "kind",
        "model",
        "structure",
        "prior",
        "validate",
        "method",
        "from",
        "to",
        "system",
        "rule_out",
        "as_recorded",
        "vehicle",
        "manoeuvres",
        "duration",
        "gusts",
        "limits",
    }
    assert known == set(body)
    assert client.get("/docs").status_code == 200


def test_captions_of_wide_tables_stay_in_sight() -> None:
    """Both the page's and the report's; the browser's test measures it where there is one."""
    for style in ("gcs/page/static/page.css", "gcs/report/style.css"):
        text = (Path(__file__).resolve().parents[3] / style).read_text(encoding="utf-8")
        assert re.search(r"\.wide \{[^}]*container-type: inline-size", text), style
        assert re.search(r"caption \{[^}]*max-width: 100cqi; position: sticky; left: 0", text), style
