"""The description of the interface, /docs, on a machine without a network and with a token."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import pytest

from gcs.api import create_app
from gcs.catalogue.store import Catalogue
from gcs.jobs.runner import JobRunner
from gcs.mavlink.dialect import Dialect
from gcs.settings import Settings
from gcs.station.recorder import FlightRecorder
from gcs.station.station import RecordingStation


@pytest.fixture
def get(tmp_path: Path) -> Iterator[Callable[[str], httpx.Response]]:
    """What a service that demands a token answers to somebody who has none."""
    settings = Settings(data=tmp_path, token="token-of-the-description")
    catalogue = Catalogue(settings.database)
    recorder = FlightRecorder(settings.flights, Dialect.load(), catalogue)
    app = create_app(settings, catalogue, RecordingStation([], recorder), JobRunner(settings, catalogue))

    async def ask(path: str) -> httpx.Response:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://127.0.0.1") as client:
            return await client.get(path)

    yield lambda path: asyncio.run(ask(path))
    catalogue.close()


def test_all_that_the_description_loads_comes_from_the_service_itself_and_needs_no_token(
    get: Callable[[str], httpx.Response],
) -> None:
    page = get("/docs")
    assert page.status_code == 200
    loaded = re.findall(r'(?:src|href)="([^"]+)"', page.text)
    assert {path.rsplit(".", 1)[1] for path in loaded} >= {"js", "css"}
    for path in loaded:
        assert re.match(r"/[^/]", path), path
        answer = get(path)
        assert answer.status_code == 200, path
        assert len(answer.content) > 1000
    assert get("/api/flights").status_code == 401
