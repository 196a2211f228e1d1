"""Noise taken off inputs: what is left of it against what theory says of the estimators that are imitated."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from sysid.signals.thrust.denoising import denoised_thrust, smooth_series

Array = NDArray[np.float64]

N, DT, SIGMA, RUNS = 500, 0.02, 0.02, 60
TIME = DT * np.arange(N)
STEADY = np.full(N, 0.46)


def errors(true: Array, throttle: Array, seed: int = 1) -> Array:
    """Denoised minus true, (RUNS, N), in units of the noise."""
    generator = np.random.default_rng(seed)
    noisy = [true + SIGMA * generator.standard_normal(N) for _ in range(RUNS)]
    runs = [denoised_thrust(one, throttle, DT).values - true for one in noisy]
    return np.array(runs) / SIGMA


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_a_constant_in_noise_becomes_its_mean() -> None:
    """The mean of N samples is off by sigma / sqrt(N); no estimate of a constant can be better."""
    left = errors(np.full(N, 3.7), STEADY)
    assert rms(left) * np.sqrt(N) == pytest.approx(1.0, abs=0.3)
    assert np.median(np.ptp(left, axis=1)) < 1e-9


def test_a_slow_swing_keeps_the_noise_of_the_terms_it_needs() -> None:
    """Of N cosine terms those up to 0.5 Hz are kept, 10 of 500: sqrt(10 / 500) of the noise stays."""
    swing = 3.0 + 0.5 * np.cos(2.0 * np.pi * 0.5 * (TIME + 0.5 * DT))
    left = errors(swing, STEADY)
    assert rms(left) == pytest.approx(np.sqrt(11.0 / N), rel=0.25)


def test_a_ramp_is_followed_well_below_the_noise() -> None:
    left = errors(3.0 + 0.1 * TIME, STEADY)
    assert rms(left) < 0.35
    assert abs(left.mean()) < 0.03


@pytest.mark.parametrize("tau", [0.0, 0.1, 0.3])
def test_a_step_of_a_lagging_motor_stays_as_sharp_as_it_is(tau: float) -> None:
    """Offset and gain leave sqrt(2 / N) of the noise; the unknown lag adds its own Cramer-Rao bound at the step.

    The response 1.6 (1 - exp(-t/tau)) has the slope 1.6 t/tau^2 exp(-t/tau) in tau, of square sum 1.6^2 / (4 tau dt).
    """
    throttle = np.where(np.arange(N) >= 200, 0.6, 0.4)
    after = np.maximum(TIME - TIME[200], 0.0)
    share = (after > 0.0).astype(float) if tau == 0.0 else 1.0 - np.exp(-after / tau)
    left = errors(8.0 * (0.4 + 0.2 * share), throttle)
    assert rms(left) == pytest.approx(np.sqrt(2.0 / N), abs=0.04)
    slope = np.zeros(N) if tau == 0.0 else 1.6 * after / tau**2 * np.exp(-after / tau)
    bound = np.sqrt(2.0 / N + np.mean(slope[195:215] ** 2) * 4.0 * tau * DT / 1.6**2)
    assert rms(left[:, 195:215]) < 1.5 * bound


@pytest.mark.parametrize("tau", [0.08, 0.13, 0.4])
def test_a_motor_whose_lag_is_none_of_those_tried_leaves_little(tau: float) -> None:
    throttle = np.where(np.arange(N) >= 200, 0.6, 0.4)
    share = 1.0 - np.exp(-np.maximum(TIME - TIME[200], 0.0) / tau)
    left = errors(8.0 * (0.4 + 0.2 * share), throttle)
    assert rms(left) < 0.75


def test_a_motor_still_spinning_up_at_the_first_sample_is_followed() -> None:
    """A throttle that steps with the first sample leaves the motor's answer, but not its cause, in the record."""
    throttle = np.where(np.arange(N) >= 200, 0.6, 0.4)
    share = 1.0 - np.exp(-np.maximum(TIME - TIME[200], 0.0) / 0.1)
    left = errors(8.0 * (0.4 + 0.2 * share) - 0.2 * np.exp(-TIME / 0.1), throttle)
    assert rms(left) < 0.12
    assert abs(left[:, :5].mean()) < 0.3


@pytest.mark.parametrize(
    ("step", "start", "swing", "unknowns"),
    [(0.0, 0.0, 0.0, 1), (0.2, 0.0, 0.0, 4), (0.2, 0.3, 0.0, 4), (0.0, 0.0, 0.5, 8)],
    ids=["constant", "throttle step", "spinning up", "swing"],
)
def test_the_errors_that_are_left_are_as_large_as_told(step: float, start: float, swing: float, unknowns: int) -> None:
    """Each of the unknowns that are fitted leaves sigma^2 of the summed square: what theory says, and what is told."""
    generator = np.random.default_rng(4)
    throttle = np.where(np.arange(N) >= 200, 0.4 + step, 0.4)
    share = 1.0 - np.exp(-np.maximum(TIME - TIME[200], 0.0) / 0.12)
    true = 8.0 * (0.4 + step * share) - start * np.exp(-TIME / 0.12)
    true = true + swing * np.cos(np.pi * 7.0 * (np.arange(N) + 0.5) / N)
    found, told = np.zeros(RUNS), np.zeros(RUNS)
    for run in range(RUNS):
        denoised = denoised_thrust(true + SIGMA * generator.standard_normal(N), throttle, DT)
        found[run] = np.sum((denoised.values - true) ** 2) / SIGMA**2
        told[run] = np.sum(denoised.doubt**2) / SIGMA**2
    assert np.mean(told) == pytest.approx(unknowns, rel=0.15)
    # Four standard errors of a mean of chi-squared values.
    assert np.mean(found) == pytest.approx(np.mean(told), abs=4.0 * np.sqrt(2.0 * unknowns / RUNS))


def test_thrust_that_falls_with_airspeed_needs_no_swings() -> None:
    """Level and two powers of the airspeed are three unknowns, however much the airspeed swings."""
    generator = np.random.default_rng(5)
    airspeed = 17.0 + sum(0.4 * np.sin(2.0 * np.pi * f * TIME + f) for f in (0.13, 0.31, 0.55, 0.9, 1.4))
    true = 2.5 - 0.27 * (airspeed - 17.0) - 0.004 * (airspeed - 17.0) ** 2
    found, told, plain = np.zeros(RUNS), np.zeros(RUNS), np.zeros(RUNS)
    for run in range(RUNS):
        read = true + SIGMA * generator.standard_normal(N)
        denoised = denoised_thrust(read, STEADY, DT, airspeed)
        assert denoised.by_airspeed
        found[run] = np.sum((denoised.values - true) ** 2) / SIGMA**2
        told[run] = np.sum(denoised.doubt**2) / SIGMA**2
        plain[run] = np.sum((denoised_thrust(read, STEADY, DT).values - true) ** 2) / SIGMA**2
    assert np.mean(told) == pytest.approx(3.0, rel=0.15)
    assert np.mean(found) == pytest.approx(3.0, abs=4.0 * np.sqrt(6.0 / RUNS))
    assert np.mean(plain) > 10.0 * np.mean(found)


def test_an_airspeed_that_has_nothing_to_do_with_thrust_is_not_believed() -> None:
    generator = np.random.default_rng(6)
    airspeed = 17.0 + np.sin(2.0 * np.pi * 0.3 * TIME)
    reads = [3.7 + SIGMA * generator.standard_normal(N) for _ in range(RUNS)]
    assert sum(denoised_thrust(read, STEADY, DT, airspeed).by_airspeed for read in reads) <= 2


def test_an_aircraft_that_is_faster_where_there_is_more_power_has_no_thrust_that_grows_with_airspeed() -> None:
    """The throttle is not recorded; what its swings do to thrust comes back as airspeed."""
    generator = np.random.default_rng(7)
    power = sum(0.4 * np.sin(2.0 * np.pi * f * TIME + f) for f in (0.13, 0.31, 0.55))
    read = 2.5 + power + SIGMA * generator.standard_normal(N)
    assert not denoised_thrust(read, STEADY, DT, 17.0 + 0.8 * power).by_airspeed
    assert denoised_thrust(5.0 - read, STEADY, DT, 17.0 + 0.8 * power).by_airspeed


def test_thrust_that_goes_with_the_square_of_the_throttle_is_explained_by_it_just_as_well() -> None:
    throttle = np.where(np.arange(N) >= 200, 0.6, 0.4)
    share = 1.0 - np.exp(-np.maximum(TIME - TIME[200], 0.0) / 0.1)
    left = errors(8.0 * (0.16 + 0.2 * share), throttle)
    assert rms(left) < 0.15


def test_a_throttle_that_has_nothing_to_do_with_thrust_is_not_believed() -> None:
    generator = np.random.default_rng(3)
    left = errors(np.full(N, 3.7), 0.46 + 0.01 * generator.standard_normal(N))
    assert rms(left) < 0.1


def test_what_cannot_be_smoothed_is_left_as_it_is() -> None:
    short, constant, gap = np.array([3.0, 3.1, 2.9]), np.full(N, 3.7), np.full(N, np.nan)
    for values in (short, constant, gap):
        np.testing.assert_array_equal(denoised_thrust(values, STEADY[: values.size], DT).values, values)


@given(
    level=st.floats(-50.0, 50.0).filter(lambda x: abs(x) > 1e-6),
    factor=st.floats(0.01, 100.0),
    seed=st.integers(0, 1000),
)
def test_smoothing_counts_in_any_unit_and_from_any_zero(level: float, factor: float, seed: int) -> None:
    noise = np.random.default_rng(seed).standard_normal(200)
    plain = smooth_series(level + noise)
    np.testing.assert_allclose(smooth_series(factor * (level + noise)), factor * plain, rtol=1e-9, atol=1e-9 * factor)
    assert plain.mean() == pytest.approx(level + noise.mean(), abs=1e-9 * max(1.0, abs(level)))


def test_a_series_without_noise_comes_back() -> None:
    smooth = 2.0 + np.cos(np.pi * (np.arange(300) + 0.5) * 7 / 300)
    np.testing.assert_allclose(smooth_series(smooth), smooth, atol=1e-10)


def test_the_noise_that_smoothing_passes_is_told_in_size_and_density() -> None:
    """Thrust of 60 swings of its own: against the error that is left, which only the truth tells."""
    count, runs = 1200, 10
    generator = np.random.default_rng(8)
    swings = np.cos(np.pi * np.outer(np.arange(1, 61), np.arange(count) + 0.5) / count)
    true = 3.0 + 0.05 * generator.choice([-1.0, 1.0], 60) @ swings
    left, told = [], []
    for _ in range(runs):
        found = denoised_thrust(true + SIGMA * generator.standard_normal(count), np.full(count, 0.5), DT)
        left.append(found.values - true)
        told.append(found.noise)
    assert float(np.mean([one.sigma for one in told])) == pytest.approx(rms(np.array(left)), rel=0.1)
    for one in told:
        assert 2.0 * one.sigma**2 * one.memory_s == pytest.approx(SIGMA**2 * DT, rel=0.2)
