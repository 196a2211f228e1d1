"""Filter error starts where its filter follows the flight, however little noise the highest frequencies show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import fly_mav

from sim_vehicle.model.model_file import Coefficient, read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.arrays import Array
from sysid.compatibility.reconstruction import check_compatibility
from sysid.errors import EstimationError
from sysid.filter_error.estimation import build_filter
from sysid.filter_error.estimator import FilterError
from sysid.filter_error.initial_noise import followed, settled_path
from sysid.numerics.dryden import Turbulence
from sysid.problem.formulation import make_problem
from sysid.signals.preparation import prepare
from sysid.signals.record import OUTPUTS

VEHICLE = load_vehicle("iitb-mav")
TRUTH = read_model("iitb-mav")
GUSTS = Turbulence(0.3, 0.3)


@pytest.fixture(scope="module")
def start() -> tuple[FilterError, Array]:
    """A flight in gusts and a start that a closed loop might leave behind: wrong damping, wrong sign of CL_de."""
    flight = fly_mav("multisine", 5, effects=("turbulence:sigma=0.3,length=20",), duration=8.0)[0]
    prepared = [prepare(flight, VEHICLE)]
    problem = make_problem(prepared, VEHICLE, check_compatibility(prepared))
    wrong = {"CL_q": -36.0, "CL_de": -2.3, "Cl_p": -0.05, "Cm_alpha": -0.07}
    model = replace(TRUTH, coefficients={**TRUTH.coefficients, **{n: Coefficient(v) for n, v in wrong.items()}})
    flight_filter = build_filter(problem, model, list(model.coefficients))
    names = [parameter.name for parameter in flight_filter.predictor.parameters]
    return flight_filter, np.array([{**problem.sensors, **model.values()}[name] for name in names])


def too_trusting(one: FilterError) -> Array:
    """The noise that attitudes from a smooth filter of their own would show, a thousandth of theirs."""
    attitude = np.array([OUTPUTS[j] in ("phi", "theta", "psi") for j in one.columns])
    return np.where(attitude, 1e-6 * one.noise, one.noise)


def test_a_filter_that_runs_away_is_started_with_the_noise_that_the_flight_shows(
    start: tuple[FilterError, Array],
) -> None:
    one, theta = start
    honest, paths = one.noise, [path.copy() for path in one.paths]
    one.noise = too_trusting(one)
    with np.errstate(all="ignore"):
        _, lost = settled_path(one, theta, one.noise, GUSTS)
    one.paths = [path.copy() for path in paths]
    _, _, found = followed(one, theta, GUSTS)
    one.noise, one.paths = honest, paths
    misfit = np.mean([np.nanmean(nu**2 / s) for nu, s in zip(found.innovations, found.variances, strict=True)])
    assert not np.isfinite(lost.likelihood) or lost.likelihood < found.likelihood - 1e3
    assert misfit == pytest.approx(1.0, abs=0.7)
    assert np.isfinite(found.information).all()


def test_noise_is_brought_down_only_as_far_as_the_filter_follows(start: tuple[FilterError, Array]) -> None:
    """Without gusts to lean on, the noise that the first innovations show loses the flight."""
    one, theta = start
    honest, paths = one.noise, [path.copy() for path in one.paths]
    noise, _, found = followed(one, theta, Turbulence(0.02, 0.02))
    begun = one.noise
    one.noise, one.paths = honest, paths
    assert found.is_finite
    assert np.any(noise < 0.1 * begun)


def test_a_flight_that_no_noise_explains_is_refused_in_one_line(start: tuple[FilterError, Array]) -> None:
    one, theta = start
    kept = one.noise
    one.noise = np.full_like(kept, 1e-30)
    with pytest.raises(EstimationError, match="does not follow the flight") as caught:
        followed(one, theta, GUSTS)
    one.noise = kept
    assert "\n" not in str(caught.value)


def test_a_start_far_from_the_first_readings_is_followed_all_the_same(start: tuple[FilterError, Array]) -> None:
    """As a reconstruction from a lagging attitude leaves it: 0.35 rad of airflow and 0.3 rad of pitch away."""
    one, _ = start
    theta = np.array([TRUTH.values().get(p.name, p.prior_mean) for p in one.predictor.parameters])
    paths = [path.copy() for path in one.paths]
    near = settled_path(one, theta, one.noise, GUSTS)[1]
    one.paths = [path.copy() for path in paths]
    for path in one.paths:
        for states in (path.before, path.after, path.begin[None]):
            states[:, 2] -= 4.8
            states[:, 7] += 0.3
    settled_path(one, theta, one.noise, GUSTS)
    far = settled_path(one, theta, one.noise, GUSTS)[1]
    begun = [path.begin for path in one.paths]
    one.paths = paths
    # What was known of the start counts against it, once: 4.8 of 3 m/s and 0.3 of 0.3 rad.
    for mean, path in zip(begun, paths, strict=True):
        np.testing.assert_allclose(mean - path.begin, [0.0, 0.0, -4.8, 0.0, 0.0, 0.0, 0.0, 0.3, 0.0], atol=1e-12)
    assert near.likelihood - far.likelihood == pytest.approx(0.5 * (1.6**2 + 1.0), abs=1.0)
