"""A misaligned accelerometer beside a motor that hangs on the thrust sensor: its pull is misread too."""

from __future__ import annotations

import pytest
from simulated import fly_mav

from sim_vehicle.effects import EFFECTS
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.compatibility.reconstruction import check_compatibility
from sysid.filter_error.estimation import build_filter
from sysid.numerics.dryden import Turbulence
from sysid.problem.estimation_problem import free_coefficients, start_values
from sysid.problem.formulation import make_problem
from sysid.signals.preparation import prepare


@pytest.mark.whole_flight
def test_a_misaligned_accelerometer_is_not_taken_for_drag() -> None:
    vehicle, truth = load_vehicle("iitb-mav"), {"pitch": 0.052, "roll": 0.026}
    assert vehicle.propulsion is not None
    assert vehicle.propulsion.moving_mass > 0.0
    signals, _ = fly_mav("multisine", 11, effects=("accelerometer_misalignment:pitch=0.052,roll=0.026",))
    prepared = [prepare(signals, vehicle)]
    problem = make_problem(prepared, vehicle, check_compatibility(prepared))
    model = read_model("iitb-mav").with_effect(EFFECTS["accelerometer_misalignment"], {"pitch": 0.02, "roll": 0.01})
    model = model.with_effect(EFFECTS["polar_offset"], {"CD_CL": 0.0})
    names = free_coefficients(list(model.coefficients), problem.motion)
    effects = [("accelerometer_misalignment", name) for name in truth]
    flight = build_filter(problem, model, names, effects)
    found = flight.solve(start_values(problem, model, names, effects), Turbulence(0.02, 0.02), brief=True)
    assert abs(found.value("CD_CL")) < 4.0 * found.std("CD_CL")
    assert found.std("CD_CL") < 1e-3
    for name, value in truth.items():
        parameter = f"accelerometer_misalignment.{name}"
        assert abs(found.value(parameter) - value) < 4.0 * found.std(parameter)
        assert found.std(parameter) < 2e-3
