"""Information matrix and gradient of a record against the formula, samples missing."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.numerics.normal_equations import crossed, gram


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
