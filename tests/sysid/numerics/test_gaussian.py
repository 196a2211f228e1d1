"""Knowledge from before the flight: Gaussian algebra against stacked least squares, and two flights in turn."""

from dataclasses import replace

import numpy as np
import pytest
from simulated import fly_mav

from sim_vehicle.model.model_file import Coefficient, Correlation, Model, model_from_json, read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.compatibility.reconstruction import check_compatibility
from sysid.identify import identify
from sysid.numerics.gaussian import Gaussian, known_from
from sysid.output_error.from_problem import fit
from sysid.problem.estimation_problem import model_of
from sysid.problem.formulation import make_problem
from sysid.problem.model_structure import default_structure, is_longitudinal
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import prepare

pytestmark = pytest.mark.whole_flight

VEHICLE = load_vehicle("iitb-mav")
TRUE = read_model("iitb-mav").values()


def least_squares(X, y):
    """Estimate and covariance for unit noise, by statsmodels."""
    import statsmodels.api as sm

    fitted = sm.GLS(y, X).fit()
    return fitted.params, fitted.normalized_cov_params


def observations(seed=1):
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((60, 3)) @ np.array([[1.0, 0.9, 0.0], [0.0, 0.3, 0.2], [0.0, 0.0, 1e-2]])
    return X, X @ np.array([2.0, -1.0, 50.0]) + rng.standard_normal(60)


def test_two_estimates_combined_are_the_estimate_of_all_observations():
    X, y = observations()
    first = Gaussian(("a", "b", "c"), *least_squares(X[:25], y[:25]))
    second = Gaussian(("c", "a", "b"), *least_squares(X[25:, [2, 0, 1]], y[25:]))
    both = first.combined(second)
    values, covariance = least_squares(X, y)
    assert both.names == ("a", "b", "c")
    assert both.mean == pytest.approx(values)
    assert both.covariance == pytest.approx(covariance)


def test_what_is_not_observed_again_follows_by_its_correlations():
    """The second set of observations knows nothing of c; the joint least squares does."""
    X, y = observations()
    X[25:, 2] = 0.0
    prior = Gaussian(("a", "b", "c"), *least_squares(X[:25], y[:25]))
    seen = Gaussian(("a", "b"), *least_squares(X[25:, :2], y[25:]))
    values, covariance = least_squares(X, y)
    both = prior.combined(seen)
    assert both.mean == pytest.approx(values)
    assert both.covariance == pytest.approx(covariance)
    known = prior.of(["a", "b"])
    assert known is not None
    updated = prior.updated(known.combined(seen))
    order = [updated.names.index(name) for name in ("a", "b", "c")]
    assert updated.mean[order] == pytest.approx(values)
    assert updated.covariance[np.ix_(order, order)] == pytest.approx(covariance)


def test_a_prior_survives_its_file():
    _, covariance = least_squares(*observations())
    std = np.sqrt(np.diag(covariance))
    given = Gaussian(("CL_0", "CL_alpha", "CL_de"), np.array([0.2, 2.0, 0.7]), covariance)
    model = Model(
        "m", {name: Coefficient(v, s) for name, (v, s) in given.entries().items()}, (), {}, given.correlation()
    )
    read, warning = known_from(model_from_json(model.to_json()))
    assert read is not None
    assert warning == ""
    assert read.names == given.names
    assert read.mean == pytest.approx(given.mean)
    assert read.covariance / np.outer(std, std) == pytest.approx(covariance / np.outer(std, std), abs=1e-5)


def test_nearly_singular_correlations_that_rounding_made_indefinite_are_no_knowledge():
    close = Correlation(("CL_0", "CL_alpha", "CL_q"), ((1.0, 1.0, 0.5), (1.0, 1.0, 0.499999), (0.5, 0.499999, 1.0)))
    entries = {name: Coefficient(1.0, 0.1) for name in close.names}
    read, _ = known_from(Model("m", entries, (), {}, close))
    assert read is not None
    assert np.linalg.eigvalsh(read.covariance)[0] > 0.0
    assert np.diag(read.covariance) == pytest.approx([0.01, 0.01, 0.01], rel=1e-4)


def test_standard_errors_alone_are_no_prior():
    known, warning = known_from(Model("old", {"CL_0": Coefficient(0.2, 0.01)}))
    assert known is None
    assert "start values only" in warning
    assert "\n" not in warning


NAMES = tuple(name for name in default_structure(("de",)) if is_longitudinal(name))


NOISE = {"ax": 0.08, "az": 0.08, "q": 5e-4, "theta": 9e-4, "alpha": 5e-3, "airspeed": 0.02}


def perfect_sensors(seed):
    """A flight of the elevator alone whose sensors have white noise and no other error."""
    flight = fly_mav("elevator-multisine", 1, noise="none")[0]
    rng = np.random.default_rng(seed)
    signals = {
        name: replace(each, values=each.values + NOISE.get(name, 0.0) * rng.standard_normal(each.values.size))
        for name, each in flight.signals.items()
    }
    return FlightSignals(f"elevator-{seed}", signals)


def test_two_flights_one_after_the_other_tell_what_both_tell_together():
    signals = [perfect_sensors(seed) for seed in (21, 22)]
    start = Model("m", {name: Coefficient(TRUE.get(name, 0.0)) for name in NAMES})

    def problem_of(flights):
        prepared = [prepare(flight, VEHICLE) for flight in flights]
        return replace(make_problem(prepared, VEHICLE, check_compatibility(prepared), []), command_first=False)

    told = model_of(start, "m", fit(problem_of(signals[:1]), start, NAMES), NAMES, [], [], {})
    known, _ = known_from(model_from_json(told.to_json()))
    second = problem_of(signals[1:])
    alone = fit(second, start, NAMES)
    then = fit(replace(second, known=known), start, NAMES)
    together = fit(problem_of(signals), start, NAMES)
    for name in NAMES:
        assert abs(then.value(name) - together.value(name)) < 0.2 * together.std(name), name
        assert then.std(name) == pytest.approx(together.std(name), rel=0.1), name
        assert then.std(name) < 0.85 * alone.std(name), name
        assert abs(then.value(name) - TRUE.get(name, 0.0)) < 3.5 * then.std(name), name


def test_what_a_flight_does_not_move_stays_as_it_was_known():
    """A prior with the lateral derivatives, one of them tied to Cm_de; the elevator alone moves the latter."""
    signals = [fly_mav("elevator-multisine", 21)[0]]
    lateral = {"Cl_p": Coefficient(-0.45, 0.02), "Cn_beta": Coefficient(0.08, 0.004)}
    entries = {"Cm_de": Coefficient(1.6, 0.02), **lateral}
    tied = Correlation(tuple(entries), ((1.0, 0.9, 0.0), (0.9, 1.0, 0.0), (0.0, 0.0, 1.0)))
    structure = Model("m", dict.fromkeys((*NAMES, *lateral, "Cl_beta"), Coefficient(0.0)))
    found = identify(signals, VEHICLE, structure=structure, prior=Model("p", entries, (), {}, tied), method="ee")
    after = found.model.coefficients
    assert {entry.name for entry in found.refused} & {"Cl_p", "Cn_beta", "Cl_beta"} == {"Cl_beta"}
    assert (after["Cn_beta"].value, after["Cn_beta"].std) == pytest.approx((0.08, 0.004))
    # Conditional mean and variance of a bivariate normal whose other half has become known.
    moved = (after["Cm_de"].value - 1.6) / 0.02
    assert after["Cl_p"].value == pytest.approx(-0.45 + 0.9 * 0.02 * moved)
    assert after["Cl_p"].std == pytest.approx(
        0.02 * np.sqrt(1 - 0.81 * (1 - (after["Cm_de"].extra["statistical_std"] / 0.02) ** 2))
    )
