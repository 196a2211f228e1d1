"""Information matrix and gradient of a record against the formula, samples missing."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from sysid.numerics.normal_equations import crossed, gram, inverse, solve


@pytest.mark.parametrize("columns", [np.array([0, 2, 3]), np.array([1]), np.array([], dtype=np.int64)])
def test_gram_and_what_others_add_are_the_weighted_sums_over_what_was_measured(columns: np.ndarray) -> None:
    generator = np.random.default_rng(0)
    s, residual = generator.standard_normal((2000, 4, 9)), generator.standard_normal((2000, 4))
    residual[::7, 2] = np.nan
    residual[5:90, 0] = np.nan
    s[10, 0, 3] = np.nan  # beside a sample that is missing
    sigma = np.array([0.1, 2.0, 0.5, 1.0])
    information, gradient = np.zeros((9, 9)), np.zeros(9)
    for j in columns:
        good = np.isfinite(residual[:, j])
        rows = s[good, j, :] / sigma[j]
        information += rows.T @ rows
        gradient += rows.T @ (residual[good, j] / sigma[j])
    told = gram(s, residual, columns, sigma)
    np.testing.assert_allclose(told[0], information, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(told[1], gradient, rtol=1e-12, atol=1e-9)
    # The same rows cut in two: what the second half adds to the equations of the first.
    across = crossed(s[:, :, :5].copy(), s[:, :, 5:].copy(), residual, columns, sigma)
    np.testing.assert_allclose(across, information[:5, 5:], rtol=1e-12, atol=1e-9)


def test_two_unknowns_that_a_flight_cannot_separate_have_no_small_variance() -> None:
    # A third, known to 1/2; of the first two their sum only.
    rows = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 2.0]])
    covariance = inverse(rows.T @ rows)
    assert covariance[0, 0] > 1e10
    assert covariance[1, 1] > 1e10
    assert covariance[2, 2] == pytest.approx(0.25, rel=1e-9)
    # The variance of the sum is what it is.
    both = np.array([1.0, 1.0, 0.0])
    assert both @ covariance @ both == pytest.approx(0.5, rel=1e-2)


def test_a_step_goes_nowhere_along_what_is_not_known() -> None:
    rows = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 2.0]])
    np.testing.assert_allclose(solve(rows.T @ rows, rows.T @ np.array([3.0, 3.0, 4.0])), [1.5, 1.5, 2.0], rtol=1e-9)
    full = np.array([[2e12, 1.0], [1.0, 3e-9]])
    right = np.array([[1.0, 0.0], [0.0, 2.0]])
    np.testing.assert_allclose(solve(full, right), np.linalg.solve(full, right), rtol=1e-9)


def test_information_is_inverted_in_one_place() -> None:
    # A pseudo-inverse gives a direction of which nothing is known no variance at all.
    root = Path(__file__).parents[3] / "sysid"
    users = {str(path.relative_to(root)) for path in root.rglob("*.py") if re.search(r"\bpinv\(", path.read_text())}
    assert users == {"numerics/smoothing.py"}  # a fit of given points, no information
