"""Of a long flight the stretches are taken in which the surfaces move most, and it is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import fly_mav

from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.signals import preparation
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import prepare


@pytest.fixture(scope="module")
def flight() -> FlightSignals:
    """Small inputs on all surfaces, with a tenfold rudder for five seconds near the end."""
    signals = fly_mav("multisine,multisine,multisine", 4)[0]
    rudder = signals.signals["dr"]
    end = float(rudder.time_s[-1])
    strong = np.where((rudder.time_s > end - 10.0) & (rudder.time_s < end - 5.0), 10.0, 1.0)
    return replace(signals, signals={**signals.signals, "dr": replace(rudder, values=strong * rudder.values)})


def test_a_long_flight_is_used_where_each_surface_moves_most(
    flight: FlightSignals, monkeypatch: pytest.MonkeyPatch
) -> None:
    vehicle = load_vehicle("iitb-mav")
    whole = prepare(flight, vehicle)
    assert not any("are used" in line for line in whole.warnings)
    monkeypatch.setattr(preparation, "MAX_STRETCH_S", 5.0)
    monkeypatch.setattr(preparation, "MOST_S", 20.0)
    short = prepare(flight, vehicle)
    seconds = sum(one.record.length * one.record.interval_s for one in short.stretches)
    assert 10.0 < seconds <= 20.0
    starts = [one.record.time_s[0] for one in short.stretches]
    assert starts == sorted(starts)
    strong = flight.signals["dr"].time_s[-1] - 7.5
    assert any(one.record.time_s[0] < strong < one.record.time_s[-1] for one in short.stretches)
    assert any("in which the surfaces move most; --from and --to take others" in line for line in short.warnings)
    # Who asks for a part gets all of it.
    asked = prepare(flight, vehicle, float(whole.stretches[0].record.time_s[0]), strong)
    assert sum(one.record.length * one.record.interval_s for one in asked.stretches) > 30.0
