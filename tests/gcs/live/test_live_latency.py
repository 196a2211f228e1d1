"""How often the live process estimates, what it tells of it, and how old a message is when an estimate holds it."""

from __future__ import annotations

import json
import time
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_flights import pieces
from simulated import fly_mav
from traffic import SECOND, Vehicle, batch

from gcs.live.estimate_reports import EstimateReports
from gcs.live.feed import LiveFeed
from gcs.live.signals import Samples
from gcs.live.vehiclefile import WatchedVehicle
from gcs.live.worker import LiveProcess, run
from gcs.mavlink.dialect import Dialect
from gcs.settings import Settings
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.live.identifier import LiveIdentifier
from sysid.live.posterior_window import WindowEstimate
from sysid.live.recursive.change_detection import ChangeDetector
from sysid.live.recursive.coefficient_status import CoefficientStatus

TURN_S = 0.1


def test_latency_is_that_of_all_messages_to_the_first_estimate_that_holds_them(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("gcs.live.estimate_reports.time.time_ns", lambda: round(now[0] * 1e9))
    reports, told, updates = EstimateReports(load_vehicle("iitb-mav")), list[dict[str, Any]](), 0
    for turn, part in enumerate(pieces(fly_mav("multisine", 5, duration=12.0)[0], TURN_S), 1):
        now[0] = turn * TURN_S + 0.03  # so long after the newest message
        samples = {name: Samples(*entry) for name, entry in part.items() if entry[0].size}
        time_s = part["az"][0]
        reports.take(samples, time_s, np.rint(time_s * 1e9).astype(np.int64))
        report = reports.due(now[0])
        if report is None:
            values = reports.update(now[0])
            updates += values is not None
        else:
            told.append(report)
    latency = told[-1]["latency_ms"]
    # Each waits for the rest of its turn, the last of them also for the signals that reach its stamp in the next one.
    assert 65.0 < latency["median"] < 110.0
    assert latency["median"] + 30.0 < latency["p95"] < 160.0
    assert latency["messages"] > 400
    assert updates > 2 * len(told)
    assert abs(told[-1]["updates_per_s"] - 1.0 / TURN_S) < 0.5


def test_messages_that_no_estimate_holds_are_not_kept_and_have_no_latency() -> None:
    reports = EstimateReports(load_vehicle("iitb-mav"))
    for second in range(60):
        time_s = second + np.arange(50) / 50.0
        reports.take({"phi": Samples(time_s, time_s)}, time_s, np.full(50, time.time_ns()))
        report = reports.due(float(second))
    assert report is not None
    assert report["latency_ms"] is None
    assert sum(part.shape[1] for part in reports._waiting) <= 51


class Asked:
    """A runner whose promises are kept by the test."""

    def __init__(self) -> None:
        self.promises: list[Future[WindowEstimate]] = []

    def submit(self, function: object, /, *arguments: object) -> Future[WindowEstimate]:
        self.promises.append(Future())
        return self.promises[-1]


def test_an_estimate_that_was_done_with_the_last_messages_is_in_a_report_after_them() -> None:
    runner = Asked()
    reports, now = EstimateReports(load_vehicle("iitb-mav"), runner), 0.0
    for turn, part in enumerate(pieces(fly_mav("multisine", 5, duration=9.0)[0], TURN_S), 1):
        now = turn * TURN_S
        samples = {name: Samples(*entry) for name, entry in part.items() if entry[0].size}
        reports.take(samples, part["az"][0], np.rint(part["az"][0] * 1e9).astype(np.int64))
        reports.due(now)
    (promise,) = runner.promises
    reports.take(samples, part["az"][0], np.rint(part["az"][0] * 1e9).astype(np.int64))
    assert reports.due(now) is None  # the last report has been just now
    lift = CoefficientStatus("CL_alpha", 5.0, 0.1, True)
    promise.set_result(WindowEstimate(0.0, 8.2, 1.0, {"CL_alpha": lift}))
    values = reports.update(now)
    assert values is not None
    assert values["values"]["CL_alpha"] == (5.0, 0.1)
    after = [reports.due(now + 0.1 * turn) for turn in range(1, 30)]
    (told,) = [one for one in after if one is not None]
    assert told["coefficients"]["CL_alpha"]["known"]


def test_newer_values_are_in_what_the_service_knows_without_a_new_event(tmp_path: Path) -> None:
    feed = LiveFeed(Settings(data=tmp_path), dict)
    heard = list[float]()
    feed.on_estimate = lambda report, time_s: heard.append(time_s)
    feed._take({"kind": "values", "time_s": 4.0, "values": {"CL_alpha": [9.0, 9.0]}})
    assert feed.state.identification is None
    unknown = {"known": False, "why": "alpha has hardly moved", "fly": "elevator-3211"}
    coefficients = {"CL_alpha": {"known": True, "unit": "1/rad", "value": 2.0, "std": 0.2}, "CD_0": unknown}
    feed._take({"kind": "estimate", "identification": {"time_s": 5.0, "coefficients": coefficients, "warnings": ["w"]}})
    feed._take({"kind": "values", "time_s": 5.1, "values": {"CL_alpha": [2.1, 0.1], "CD_0": [0.1, 3.0]}})
    assert feed.state.estimate_number == 1
    assert feed.state.identification == {
        "time_s": 5.1,
        "coefficients": {"CL_alpha": {"known": True, "unit": "1/rad", "value": 2.1, "std": 0.1}, "CD_0": unknown},
        "warnings": ["w"],
    }
    assert coefficients["CL_alpha"]["value"] == 2.0  # whoever reads the last report reads it as it was


def test_turns_keep_to_their_share_of_a_core_and_come_twice_a_second_at_least(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = {"now": 0.0, "cpu": 0.0}
    costs = [0.002] * 100 + [0.009] * 200 + [0.5] * 100
    begun = list[float]()

    def sleep(seconds: float) -> None:
        clock["now"] += seconds

    def work(live: LiveProcess, records: object) -> None:
        begun.append(clock["now"])
        for name in clock:
            clock[name] += costs[len(begun) - 1]

    monkeypatch.setattr("gcs.live.worker._read", lambda unpacker: [] if len(begun) < len(costs) else None)
    monkeypatch.setattr("gcs.live.worker.time.monotonic", lambda: clock["now"])
    monkeypatch.setattr("gcs.live.worker.time.process_time", lambda: clock["cpu"])
    monkeypatch.setattr("gcs.live.worker.time.sleep", sleep)
    monkeypatch.setattr(LiveProcess, "take", work)
    run(LiveProcess(Dialect.load(), None))
    turns = np.diff(begun)
    np.testing.assert_allclose(turns[50:95], 0.04)
    np.testing.assert_allclose(turns[290:298], 0.1, rtol=0.05)
    np.testing.assert_allclose(turns[-20:], 0.5, rtol=1e-9)


def test_signals_are_told_ten_times_a_second_at_most_but_at_once_when_they_begin(
    capsys: pytest.CaptureFixture[str],
) -> None:
    live, vehicle = LiveProcess(Dialect.load(), WatchedVehicle("iitb-mav")), Vehicle()
    frames = vehicle.second()
    for turn in range(25):
        live.take([batch(frames[2 * turn : 2 * turn + 2], SECOND + turn * SECOND // 25)])
        live.report(5.0 + 0.04 * turn)
    told = [json.loads(line)["kind"] for line in capsys.readouterr().out.splitlines()]
    told = [kind for kind in told if kind != "taken"]
    assert told[:2] == ["begin", "signals"]
    assert 8 <= told.count("signals") <= 12


def test_changes_are_looked_for_as_often_however_often_estimates_are_made(monkeypatch: pytest.MonkeyPatch) -> None:
    looked: dict[float, list[float]] = {}
    check = ChangeDetector.check

    def counted(self: ChangeDetector, time_s: float, *known: Any) -> object:
        if self._axis == "Cm":
            looked[every].append(time_s)
        return check(self, time_s, *known)

    monkeypatch.setattr(ChangeDetector, "check", counted)
    flight = fly_mav("multisine", 5, duration=8.0)[0]
    for every in (0.06, 0.4):
        looked[every] = []
        live = LiveIdentifier(load_vehicle("iitb-mav"))
        for samples in pieces(flight, every):
            live.take(samples)
            live.update()
        assert np.all(np.abs(np.diff(looked[every]) - 0.4) < 0.07)
    assert abs(len(looked[0.06]) - len(looked[0.4])) <= 2
