"""A station asked from Python, plainly and from asyncio: what each method gives, and the example of the page."""

from __future__ import annotations

import asyncio
import inspect
import re
from pathlib import Path

import pytest
from api_bench import START, TOKEN, Bench
from doc_commands import ROOT
from patience import PATIENCE_S
from traffic import SECOND

from gcs.api.schemas.flights import FlightSummary
from gcs.api.schemas.station import Health
from gcs.client import AsyncStation, Station, StationError, operations
from gcs.recording.reader import Recording


def public(of: type) -> set[str]:
    return {name for name in vars(of) if not name.startswith("_")} - {"close"}


def test_both_clients_have_every_operation_and_say_what_it_takes() -> None:
    own = inspect.getmembers(operations, inspect.isfunction)
    named = {name for name, one in own if one.__module__ == operations.__name__ and not name.startswith("_")}
    assert public(Station) == public(AsyncStation) == named
    for client in (Station, AsyncStation):
        assert list(inspect.signature(client.download).parameters) == ["self", "flight_id", "target", "part"]
        assert (client.download.__doc__ or "").startswith("Write a flight's recording")


@pytest.mark.whole_flight
def test_from_upload_to_result(url: str, bench: Bench, log: Path, tmp_path: Path) -> None:
    sent: list[float] = []
    shown: list[tuple[float, str]] = []
    with Station(url, TOKEN, timeout=PATIENCE_S) as station:
        made = station.upload(log, on_progress=lambda share, text: sent.append(share))
        assert (made.name, made.system, made.messages, made.note, sent[-1]) == ("a flight.tlog", 3, 52, "", 1.0)
        assert station.upload(log, "named.tlog").name == "named.tlog"
        summary = station.flight(made.id)
        assert isinstance(summary, FlightSummary)
        assert summary.jobs == []
        job = station.identify(made.id, from_=0.1, validate_=[made.id])
        assert (job.request["from"], job.request["validate"]) == (0.1, [made.id])
        over = station.wait(job, PATIENCE_S, lambda share, text: shown.append((share, text)))
        assert (over.state, over.log) == ("done", ["half way"])
        assert shown[-1] == (1.0, "half way")
        assert station.job(job.id) == over == station.wait(job.id)
        for kind in ("identification", "identify"):
            assert station.result(made.id, kind, job.id)["schema"] == "identification/1"
        (model,) = station.models()
        judging = station.discrepancy(made.id, model=model.id, rule_out=["stall"])
        assert (judging.kind, judging.request["rule_out"]) == ("discrepancy", ["stall"])
        station.wait(judging, PATIENCE_S)
        target = tmp_path / "copy.mcap"
        target.write_bytes(b"what was there")
        assert station.download(made.id, target) == target
        assert sum(Recording(target).counts().values()) == 52
        station.delete(made.id)
        assert [one.id for one in station.flights(deleted=True)] == [made.id]
        assert made.id not in {one.id for one in station.flights()}


@pytest.mark.whole_flight
def test_the_same_from_asyncio(url: str, log: Path, tmp_path: Path) -> None:
    async def ask() -> None:
        async with AsyncStation(url, TOKEN, timeout=PATIENCE_S) as station:
            health, made, live = await asyncio.gather(station.health(), station.upload(log), station.live())
            assert isinstance(health, Health)
            assert live.state == "waiting"
            over = await station.wait(await station.identify(made.id), PATIENCE_S)
            assert over.state == "done"
            assert (await station.result(made.id, "identification"))["model"]["name"] == "found"
            target = await station.download(made.id, tmp_path / "copy.mcap")
            assert sum(Recording(target).counts().values()) == 52
            with pytest.raises(StationError, match="no flight 'none'") as error:
                await station.flight("none")
            assert error.value.status == 404
            await station.delete(made.id)
            assert await station.flights() == []

    asyncio.run(ask())


def test_links_and_what_flies_are_the_models_of_the_interface(url: str) -> None:
    with Station(url, TOKEN) as station:
        (link,) = station.links()
        assert link.url.startswith("udpin:127.0.0.1")
        assert station.live().signals == {}
        assert station.health().links_total == 1


def test_flights_come_over_as_many_pages_as_there_are(url: str, bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in range(5):
        bench.record(1, 1, START + 100 * number * SECOND)
    monkeypatch.setattr(operations, "_PAGE", 2)
    with Station(url, TOKEN) as station:
        every = [one.id for one in station.flights()]
        assert (len(every), every) == (5, sorted(every, reverse=True))
        assert [one.id for one in station.flights(3)] == every[:3]
        assert [one.id for one in station.flights(search=every[1])] == [every[1]]


@pytest.mark.whole_flight
def test_the_example_of_the_page_runs(
    url: str, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (ROOT / "docs" / "howto" / "rest.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    example = example.replace("http://127.0.0.1:8000", url).replace('token=""', f'token="{TOKEN}"')
    exec(example.replace("flight.mcap", log.name), {})
    assert (tmp_path / "copy.mcap").is_file()
    assert capsys.readouterr().out.splitlines()[-1] == "404 there is no flight 'none'; GET /api/flights lists them"
