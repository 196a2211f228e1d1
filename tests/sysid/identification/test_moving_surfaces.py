"""Surfaces that move between the samples of a log, flown by JSBSim, and commands that are held: each as it was."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from field_flight import at_rate, textbook
from field_inputs import inputs_of
from field_plant import fly_field
from field_sensors import sense
from jsbsim_flight import linear_aircraft
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identify import identify

MOMENTS = ("Cm_alpha", "Cm_q", "Cm_de", "Cl_beta", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr")


@pytest.mark.parametrize("positions", [True, False])
def test_half_a_sample_goes_into_no_coefficient(positions: bool, tmp_path: Path) -> None:
    """Taken as held from sample to sample, moments of such a flight come out a fifth too large by either method."""
    aircraft = linear_aircraft()
    log = fly_field(tmp_path, aircraft, inputs_of("3211", 25.0, np.random.default_rng(7)), 7)
    flight = sense(log, aircraft.vehicle, replace(at_rate(textbook(), 50.0), positions=positions), 7, "moving")
    truth = aircraft.model.values()
    for method, most in (("ee", 0.06), ("oe", 0.06)):
        found = identify([flight], aircraft.vehicle, method=method, systematic=False)
        off = {name: (found.model.coefficients[name].value or 0.0) / truth[name] - 1.0 for name in MOMENTS}
        assert max(map(abs, off.values())) < most, (method, off)
        assert abs(float(np.median(list(off.values())))) < 0.025, (method, off)
        assert all(one.record.joined for one in found.flights[0].stretches)


def test_commands_that_stay_until_the_next_are_taken_so() -> None:
    flight, truth = fly_mav("multisine", 3, duration=15.0)[0], read_model("iitb-mav").values()
    found = identify([flight], load_vehicle("iitb-mav"), method="ee", systematic=False)
    assert not any(one.record.joined for one in found.flights[0].stretches)
    off = {name: (found.model.coefficients[name].value or 0.0) / truth[name] - 1.0 for name in MOMENTS if name in truth}
    assert abs(float(np.median(list(off.values())))) < 0.02, off


def test_what_the_vehicle_file_says_of_its_servos_is_not_made_up_for() -> None:
    vehicle = load_vehicle("iitb-mav")
    late = replace(vehicle.controls["elevator"], delay=replace(vehicle.controls["elevator"].delay, value=0.02))
    flight = fly_mav("multisine", 3, duration=15.0)[0]
    stated = replace(vehicle, controls={**vehicle.controls, "elevator": late})
    found = identify([flight], stated, method="ee", systematic=False)
    assert not any(one.record.joined for one in found.flights[0].stretches)
