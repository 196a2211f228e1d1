"""Thrust that no sensor measures: by the propeller's speed, with an error that is estimated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from own_bars import own_bar
from simulated import fly_mav
from table_two import with_table_two

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identify import identify
from sysid.signals.flight import FlightSignals
from sysid.signals.thrust.source import thrust_in_air


def test_a_propeller_turns_into_thrust_by_its_advance_ratio() -> None:
    plane = load_vehicle("iitb-mav")
    assert plane.propulsion is not None
    curve = ((0.0, 0.10), (0.4, 0.06), (0.8, 0.0))
    plane = replace(plane, propulsion=replace(plane.propulsion, CT=curve, diameter=0.25, max_rpm=None))
    rpm, airspeed, rho = np.array([6000.0, 9000.0, 9000.0]), np.array([10.0, 15.0, 0.0]), np.array([1.2, 1.2, 1.0])
    n = rpm / 60.0
    # At advance ratios of 0.4, 0.4 and 0 the curve goes through its points.
    expected = rho * n**2 * 0.25**4 * np.array([0.06, 0.06, 0.10])
    np.testing.assert_allclose(thrust_in_air(rpm, airspeed, rho, plane), expected, rtol=1e-9)
    square = replace(plane, propulsion=replace(plane.propulsion, CT=(), max_thrust=8.0, max_rpm=9000.0))
    np.testing.assert_allclose(thrust_in_air(rpm, airspeed, rho, square), 8.0 * np.array([4.0 / 9.0, 1.0, 1.0]))


@pytest.mark.whole_flight
def test_a_flight_with_a_counter_instead_of_a_cell_tells_drag_within_what_a_propeller_is_known_to() -> None:
    signals, flown = fly_mav("multisine", 5)
    plane = with_table_two(load_vehicle("iitb-mav"))
    assert plane.propulsion is not None
    assert plane.propulsion.max_thrust is not None
    assert plane.propulsion.max_rpm is not None
    # A propeller that pulls 10 % less than the vehicle file says of the speed that is counted.
    square = np.sqrt(flown.truth["thrust"] / (0.9 * plane.propulsion.max_thrust)) * plane.propulsion.max_rpm
    counter = replace(signals.signals["rpm"], time_s=flown.time_s, values=square)
    kept = {name: one for name, one in signals.signals.items() if name != "thrust"} | {"rpm": counter}
    found = identify([FlightSignals("counted", kept)], plane, method="map", systematic=False)
    assert "one gain for all of it is estimated, known to 10% before" in " ".join(found.warnings)
    assert found.posterior is not None
    error = next(one for one in found.posterior.nuisances if one.name == "thrust_error")
    assert abs(error.value - 0.1) < 2.5 * error.std
    truth, drag = read_model("iitb-mav").values(), found.model.coefficients["CD_0"]
    assert drag.value is not None
    assert drag.std is not None
    assert abs(drag.value - truth["CD_0"]) < 2.5 * own_bar(drag)
    assert own_bar(drag) < 0.2 * truth["CD_0"]


@pytest.mark.whole_flight
def test_what_hangs_on_a_thrust_sensor_and_was_not_weighed_is_estimated_beside_the_drag() -> None:
    """A motor of 80 g on the cell: without it in the model CD_0 is 8 % off at six of its standard errors."""
    signals, _ = fly_mav("multisine,roller-coaster", 5)
    plane = load_vehicle("iitb-mav")
    assert plane.propulsion is not None
    weighed = plane.propulsion.moving_mass
    unweighed = replace(plane.propulsion, moving_mass=0.0, moving_mass_known=False)
    found = identify([signals], replace(plane, propulsion=unweighed), method="map", systematic=False)
    assert found.posterior is not None
    mass = next(one for one in found.posterior.nuisances if one.name == "moving_mass")
    assert mass.std < 0.6 * mass.prior_std
    assert abs(mass.value - weighed) < 3.0 * mass.std
    drag = found.model.coefficients["CD_0"]
    assert drag.value is not None
    assert drag.std is not None
    assert abs(drag.value - read_model("iitb-mav").values()["CD_0"]) < 3.0 * own_bar(drag) < 0.02
    assert "hang on the thrust sensor: weigh motor and propeller" in " ".join(found.warnings)
