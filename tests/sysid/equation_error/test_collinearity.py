"""Collinearity diagnostics against statsmodels and the closed form of two columns."""

import numpy as np
import pytest

from sysid.equation_error.collinearity import collinearity, correlated_pairs
from sysid.errors import EstimationError


def two_columns(correlation, count=400):
    """Two columns of exactly this correlation about zero."""
    rng = np.random.default_rng(4)
    basis = np.linalg.qr(rng.standard_normal((count, 2)))[0]
    return np.column_stack([basis[:, 0], correlation * basis[:, 0] + np.sqrt(1 - correlation**2) * basis[:, 1]])


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.99, -0.9])
def test_two_columns_have_the_closed_forms(correlation):
    found = collinearity(two_columns(correlation) * [1.0, 1e3], ["alpha", "de"])
    rho = abs(correlation)
    assert found.condition == pytest.approx(np.sqrt((1 + rho) / (1 - rho)))
    assert found.vif == pytest.approx(1 / (1 - rho**2))
    assert found.proportions.sum(axis=0) == pytest.approx([1.0, 1.0])
    if rho > 0.0:
        assert found.proportions[-1] == pytest.approx((1 + rho) / 2)


def test_inflation_is_that_of_statsmodels():
    from statsmodels.stats.outliers_influence import variance_inflation_factor

    rng = np.random.default_rng(2)
    X = np.column_stack([np.ones(300), rng.standard_normal((300, 3)) @ rng.standard_normal((3, 3)) + 5.0])
    found = collinearity(X, ["0", "a", "b", "c"], constant=0)
    assert found.vif[1:] == pytest.approx([variance_inflation_factor(X, j) for j in (1, 2, 3)])
    assert found.vif[0] == 1.0


def test_regressors_that_move_together_are_named_and_the_others_are_not():
    rng = np.random.default_rng(3)
    q, de = rng.standard_normal((2, 500))
    X = np.column_stack([np.ones(500), q, q + 0.01 * rng.standard_normal(500), de])
    found = collinearity(X, ["Cm_0", "Cm_q", "Cm_alphadot", "Cm_de"], constant=0)
    ((index, members),) = found.groups()
    assert index > 100.0
    assert set(members) == {"Cm_q", "Cm_alphadot"}
    (words,) = found.words()
    assert "Cm_q, Cm_alphadot move together" in words
    assert collinearity(X[:, [0, 1, 3]], ["Cm_0", "Cm_q", "Cm_de"], constant=0).words() == []


def test_a_combination_of_many_is_named_by_its_inflation():
    rng = np.random.default_rng(5)
    X = rng.standard_normal((400, 4))
    X[:, 3] = X[:, :3].sum(axis=1) + 0.4 * rng.standard_normal(400)
    words = collinearity(X, ["a", "b", "c", "sum"]).words()
    assert any(line.startswith("sum is nearly a combination") for line in words)


def test_correlated_estimates_are_listed_strongest_first():
    matrix = np.array([[1.0, 0.92, 0.2], [0.92, 1.0, -0.97], [0.2, -0.97, 1.0]])
    assert correlated_pairs(["a", "b", "c"], matrix) == [("c", "b", -0.97), ("b", "a", 0.92)]


@pytest.mark.parametrize("column", [np.zeros(50), np.full(50, np.nan)])
def test_a_column_that_is_none_is_refused(column):
    with pytest.raises(EstimationError, match="zero throughout or not finite"):
        collinearity(np.column_stack([np.ones(50), column]), ["0", "a"])
