"""What the thrust sensor's noise adds to the estimates' errors, against fits with other thrust."""

from dataclasses import replace

import numpy as np
import pytest
from simulated import fly_mav

from sim_vehicle.model import read_model
from sim_vehicle.vehicle import load_vehicle
from sysid.estimate import fit, free_coefficients, warmed
from sysid.identify import make_problem
from sysid.inputnoise import with_thrust_noise
from sysid.prepare import check_compatibility, prepare

FACTOR = 3.0


@pytest.fixture(scope="module")
def case():
    """Problem, model, names and result of a pulse flight cut into two runs."""
    vehicle, model = load_vehicle("iitb-mav"), read_model("iitb-mav")
    signals, _ = fly_mav("elevator-pulse", 11)
    prepared = [prepare(signals, vehicle)]
    sensors = ("accel_bias_x", "accel_bias_z", "gyro_bias_q", "alpha_scale")
    problem = make_problem(prepared, vehicle, check_compatibility(prepared), sensors, run_s=6.0)
    names = free_coefficients(list(model.coefficients), problem.motion)
    return problem, model, names, fit(problem, model, names)


def test_each_error_of_the_thrust_moves_the_estimates_as_a_fit_with_it_would(case):
    problem, model, names, result = case
    told = with_thrust_noise(problem, model, names, (), result)
    added = np.diag(told.covariance - result.covariance)
    values = {p.name: float(v) for p, v in zip(result.parameters, result.theta, strict=False)}
    summed = np.zeros(len(result.parameters))
    for part in range(problem.records[0].thrust_doubt.shape[0]):
        moved = [replace(r, thrust=r.thrust + FACTOR * r.thrust_doubt[part]) for r in problem.records]
        again = fit(replace(warmed(problem, result), records=tuple(moved)), model, names, (), values)
        summed += ((again.theta - result.theta)[: summed.size] / FACTOR) ** 2
    assert len(problem.records) == 2
    for name in ("CL_0", "Cm_0", "CD_0"):
        i = [p.name for p in result.parameters].index(name)
        # A fit stops within a fifth of a standard error.
        assert np.sqrt(added[i]) == pytest.approx(np.sqrt(summed[i]), rel=0.15, abs=0.1 * result.std(name)), name
    assert told.std("CL_0") > 1.1 * result.std("CL_0")


def test_thrust_that_is_no_measurement_adds_nothing(case):
    problem, model, names, result = case
    exact = tuple(replace(r, thrust_doubt=np.zeros((0, 0))) for r in problem.records)
    assert with_thrust_noise(replace(problem, records=exact), model, names, (), result) is result
