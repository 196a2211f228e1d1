"""An aircraft in JSBSim whose propeller blows over a tail that is set: thrust turns it, though its line is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jsbsim_effects import with_terms
from jsbsim_flight import drawn_aircraft, fly, linear_aircraft, measure
from jsbsim_twin import product, regressor, value_of

from sysid.identify import identify
from sysid.posterior.stated_priors import is_line_given

WASH = "<quotient><property>forces/fbx-external-lbs</property><property>aero/qbar-area</property></quotient>"
GAIN = 3.0


def test_what_the_wash_turns_is_no_damping(tmp_path: Path) -> None:
    base = drawn_aircraft(7)
    own = base.model.values()
    blown = {axis: product(value_of(GAIN * own[name]), WASH, regressor("de", base.vehicle))
             for axis, name in (("Cm", "Cm_de"), ("CL", "CL_de"))}  # fmt: skip
    flown = fly(tmp_path, replace(base, functions=with_terms(base.functions, blown)), 300)
    signals = measure(flown, 300, "blown")[0]
    found = identify([signals], base.vehicle, method="map", systematic=False)
    pressure = 0.5 * flown.true["air_density"] * flown.true["true_airspeed"] ** 2 * base.vehicle.geometry.S
    wash = 1.0 + GAIN * float(np.mean(flown.commands["thrust"] / pressure))
    for name, truth in (("Cm_q", own["Cm_q"]), ("Cm_alpha", own["Cm_alpha"]), ("Cm_de", wash * own["Cm_de"])):
        one = found.model.coefficients[name]
        assert one.value == pytest.approx(truth, rel=0.35), name
        assert one.std is not None
        assert abs(one.value - truth) < 3.0 * one.std, name
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
