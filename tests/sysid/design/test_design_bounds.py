"""Predictions against the Cramer-Rao bound of the same flight, computed apart: by differences of whole simulations, and
with gusts by differences of single steps of the plant that flies."""

from __future__ import annotations

import numpy as np
import pytest
from flight_bounds import (
    LATERAL_OUTPUTS,
    LONGITUDINAL_OUTPUTS,
    Experiment,
    bounds,
    calm_information,
    slopes,
    true_model,
)
from gust_bounds import gust_information, gust_model, linear_path

from sim_vehicle.manoeuvres.plan import Plan
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.design import Prediction, predict, structure_of
from sysid.design.manoeuvre_sizing import tuned_plan
from sysid.design.simulated_flight import rehearse

pytestmark = pytest.mark.whole_flight

VEHICLE = load_vehicle("iitb-mav")
MODEL = read_model("iitb-mav")
SIGMA, LENGTH = 0.3, 20.0


@pytest.fixture(scope="module")
def plan() -> Plan:
    return tuned_plan(VEHICLE, MODEL, ["multisine"], duration=9.0)


@pytest.fixture(scope="module")
def experiment(plan: Plan) -> Experiment:
    _, flown = rehearse(VEHICLE, MODEL, plan, seed=5, noise="none", max_step=0.004)
    structure = structure_of(VEHICLE, None)
    return Experiment(
        flown, VEHICLE, true_model(MODEL, structure), (*LONGITUDINAL_OUTPUTS, *LATERAL_OUTPUTS), lateral=True
    )


def without_airspeed_errors(prediction: Prediction) -> dict[str, float]:
    """Standard errors for a known airspeed error, of which the compatibility check knows more than the bound does."""
    own = [i for i, name in enumerate(prediction.names) if not name.startswith("airspeed")]
    known = [i for i, name in enumerate(prediction.names) if name.startswith("airspeed")]
    whole = prediction.covariance
    left = whole[np.ix_(own, own)]
    if known:
        left = left - whole[np.ix_(own, known)] @ np.linalg.solve(
            whole[np.ix_(known, known)], whole[np.ix_(known, own)]
        )
    return {prediction.names[i]: float(np.sqrt(left[j, j])) for j, i in enumerate(own)}


def test_in_calm_air(plan: Plan, experiment: Experiment) -> None:
    predicted = without_airspeed_errors(predict(VEHICLE, MODEL, plan, rehearsals=1))
    told = slopes(experiment)
    bound = bounds(told.names, calm_information(told), list(predicted))
    for name in structure_of(VEHICLE, None):
        assert predicted[name] == pytest.approx(bound[name], rel=0.05), name


def test_in_turbulence(plan: Plan, experiment: Experiment) -> None:
    prediction = predict(VEHICLE, MODEL, plan, gusts=SIGMA, rehearsals=1)
    predicted = without_airspeed_errors(prediction)
    told, path = slopes(experiment), linear_path(experiment)
    dt = float(experiment.flown.time_s[1] - experiment.flown.time_s[0])
    gusts = gust_model(SIGMA, LENGTH, float(np.mean(experiment.flown.truth["V"])), dt)
    bound = bounds(told.names, gust_information(told, path, gusts), list(predicted))
    # The bound begins in calm air, the prediction amid the turbulence. What a constant is told at the start, before the
    # gusts have grown, counts for the one and not for the other, so these are left out.
    for name in (name for name in structure_of(VEHICLE, None) if not name.endswith("_0")):
        assert predicted[name] == pytest.approx(bound[name], rel=0.05), name
    assert prediction.gusts == SIGMA
