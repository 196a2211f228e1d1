"""The live process as the service sees it: it may be slow, dead or full, and nothing else minds."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from traffic import SECOND, Vehicle, batch, wait_until

from gcs.live.feed import LiveFeed
from gcs.settings import Settings

SLEEPER = (sys.executable, "-c", "import time; time.sleep(600)")


@pytest.fixture
def feed(tmp_path: Path) -> Iterator[LiveFeed]:
    made = LiveFeed(Settings(data=tmp_path), lambda: ["flight-1"])
    made.start()
    yield made
    made.stop()


def test_signals_reach_the_service_and_a_process_that_is_killed_comes_back(
    feed: LiveFeed, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs.live.feed._FIRST_PAUSE_S", 0.05)
    vehicle = Vehicle()

    def heard() -> bool:
        feed.offer("udpin", batch(vehicle.second(), vehicle.boot_ms * 1_000_000))
        return "phi" in feed.state.signals

    assert feed.link_state == "waiting"
    wait_until(heard)
    assert (feed.process_state, feed.flight, feed.link_state) == ("running", "flight-1", "live")
    assert feed.state.signals["phi"][2] == "rad"
    assert feed._process is not None
    before = feed.state.signals_number
    os.kill(feed._process.pid, signal.SIGKILL)
    wait_until(lambda: feed.restarts == 1)
    wait_until(lambda: heard() and feed.state.signals_number > before and feed.process_state == "running")


def test_a_process_that_takes_nothing_holds_nobody(tmp_path: Path) -> None:
    stuck = LiveFeed(Settings(data=tmp_path), list, SLEEPER)
    stuck.start()
    data = Vehicle().second()
    total = 0
    for second in range(2000):
        part = batch(data, second * SECOND)
        total += len(part.data)
        stuck.offer("udpin", part)
    assert 0 < stuck.dropped_bytes < total
    stuck.stop()
    assert not stuck._thread.is_alive()


def test_a_vehicle_file_that_cannot_be_used_is_told_in_words(tmp_path: Path) -> None:
    wrong = LiveFeed(Settings(data=tmp_path, vehicle="no-such-vehicle"), list)
    wrong.start()
    wait_until(lambda: wrong.process_state == "failed")
    assert "no-such-vehicle: no such vehicle file" in wrong.problem
    wrong.stop()
