"""What follows from a model over REST: parameters, margins and performance, as the commands print them."""

from __future__ import annotations

import json
from pathlib import Path

import httpx
import pytest
from api_bench import START, Bench, problem
from processes import run
from tuned_result import BOARD, a_result, damped

from gcs.text.jsontext import dumps
from gcs.tuning.margins import margins
from gcs.tuning.parameter_file import parameter_file
from gcs.tuning.tune import tune

pytestmark = pytest.mark.whole_flight


def test_sheets_of_a_flight_are_those_of_the_commands(bench: Bench, client: httpx.Client, tmp_path: Path) -> None:
    flight = bench.record(1, 1, START)
    place = f"/api/flights/{flight}"
    assert "has no identify result yet" in problem(client.get(f"{place}/tuning?for=px4"), 404)
    result = a_result(damped(), BOARD)
    job = bench.catalogue.add_job(flight, "identify", {"kind": "identify"})
    bench.catalogue.finish_job(job, result)
    made_by = {"job": job.id}
    for autopilot in ("ardupilot", "px4"):
        found = tune(result, autopilot)
        assert client.get(f"{place}/tuning?for={autopilot}").json() == json.loads(dumps(found)) | made_by
        answer = client.get(f"{place}/tuning/file?for={autopilot}")
        assert answer.text == parameter_file(found)
        assert f'filename="{flight}.param' in answer.headers["content-disposition"]
    assert client.get(f"{place}/margins").json() == json.loads(dumps(margins(result))) | made_by
    kept = tmp_path / "result.json"
    kept.write_text(dumps(result), encoding="utf-8")
    asked = ("--vehicle", "iitb-mav", "--mass", 1.5, "--altitude", 800)
    printed = run("gcs", "performance", kept, *asked, "--json")
    assert client.get(f"{place}/performance?mass=1.5&altitude=800").json() == json.loads(printed.stdout) | made_by


def test_what_cannot_be_asked_or_followed_is_said_in_one_line(bench: Bench, client: httpx.Client) -> None:
    flight = bench.record(1, 1, START)
    place = f"/api/flights/{flight}"
    broken = {"schema": "identification/1", "model": {"schema": "model/1", "name": "x", "coefficients": {}}}
    bench.catalogue.finish_job(bench.catalogue.add_job(flight, "identify", {"kind": "identify"}), broken)
    for kind in ("tuning?for=px4", "tuning/file?for=px4", "margins", "performance"):
        assert "does not hold the aircraft that flew" in problem(client.get(f"{place}/{kind}"), 409)
    assert "for is missing" in problem(client.get(f"{place}/tuning"), 422)
    assert "mass" in problem(client.get(f"{place}/performance?mass=nan"), 422)
    assert "mass" in problem(client.get(f"{place}/performance?mass=-1"), 422)
    for name in ("altitude", "temperature"):
        for value in ("nan", "inf", "-9000", "9000"):
            assert name in problem(client.get(f"{place}/performance?{name}={value}"), 422)
    assert "battery" in problem(client.get(f"{place}/performance?battery=0"), 422)
