"""Convolutions by Fourier transform against numpy's direct sums, the lag against scipy's recursive filter."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.numerics.filters import convolved, correlation, first_order_lag


@pytest.mark.parametrize(("count", "lags"), [(7, 3), (50, 50), (1009, 200)])
def test_correlation_is_the_sum_of_products_at_each_lag(count: int, lags: int) -> None:
    values = np.random.default_rng(count).normal(size=count)
    direct = np.correlate(values, values, mode="full")[count - 1 :][:lags]
    assert correlation(values, lags) == pytest.approx(direct, abs=1e-12 * count)


@pytest.mark.parametrize(("count", "half"), [(9, 1), (300, 40), (1009, 64)])
def test_columns_are_convolved_about_the_kernels_middle(count: int, half: int) -> None:
    generator = np.random.default_rng(count)
    rows, kernel = generator.normal(size=(count, 3)), generator.normal(size=2 * half + 1)
    direct = np.stack([np.convolve(column, kernel, mode="same") for column in rows.T], axis=1)
    assert convolved(rows, kernel) == pytest.approx(direct, abs=1e-11)


@pytest.mark.parametrize("kept", [0.0, 0.3, 0.999])
def test_lag_is_the_recursion(kept: float) -> None:
    values = np.random.default_rng(1).normal(size=2000)
    expected, _ = lfilter([1.0 - kept], [1.0, -kept], values, zi=[kept * 0.7])
    assert first_order_lag(values, kept, 0.7) == pytest.approx(expected, abs=1e-13)
