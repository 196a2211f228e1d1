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
from sim_vehicle.vehicle.vehicle_file import VEHICLES

pytestmark = pytest.mark.whole_flight

SLEEPER = (sys.executable, "-c", "import time; time.sleep(600)")


@pytest.fixture
def feed(tmp_path: Path) -> Iterator[LiveFeed]:
    made = LiveFeed(Settings(data=tmp_path), lambda: {"flight-1": 1})
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
    wait_until(lambda: feed.state.status.get("armed"))
    # Every sample since the report before, the newest among them.
    number, recent = feed.state.recent[-1]
    assert number == feed.state.signals_number
    times, values = recent["phi"]
    assert 1 <= len(times) == len(values) <= 5
    assert times[-1] == pytest.approx(feed.state.time_s or 0.0, abs=0.1)
    assert feed._process is not None
    before = feed.state.signals_number
    os.kill(feed._process.pid, signal.SIGKILL)
    wait_until(lambda: feed.restarts == 1)
    wait_until(lambda: heard() and feed.state.signals_number > before and feed.process_state == "running")


def test_a_track_stays_over_ground_when_home_is_set(tmp_path: Path) -> None:
    feed = LiveFeed(Settings(data=tmp_path), dict, SLEEPER)
    for position, home in (((0.0, 0.0), 47.0), ((56.0, 0.0), 47.0), ((1056.0, 0.0), 47.0 - 1000.0 / 111_319.49)):
        feed._take({"kind": "status", "status": {"position": list(position), "home": {"place": [home, 8.0]}}})
    # The last place is the second one, seen from a home that lies a kilometre south.
    assert [one[0] for one in feed.state.track] == pytest.approx([1000.0, 1056.0], abs=0.1)


def test_a_process_that_takes_nothing_holds_nobody(tmp_path: Path) -> None:
    stuck = LiveFeed(Settings(data=tmp_path), dict, SLEEPER)
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
    wrong = LiveFeed(Settings(data=tmp_path, vehicle="no-such-vehicle"), dict)
    wrong.start()
    wait_until(lambda: wrong.problem)
    assert wrong.process_state == "running"
    assert "no-such-vehicle: no such vehicle file" in wrong.problem
    assert wrong.problem.count("\n") == 0
    wrong.stop()


def test_a_process_that_starts_anew_beside_a_bad_vehicle_file_goes_on_and_takes_the_mended_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs.live.feed._FIRST_PAUSE_S", 0.05)
    craft = tmp_path / "own.toml"
    good = (VEHICLES / "iitb-mav.toml").read_text(encoding="utf-8").split("[calibration", 1)[0]
    craft.write_text(good, encoding="utf-8")
    feed = LiveFeed(Settings(data=tmp_path, vehicle=str(craft)), lambda: {"flight-1": 1})
    feed.start()
    vehicle = Vehicle()

    def fly() -> bool:
        feed.offer("udpin", batch(vehicle.second(), vehicle.boot_ms * 1_000_000))
        return True

    wait_until(lambda: fly() and feed.state.identification)
    assert feed.vehicle == "iitb-mav"
    craft.write_text(good.replace("[mass]", "[mess]"), encoding="utf-8")
    assert feed._process is not None
    os.kill(feed._process.pid, signal.SIGKILL)
    wait_until(lambda: feed.restarts == 1 and feed.process_state == "running")
    before = feed.state.signals_number
    wait_until(lambda: fly() and feed.state.signals_number > before)
    assert feed.problem.startswith("the vehicle file cannot be used (")
    assert "waits until it is corrected" in feed.problem
    assert feed.state.identification is None
    craft.write_text(good, encoding="utf-8")
    wait_until(lambda: fly() and feed.state.identification)
    assert (feed.problem, feed.restarts, feed.vehicle) == ("", 1, "iitb-mav")
    feed.stop()


def test_a_process_that_is_behind_does_not_make_the_vehicle_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr("gcs.live.feed.time.monotonic", lambda: now[0])
    behind = LiveFeed(Settings(data=tmp_path), dict)  # never started: this test tells what its process would
    data = Vehicle().second()

    def told(taken: int) -> None:
        signals = {"kind": "signals", "time_s": 1.0, "system": 1, "signals": {}, "taken": taken, "flight": None,
                   "recent": {}}  # fmt: skip
        behind._take(signals)

    for _ in range(8):
        behind.offer("udpin", batch(data, 0))
        now[0] += 1.0
    assert behind.link_state == "waiting"
    told(1)
    assert behind.link_state == "live"  # the first of eight, seven seconds late
    told(8)
    assert behind.link_state == "live"
    now[0] += 1.5
    assert behind.link_state == "lost"  # all has been looked at, and nothing has come since
    behind.offer("udpin", batch(data, 0))
    told(9)
    assert behind.link_state == "live"
    for _ in range(4):  # another system goes on sending
        behind.offer("udpin", batch(data, 0))
        now[0] += 1.0
    behind._take({"kind": "taken", "taken": 12})
    assert behind.link_state == "lost"
    behind.offer("udpin", batch(data, 0))
    told(13)
    behind.offer("udpin", batch(data, 0))
    assert behind.link_state == "live"
    now[0] += 15.0
    assert behind.link_state == "lost"  # a process that stands still says nothing of the vehicle


def test_of_a_flight_that_has_just_begun_nothing_of_the_last_one_is_told(tmp_path: Path) -> None:
    feed = LiveFeed(Settings(data=tmp_path), dict)  # never started: this test tells what its process would
    signals = {"kind": "signals", "time_s": 8.0, "system": 1, "signals": {}, "taken": 0, "recent": {}}
    feed.flight = "first"
    feed._take({**signals, "flight": "first"})
    feed._take({"kind": "estimate", "identification": {"time_s": 8.0}})
    assert feed.current.identification == {"time_s": 8.0}
    feed.flight = None  # it has ended, and what was known of it stands
    assert feed.current.time_s == 8.0
    feed.flight = "second"
    assert (feed.current.time_s, feed.current.identification) == (None, None)
    feed._take({"kind": "begin"})
    feed._take({**signals, "time_s": 0.1, "flight": "second"})
    assert (feed.current.time_s, feed.current.identification) == (0.1, None)
