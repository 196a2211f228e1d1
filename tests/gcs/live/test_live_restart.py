"""A vehicle that is switched on again within its flight, from another port: its clock begins anew."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from traffic import SECOND, Vehicle, batch

from gcs.live.feed import LiveFeed
from gcs.live.protocol import Flight
from gcs.live.terminal_lines import LiveLines
from gcs.live.vehiclefile import WatchedVehicle
from gcs.live.worker import LiveProcess
from gcs.mavlink.dialect import Dialect
from gcs.settings import Settings

START = 1_800_000_000 * SECOND


def test_signals_and_estimates_begin_anew_with_the_vehicles_clock() -> None:
    live = LiveProcess(Dialect.load(), WatchedVehicle("iitb-mav"))
    vehicle, again = Vehicle(), Vehicle()
    vehicle.boot_ms = 60_000
    for second in range(20):
        live.take([batch(vehicle.second(), START + second * SECOND)])
    estimates = live._estimates
    live.take([batch(again.second(), START + 21 * SECOND)])
    assert live._estimates is not estimates
    assert live._messages.newest_s is not None
    assert live._messages.newest_s < 1.5
    assert "phi" in live._newest  # what comes is not held to be late


def test_what_was_known_of_a_flight_stands_until_the_signals_of_another_come(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    feed, live, vehicle = LiveFeed(Settings(data=tmp_path), dict), LiveProcess(Dialect.load(), None), Vehicle()

    def reported(now_s: float) -> list[str]:
        live.report(now_s)
        lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
        for line in lines:
            feed._take(dict(line))
        return [line["kind"] for line in lines if line["kind"] != "status"]

    live.take([Flight("first", 1), batch(vehicle.second(), START)])
    assert reported(1.0) == ["begin", "signals"]
    feed._take({"kind": "estimate", "identification": estimates(1.0)})
    live.take([Flight()])
    assert reported(2.0) == []
    assert feed.state.identification is not None
    live.take([Flight("second", 1), batch(Vehicle().second(), START + 20 * SECOND)])
    assert reported(21.0) == ["begin", "signals"]
    assert feed.state.identification is None
    assert feed.state.estimate_number == 1


def estimates(time_s: float, *warnings: str) -> dict[str, Any]:
    return {"time_s": time_s, "coefficients": {}, "events": [], "warnings": list(warnings)}


def test_a_warning_is_printed_again_for_a_vehicle_that_was_switched_on_again(tmp_path: Path) -> None:
    feed = LiveFeed(Settings(data=tmp_path), dict)
    lines = LiveLines(feed)

    def said(at_s: float, time_s: float) -> list[str]:
        feed._take({"kind": "estimate", "identification": estimates(time_s, "airspeed reads 8 % low")})
        return [line for line in lines.due(at_s) if "known" not in line]

    assert said(10.0, 30.0) == ["airspeed reads 8 % low"]
    assert said(20.0, 40.0) == []
    assert said(30.0, 5.0) == ["airspeed reads 8 % low"]
