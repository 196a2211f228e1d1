"""What the posterior names of a flight that filter error has no name for counts where the filter bears it out."""

from __future__ import annotations

from dataclasses import replace

import pytest
from discrepancy_cases import Case, baseline_model, fly_case, the_vehicle
from made_up import MADE_UP

from sysid.discrepancy import discrepancy

pytestmark = pytest.mark.whole_flight

PART_S = 14.0


def test_a_lift_that_ripples_is_called_nothing_that_the_catalogue_holds() -> None:
    assert "lift_ripple" in MADE_UP
    case, vehicle = Case((), 20_000, 0.0, made_up="lift_ripple"), the_vehicle()
    flight = fly_case(case, vehicle)[0]
    # The search costs as much as the flight is long, and the first part already tells what the whole does.
    inside = {name: (one, one.time_s < PART_S) for name, one in flight.signals.items()}
    part = {name: replace(one, time_s=one.time_s[k], values=one.values[k]) for name, (one, k) in inside.items()}
    found = discrepancy([replace(flight, signals=part)], vehicle, baseline_model(case))
    assert found["verdict"] == "unexplained", found["reasons"]
    assert found["effects"] == []
