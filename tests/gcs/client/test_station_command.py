"""`gcs station`: what it prints, how it ends, and that the token is in none of it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from api_bench import START, TOKEN, Bench

from gcs.cli import main

pytestmark = pytest.mark.whole_flight


@pytest.fixture
def token_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.delenv("GCS_TOKEN", raising=False)
    path = tmp_path / "token.txt"
    path.write_text(f"{TOKEN}\n")
    return str(path)


@pytest.mark.whole_flight
def test_from_a_log_to_a_model_there(
    url: str, log: Path, tmp_path: Path, token_file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def printed(*arguments: object, before: tuple[str, ...] = ()) -> str:
        given = ["station", *before, url, *map(str, arguments)]
        assert main(given if before else [*given, "--token-file", token_file]) == 0
        captured = capsys.readouterr()
        assert TOKEN not in captured.out + captured.err
        return captured.out

    flight = printed("upload", log, "--quiet").strip()
    assert json.loads(printed("upload", log, "--name", "b.tlog", "--json"))["name"] == "b.tlog"
    (line,) = printed("flights", "--search", "b.tlog", before=("--token-file", token_file)).splitlines()
    assert line.split()[-1] == "b.tlog"
    assert len(json.loads(printed("flights", "--json"))) == 2
    assert printed("models") == "the station has no model yet\n"
    written, model = tmp_path / "result.json", tmp_path / "model.json"
    shown = json.loads(printed("identify", flight, "-o", written, "--write-model", model, "--json"))
    assert shown == json.loads(written.read_text())
    assert json.loads(model.read_text()) == shown["model"]
    assert printed("models").split()[2] == "identify"
    queued = json.loads(printed("identify", flight, "--from", "0.1", "--no-wait", "--json"))
    assert (queued["flight_id"], queued["request"]["from"]) == (flight, 0.1)
    lines = printed("job", queued["id"], "--wait").splitlines()
    assert lines == [f"job {queued['id']}: identify of flight {flight}, done, 100 %", "  half way"]


def test_the_token_comes_from_the_environment_too(
    url: str, bench: Bench, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = bench.record(1, 1, START)
    bench.catalogue.change_notes(flight, title="red\x1b[31m one")
    monkeypatch.setenv("GCS_TOKEN", TOKEN)
    assert main(["station", url, "flights"]) == 0
    assert "red [31m one" in capsys.readouterr().out


def test_a_job_that_failed_is_exit_code_1_with_its_reason(
    url: str, bench: Bench, token_file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    job = bench.catalogue.add_job(bench.record(1, 1, START), "identify", {})
    bench.catalogue.fail_job(job.id, "it never flew")
    assert main(["station", url, "job", job.id, "--token-file", token_file]) == 1
    assert "error: it never flew" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["URL", "flights"], 1, "demands its token, and none was given"),
        (["URL", "job", "none", "--token-file", "TOKEN"], 1, "no job 'none'"),
        (["URL", "upload", "nowhere.mcap", "--token-file", "TOKEN"], 1, "nowhere.mcap: No such file"),
        (["ftp://x", "flights"], 2, "no address of a station"),
        (["URL", "flights", "--limit", "0"], 2, "--limit 0"),
        (["URL", "flights", "--timeout", "-1"], 2, "timeout -1"),
        (["URL", "flights", "--token-file", "nowhere.txt"], 2, "nowhere.txt"),
        (["URL", "identify", "x", "--from", "5", "--to", "3"], 2, "--from, --to"),
        (["URL", "identify", "x", "--no-wait", "-o", "x.json"], 2, "--no-wait"),
        (["URL", "identify", "x", "-o", "no/such/x.json"], 2, "no/such/x.json"),
    ],
)
def test_what_goes_wrong_is_one_line(
    arguments: list[str], code: int, words: str, url: str, token_file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    names = {"URL": url, "TOKEN": token_file}
    assert main(["station", *(names.get(argument, argument) for argument in arguments)]) == code
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert TOKEN not in error
