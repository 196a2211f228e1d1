"""Least squares against statsmodels, closed forms and simulated coverage."""

import numpy as np
import pytest

from sysid.equation_error.least_squares import gram_regress, regress
from sysid.errors import EstimationError
from sysid.numerics.gaussian import Gaussian


def problem(n=400, seed=0):
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 20.0, n)
    X = np.column_stack([np.ones(n), np.sin(t), np.cos(1.7 * t), np.sin(t) * 0.5 + np.sin(2.9 * t)])
    return rng, X, X @ np.array([0.2, 2.5, -0.6, 1.5])


def test_white_residuals_agree_with_statsmodels():
    import statsmodels.api as sm
    from statsmodels.stats.outliers_influence import variance_inflation_factor

    rng, X, truth = problem()
    y = truth + 0.1 * rng.standard_normal(truth.size)
    ours, theirs = regress(y, X, ["0", "a", "q", "de"]), sm.OLS(y, X).fit()
    assert ours.values == pytest.approx(theirs.params)
    assert ours.std_white == pytest.approx(theirs.bse)
    assert ours.r2 == pytest.approx(theirs.rsquared)
    assert ours.partial_f == pytest.approx(theirs.tvalues**2)
    assert ours.vif[1:] == pytest.approx([variance_inflation_factor(X, j) for j in (1, 2, 3)])
    assert ours.std == pytest.approx(theirs.bse, rel=0.5)


def test_gram_agrees_with_statsmodels_and_falls_back_when_ill_conditioned():
    import statsmodels.api as sm

    rng, X, truth = problem(5000)
    y = truth + 0.1 * rng.standard_normal(truth.size)
    values, covariance, variance = gram_regress(y, X)
    theirs = sm.OLS(y, X).fit()
    assert values == pytest.approx(theirs.params)
    assert covariance == pytest.approx(theirs.cov_params())
    assert variance == pytest.approx(theirs.scale)
    close = np.column_stack([X[:, 1], X[:, 1] + 1e-6 * X[:, 2]])
    values, _, _ = gram_regress(close @ np.array([1.0, 2.0]), close)
    assert values == pytest.approx([1.0, 2.0], rel=1e-6)


@pytest.mark.parametrize("colour", [0.0, 0.8, 0.95])
def test_standard_errors_cover_the_truth_with_coloured_residuals(colour):
    inside, naive = [], []
    for seed in range(200):
        rng, X, truth = problem(1000, seed)
        noise = rng.standard_normal(truth.size)
        for k in range(1, noise.size):
            noise[k] += colour * noise[k - 1]
        result = regress(truth + 0.05 * noise, X, ["0", "a", "q", "de"])
        error = np.abs(result.values - [0.2, 2.5, -0.6, 1.5])
        inside.append(error < 1.96 * result.std)
        naive.append(error < 1.96 * result.std_white)
    assert np.mean(inside) > 0.85
    if colour > 0.0:
        assert np.mean(naive) < np.mean(inside) - 0.1


def test_parts_are_not_correlated_across_their_joint():
    rng, X, truth = problem(1000)
    y = truth + 0.1 * rng.standard_normal(truth.size)
    together = regress(y, X, ["0", "a", "q", "de"])
    apart = regress(y, X, ["0", "a", "q", "de"], lengths=[400, 600])
    assert apart.values == pytest.approx(together.values)
    assert apart.std == pytest.approx(together.std, rel=0.3)


def test_collinearity_is_measured_and_dependence_refused():
    rng, X, truth = problem()
    y = truth + 0.1 * rng.standard_normal(truth.size)
    close = np.column_stack([X, X[:, 1] + 0.01 * rng.standard_normal(truth.size)])
    result = regress(y, close, ["0", "a", "q", "de", "alphadot"])
    assert result.vif[1] > 100.0
    assert result.condition > 30.0
    assert abs(result.correlation[1, 4]) > 0.95
    with pytest.raises(EstimationError, match="a and alphadot are linearly dependent"):
        regress(y, np.column_stack([X[:, :3], X[:, 1] * 2.0]), ["0", "a", "q", "alphadot"])


@pytest.mark.parametrize(
    ("y", "X", "message"),
    [
        (np.ones(3), np.ones((3, 3)), "too few"),
        (np.ones(30), np.zeros((30, 1)), "zero throughout"),
        (np.full(30, np.nan), np.ones((30, 1)), "not finite"),
        (np.ones(30), np.ones((29, 1)), "do not fit"),
    ],
)
def test_impossible_problems_are_refused(y, X, message):
    with pytest.raises(EstimationError, match=message):
        regress(y, X, [f"x{j}" for j in range(X.shape[1])])


def test_scaling_under_a_change_of_units():
    rng, X, truth = problem()
    y = truth + 0.1 * rng.standard_normal(truth.size)
    names = ["0", "a", "q", "de"]
    scale = np.array([1.0, np.rad2deg(1.0), 1e3, 1e-3])
    plain, scaled = regress(y, X, names), regress(y, X * scale, names)
    assert scaled.values * scale == pytest.approx(plain.values)
    assert scaled.std * scale == pytest.approx(plain.std)


def prior_of(std, mean=(0.2, 2.5, -0.6, 1.5)):
    return Gaussian(("0", "a", "q", "de"), np.array(mean), np.diag(np.square(std)))


def test_a_prior_counts_as_further_observations():
    """Theil & Goldberger: statsmodels' GLS of the flight and the prior's values, the noise being known."""
    import statsmodels.api as sm

    rng, X, truth = problem()
    y = truth + 0.1 * rng.standard_normal(truth.size)
    prior = prior_of([0.01, 0.02, 0.5, 0.01], (0.21, 2.48, 0.0, 1.52))
    found = regress(y, X, ["0", "a", "q", "de"], prior=prior)
    sigma = np.sqrt(sm.OLS(y, X).fit().scale)
    spread = np.concatenate([np.full(y.size, sigma), np.sqrt(np.diag(prior.covariance))])
    stacked = sm.WLS(np.concatenate([y, prior.mean]), np.vstack([X, np.eye(4)]), weights=spread**-2.0).fit()
    std = np.sqrt(np.diag(stacked.normalized_cov_params))
    assert np.abs(found.values - stacked.params) == pytest.approx(np.zeros(4), abs=0.25 * std.max())
    assert found.std == pytest.approx(std, rel=0.35)
    assert np.all(found.std < np.sqrt(np.diag(prior.covariance)) * 1.01)


def test_a_prior_tells_apart_what_the_flight_cannot():
    rng, X, truth = problem()
    y = truth + 0.1 * rng.standard_normal(truth.size)
    X = np.column_stack([X, 2.0 * X[:, 1]])
    names = ["0", "a", "q", "de", "twice"]
    with pytest.raises(EstimationError, match="linearly dependent"):
        regress(y, X, names)
    known = Gaussian(("twice",), np.array([0.25]), np.array([[1e-4]]))
    found = regress(y, X, names, prior=known)
    # The sum is 2.5; half of it is known to be in the second.
    assert found.values[4] == pytest.approx(0.25, abs=1e-3)
    assert found.values[1] == pytest.approx(2.0, abs=0.06)
    assert found.std[4] == pytest.approx(0.01, rel=0.05)
    assert found.std[1] > 0.02


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_intervals_with_a_prior_hold_the_truth_that_it_was_drawn_about(colour):
    inside = []
    std = np.array([0.02, 0.02, 0.05, 0.02])
    for seed in range(200):
        rng, X, _ = problem(600, seed)
        mean = np.array([0.2, 2.5, -0.6, 1.5])
        true = mean + std * rng.standard_normal(4)
        noise = rng.standard_normal(600)
        for k in range(1, 600):
            noise[k] += colour * noise[k - 1]
        found = regress(X @ true + 0.1 * noise, X, ["0", "a", "q", "de"], prior=prior_of(std))
        inside.append(np.abs(found.values - true) < 1.96 * found.std)
    assert 0.92 < np.mean(inside) < 0.985
