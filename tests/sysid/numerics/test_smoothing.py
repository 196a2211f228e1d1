import numpy as np
import pytest

from sysid.errors import SignalError
from sysid.numerics.smoothing import fourier_smooth, noise_sigma, smooth_columns

DT = 0.02
TIME = DT * np.arange(1000)
FREQUENCY = 2.0 * np.pi * 1.3
SIGNAL = 0.2 + 0.03 * TIME + np.exp(-0.1 * TIME) * np.sin(FREQUENCY * TIME)
SLOPE = 0.03 + np.exp(-0.1 * TIME) * (FREQUENCY * np.cos(FREQUENCY * TIME) - 0.1 * np.sin(FREQUENCY * TIME))


@pytest.mark.parametrize("sigma", [0.01, 0.1])
def test_noise_sigma_of_white_noise_on_a_moving_signal(sigma):
    rng = np.random.default_rng(3)
    found = [noise_sigma(SIGNAL + sigma * rng.standard_normal(TIME.size), DT) for _ in range(40)]
    assert np.mean(found) == pytest.approx(sigma, rel=0.05)
    jump = SIGNAL + np.where(TIME > 7.0, 30.0, 0.0) + sigma * rng.standard_normal(TIME.size)
    assert noise_sigma(jump, DT) == pytest.approx(sigma, rel=0.2)


def test_noise_sigma_of_a_coarse_converter_is_not_zero():
    rng = np.random.default_rng(4)
    step = 0.1
    coarse = step * np.round((0.5 * np.sin(0.5 * TIME) + 0.02 * rng.standard_normal(TIME.size)) / step)
    assert 0.0 < noise_sigma(coarse, DT) < step


def test_smoothing_removes_noise_without_lag():
    rng = np.random.default_rng(5)
    sigma = 0.1
    smoothed = fourier_smooth(SIGNAL + sigma * rng.standard_normal(TIME.size), DT)
    error = smoothed.values - SIGNAL
    assert np.sqrt(np.mean(error**2)) < 0.4 * sigma
    assert smoothed.noise_sigma == pytest.approx(sigma, rel=0.1)
    assert 1.3 < smoothed.cutoff_hz < 6.0
    # No lag: least squares of the error on the slope is the delay in seconds.
    inside = slice(50, -50)
    assert abs(np.dot(error[inside], SLOPE[inside]) / np.dot(SLOPE[inside], SLOPE[inside])) < 0.002


def test_smoothed_derivative():
    rng = np.random.default_rng(6)
    smoothed = fourier_smooth(SIGNAL + 0.02 * rng.standard_normal(TIME.size), DT, cutoff_hz=5.0)
    inside = slice(50, -50)
    assert np.sqrt(np.mean((smoothed.derivative - SLOPE)[inside] ** 2)) < 0.03 * np.abs(SLOPE).max()


def test_the_filter_is_linear_so_that_it_cancels_in_a_regression():
    rng = np.random.default_rng(7)
    a, b = rng.standard_normal((2, 400))
    both = fourier_smooth(2.0 * a - 3.0 * b, DT, 5.0)
    one, other = fourier_smooth(a, DT, 5.0), fourier_smooth(b, DT, 5.0)
    assert both.values == pytest.approx(2.0 * one.values - 3.0 * other.values)
    assert both.derivative == pytest.approx(2.0 * one.derivative - 3.0 * other.derivative)


def test_too_little_data_is_refused():
    with pytest.raises(SignalError):
        fourier_smooth(np.ones(10), DT)
    with pytest.raises(SignalError):
        noise_sigma(np.ones(8), DT)


def test_columns_smoothed_together_are_smoothed_as_each_alone():
    rng = np.random.default_rng(0)
    for size in (40, 301, 1000):
        values = np.cumsum(rng.standard_normal((size, 3)), axis=0)
        alone = np.column_stack([fourier_smooth(column, 0.02, 5.0).values for column in values.T])
        assert smooth_columns(values, 0.02, 5.0) == pytest.approx(alone, abs=1e-9)
    with pytest.raises(SignalError, match="finite"):
        smooth_columns(np.full((40, 1), np.nan), 0.02, 5.0)
