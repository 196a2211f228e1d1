"""Derivatives that no aircraft has: what made them so is in the others of their axes, of which nothing is reported."""

from __future__ import annotations

from dataclasses import replace

import pytest
from simulated import fly_mav

from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identification.identify import identify
from sysid.identification.result_file import result_json


@pytest.mark.whole_flight
@pytest.mark.parametrize("method", ["ee", "map"])
def test_of_a_flight_with_the_file_of_another_aircraft_no_lift_is_reported(method: str) -> None:
    vehicle = load_vehicle("iitb-mav")
    heavy = replace(vehicle, mass=replace(vehicle.mass, mass=10.0 * vehicle.mass.mass))
    flight, _ = fly_mav("multisine", 3, duration=15.0)
    for one, is_right in ((vehicle, True), (heavy, False)):
        found = identify([flight], one, method=method, systematic=False)
        lift, roll = found.model.coefficients["CL_alpha"], found.model.coefficients["Cl_p"]
        assert (lift.value is not None) == is_right
        assert roll.value is not None
        if not is_right:
            assert "is that of no wing" in lift.refused
            assert "is it the vehicle file of another aircraft?" in lift.refused
            assert found.quality.of_axis("Cm") == "poor"
            assert all(value.value is None for name, value in found.model.coefficients.items() if name[:2] == "Cm")
            assert found.model.correlation is None or not any(n[:2] == "CL" for n in found.model.correlation.names)
            if method == "ee":
                assert result_json(found)["regression"].keys() == {"CY", "Cl", "Cn"}
