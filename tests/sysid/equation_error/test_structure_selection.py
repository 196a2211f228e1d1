"""Structure from data: hidden terms are found, absent ones are not, by stepwise regression and orthogonal functions."""

import numpy as np
import pytest

from sysid.equation_error.coefficient_tables import tables
from sysid.equation_error.least_squares import regress
from sysid.equation_error.orthogonal_functions import orthogonal_model, ranked
from sysid.equation_error.stepwise import candidate_terms, stepwise, trial
from sysid.errors import EstimationError

NAMES = ["CL_0", "CL_alpha", "CL_alpha2", "CL_alpha3", "CL_q", "CL_alpha_q", "CL_de", "CL_de2"]
HIDDEN = {"CL_0": 0.3, "CL_alpha": 4.5, "CL_alpha3": -60.0, "CL_de": 0.6}
N = 900


def flight(seed, noise=0.01, colour=0.0):
    """Columns of NAMES over a slow and a fast motion, and lift of the hidden terms with (coloured) noise."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 18.0, N)
    alpha = 0.05 + 0.12 * np.sin(0.9 * t + rng.uniform(0, 6)) + 0.05 * np.sin(4.1 * t + rng.uniform(0, 6))
    q = 0.01 * np.cos(2.3 * t + rng.uniform(0, 6)) + 0.01 * np.sin(5.7 * t)
    de = 0.05 * np.sign(np.sin(1.7 * t + rng.uniform(0, 6)))
    X = np.column_stack([np.ones(N), alpha, alpha**2, alpha**3, q, alpha * q, de, de**2 + 0.01 * np.sin(9.0 * t)])
    e = rng.standard_normal(N)
    for k in range(1, N):
        e[k] += colour * e[k - 1]
    return X, X @ [HIDDEN.get(name, 0.0) for name in NAMES] + noise * np.sqrt(1 - colour**2) * e


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_stepwise_finds_the_hidden_terms_and_hardly_ever_another(colour):
    right = wrong = 0
    for seed in range(25):
        X, y = flight(seed, 0.02, colour)
        found = stepwise(y, X, NAMES, forced=["CL_0"])
        right += set(HIDDEN) <= set(found.names)
        wrong += bool(set(found.names) - set(HIDDEN))
    assert right >= 24
    # The ordinary partial F lets an absent term in in most flights when residuals are as coloured as that.
    assert wrong <= 3


def test_every_step_and_every_refusal_is_on_record():
    X, y = flight(1)
    found = stepwise(y, X, NAMES, forced=["CL_0"])
    assert any("CL_alpha enters" in line for line in found.history)
    assert {test.name for test in found.excluded} == set(NAMES) - set(found.names)
    assert all(test.reason and "\n" not in test.reason for test in found.excluded)
    assert found.result.names == found.names


def test_a_term_that_a_better_one_makes_needless_leaves_again():
    """The first to enter is the sum of the two hidden columns; with both of these in, it is out."""
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((2, N))
    X = np.column_stack([a + b + 0.3 * rng.standard_normal(N), a, b])
    found = stepwise(a + b + 0.1 * rng.standard_normal(N), X, ["sum", "a", "b"])
    assert found.history[0] == "sum enters"
    assert set(found.names) == {"a", "b"}


def test_a_weak_control_beside_a_strong_slope_is_found_in_coloured_residuals():
    """de explains half a percent of the lift; the product of alpha and de hardly differs from de."""
    found = 0
    for seed in range(15):
        rng = np.random.default_rng(seed)
        t = np.linspace(0.0, 18.0, N)
        alpha = 0.07 + 0.04 * np.sin(1.3 * t) + 0.02 * np.sin(4.0 * t + rng.uniform(0, 6))
        de = 0.02 * np.sign(np.sin(2.9 * t + rng.uniform(0, 6)))
        noise = np.convolve(rng.standard_normal(N + 20), np.ones(21) / 21.0, mode="valid")
        X = np.column_stack([np.ones(N), alpha, de, alpha * de])
        chosen = stepwise(
            2.5 * alpha + 0.6 * de + 0.004 * noise, X, ["CL_0", "CL_alpha", "CL_de", "CL_alpha_de"], ["CL_0"]
        )
        found += set(chosen.names) == {"CL_0", "CL_alpha", "CL_de"}
    assert found >= 13


def test_the_test_of_a_term_is_that_of_statsmodels_for_white_residuals():
    import statsmodels.api as sm

    X, y = flight(3)
    theirs = sm.OLS(y, X[:, [0, 1, 6, 2]]).fit()
    test = trial(y, X[:, [0, 1, 6]], ["CL_0", "CL_alpha", "CL_de"], X[:, 2], "CL_alpha2", [N], 1.0)
    assert test.value == pytest.approx(theirs.params[3])
    assert test.r2_gain == pytest.approx(theirs.rsquared - sm.OLS(y, X[:, [0, 1, 6]]).fit().rsquared)
    white = regress(y, X[:, [0, 1, 6, 2]], ["a", "b", "c", "d"])
    assert white.partial_f[3] == pytest.approx(theirs.tvalues[3] ** 2)


def test_p_values_of_absent_terms_are_spread_as_chance_has_it():
    low = [
        trial(y, X[:, [0, 1, 3, 6]], list(HIDDEN), X[:, 4], "CL_q", [N], 1.0).p_value < 0.1
        for X, y in (flight(seed, 0.02, 0.8) for seed in range(150))
    ]
    assert 0.04 < np.mean(low) < 0.2


def test_nothing_to_find_is_said():
    rng = np.random.default_rng(0)
    with pytest.raises(EstimationError, match="no candidate"):
        stepwise(rng.standard_normal(200), rng.standard_normal((200, 3)), ["a", "b", "c"])
    with pytest.raises(EstimationError, match="none of the candidates"):
        stepwise(np.ones(200), np.ones((200, 1)), ["a"], forced=["z"])


def test_what_orthogonal_functions_explain_is_the_sequential_sum_of_squares():
    import statsmodels.api as sm
    from statsmodels.stats.anova import anova_lm

    X, y = flight(2)
    order, explained = ranked(y, X)
    assert order[0] == 0
    for count in (2, 4, 6):
        less, more = (sm.OLS(y, X[:, order[:k]]).fit() for k in (count - 1, count))
        assert explained[count - 1] == pytest.approx(float(anova_lm(less, more)["ss_diff"].iloc[1]), rel=1e-6)


@pytest.mark.parametrize("criterion", ["pse", "cross-validation"])
def test_orthogonal_functions_find_a_model_that_predicts_another_flight(criterion):
    X, y = flight(5, 0.03)
    found = orthogonal_model(y, X, NAMES, criterion=criterion)
    assert set(HIDDEN) <= set(found.names)
    assert len(found.names) <= 6
    other, lift = flight(77, 0.0)
    predicted = other[:, [NAMES.index(name) for name in found.names]] @ found.result.values
    assert np.sqrt(np.mean((predicted - lift) ** 2)) < 0.01


def test_the_criterion_is_the_predicted_square_error():
    import statsmodels.api as sm

    X, y = flight(6)
    found = orthogonal_model(y, X, NAMES)
    residual = sm.OLS(y, X[:, [NAMES.index(name) for name in found.order[:3]]]).fit().resid
    assert found.criterion[3] == pytest.approx(
        np.mean(residual**2) + 25.0 * sm.OLS(y, X).fit().ssr / N * 3 / N, rel=1e-6
    )
    with pytest.raises(EstimationError, match="known are pse, cross-validation"):
        orthogonal_model(y, X, NAMES, criterion="magic")


def test_a_stalling_lift_curve_comes_out_as_a_table_with_bars_that_hold():
    """Slope 5 up to 0.2 rad, -2 beyond: no low polynomial has that corner."""
    inside = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        alpha = rng.uniform(-0.1, 0.4, 2000)
        q = rng.standard_normal(2000)
        lift = np.where(alpha < 0.2, 5.0 * alpha, 1.0 - 2.0 * (alpha - 0.2)) + 0.1 * q
        y = lift + 0.05 * rng.standard_normal(2000)
        found = tables(y, np.column_stack([np.ones(2000), q]), ["CL_0", "CL_q"], alpha, ["CL_0"], count=11)["CL_0"]
        truth = np.where(found.knots < 0.2, 5.0 * found.knots, 1.0 - 2.0 * (found.knots - 0.2))
        away = np.abs(found.knots - 0.2) > 0.05
        inside.append(np.abs(found.values - truth)[away] < 1.96 * found.std[away])
        assert np.max(found.std[1:-1]) < 0.02
    assert 0.85 < np.mean(np.concatenate(inside)) <= 1.0


def test_a_straight_line_is_a_straight_table_however_few_samples_lie_far_out():
    """Most samples near trim, a few beyond the outermost knots: the line goes on there instead of ending."""
    rng = np.random.default_rng(11)
    alpha = 0.07 + 0.02 * rng.standard_normal(2000) + 0.08 * (rng.uniform(size=2000) < 0.3) * rng.standard_normal(2000)
    y = 0.2 + 2.5 * alpha + 0.01 * rng.standard_normal(2000)
    found = tables(y, np.ones((2000, 1)), ["CL_0"], alpha, ["CL_0"])["CL_0"]
    assert np.all(np.abs(found.values - 0.2 - 2.5 * found.knots) < 4.0 * found.std)
    assert found.std.max() < 0.01


def test_a_coefficient_that_is_constant_comes_out_as_a_flat_table_as_sharp_as_one_number():
    rng = np.random.default_rng(8)
    alpha, de = rng.uniform(0.0, 0.2, 1500), rng.standard_normal(1500)
    y = 0.7 * de + 0.1 * rng.standard_normal(1500)
    found = tables(y, de[:, None], ["CL_de"], alpha, ["CL_de"])["CL_de"]
    assert np.ptp(found.values) < 0.02
    assert found.values == pytest.approx(0.7, abs=0.02)
    # Level and slope are free: at the ends a straight line has twice the error of its middle.
    assert found.std.max() < 2.5 * 0.1 / np.sqrt(1500)


@pytest.mark.parametrize(("variable", "told"), [(np.zeros(300), "does not move"), (np.arange(300.0), "too few")])
def test_a_partition_that_cannot_be_is_refused(variable, told):
    X = np.ones((300 if told == "does not move" else 20, 1))
    with pytest.raises(EstimationError, match=told):
        tables(np.ones(X.shape[0]), X, ["CL_0"], variable[: X.shape[0]], ["CL_0"], count=12)


def test_candidates_keep_to_what_moved_and_to_the_symmetry_of_the_airframe():
    names = {term.name for term in candidate_terms("Cm", {"alpha", "q", "de"})}
    assert {"Cm_0", "Cm_alpha2", "Cm_alpha_de"} <= names
    assert not any("beta" in name for name in names)
    assert "Cn_alpha_beta" in {term.name for term in candidate_terms("Cn", {"alpha", "beta"})}
    assert "Cn_0" in {term.name for term in candidate_terms("Cn", set())}
