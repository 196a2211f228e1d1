"""An aircraft in JSBSim whose propeller blows over a tail that is set: thrust turns it, though its line is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from jsbsim_flight import fly, linear_aircraft, measure
from short_windows import aircraft_of, truth_of

from sysid.identify import identify
from sysid.posterior.stated_priors import is_line_given


def test_what_the_wash_turns_is_no_damping(tmp_path: Path) -> None:
    aircraft = aircraft_of("slipstream", 7)
    flown = fly(tmp_path, aircraft, 300)
    found = identify([measure(flown, 300, "blown")[0]], aircraft.vehicle, method="map", systematic=False)
    truth = truth_of(flown, aircraft, "slipstream")
    for name in ("Cm_q", "Cm_alpha", "Cm_de"):
        one = found.model.coefficients[name]
        assert one.value == pytest.approx(truth[name], rel=0.35), name
        assert one.std is not None
        assert abs(one.value - truth[name]) < 3.0 * one.std, name
    assert found.model.effect("thrust_line_offset") is not None
    assert any("as if its line passed" in line for line in found.warnings)


def test_a_line_that_is_right_stays(tmp_path: Path) -> None:
    aircraft = linear_aircraft()
    assert is_line_given(aircraft.vehicle)
    signals = measure(fly(tmp_path, aircraft, 301), 301, "clean")[0]
    found = identify([signals], aircraft.vehicle, method="map", systematic=False)
    assert found.model.effect("thrust_line_offset") is None
    assert not any("as if its line passed" in line for line in found.warnings)
    propulsion = replace(aircraft.vehicle.propulsion, line_std=0.0)
    exact = identify([signals], replace(aircraft.vehicle, propulsion=propulsion), method="map", systematic=False)
    assert exact.posterior is not None
    assert not any(one.name == "thrust_arm" for one in exact.posterior.nuisances)
