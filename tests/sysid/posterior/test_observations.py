"""Measurements at their own stamps: interpolation, bursts, and the spectrum of what is left, against closed forms."""

import numpy as np
import pytest

from sysid.posterior.observations import AFTER_GAPS_S, bursts, common_grid, joined_at, read_at
from sysid.posterior.residual_spectrum import LARGEST_MISFIT, LEAST_MISFIT, residual_spectrum

GRID = np.arange(0.0, 10.0, 0.01)


def test_a_series_is_read_at_any_stamps_to_third_order() -> None:
    stamps = np.random.default_rng(0).uniform(0.0, 9.99, 200)
    cubic = 0.3 * GRID**3 - GRID
    np.testing.assert_allclose(read_at(GRID, stamps) @ cubic, 0.3 * stamps**3 - stamps, atol=1e-9)
    wave = np.sin(2.0 * np.pi * 8.0 * GRID)
    inner = stamps[(stamps > 0.05) & (stamps < 9.9)]
    assert np.abs(read_at(GRID, inner) @ wave - np.sin(2.0 * np.pi * 8.0 * inner)).max() < 2e-3


def test_stamps_that_are_off_by_a_known_time_show_as_that_shift() -> None:
    stamps = np.arange(0.5, 9.0, 0.02)
    wave = np.sin(2.0 * np.pi * GRID)
    np.testing.assert_allclose(read_at(GRID, stamps - 0.007) @ wave, np.sin(2.0 * np.pi * (stamps - 0.007)), atol=1e-4)


def test_what_was_lost_does_not_count_and_neither_does_what_follows_of_it() -> None:
    stamps = np.concatenate((np.arange(0.0, 4.0, 0.02), np.arange(4.6, 10.0, 0.02)))
    (gap,) = bursts(stamps)
    assert gap == pytest.approx((3.98, 4.6))
    grid = common_grid(0.0, 10.0, 0.02, [gap], 0.5)
    inside = (grid.points > 4.0) & (grid.points < 4.6 + AFTER_GAPS_S[0] - 0.01)
    assert not grid.counted[inside].any()
    assert grid.counted[(grid.points < 3.9) | (grid.points > 4.7 + AFTER_GAPS_S[0])].all()
    many = common_grid(0.0, 10.0, 0.02, [(float(at), at + 0.3) for at in range(1, 10, 2)], 0.5)
    assert 0.5 < np.mean(many.counted) < 0.7
    values = np.sin(stamps)
    values[(stamps > 4.59) & (stamps < 5.0)] = 50.0
    seen = grid.bridged(joined_at(stamps, grid.points)) @ values
    assert np.abs(seen).max() < 1.1


def test_the_spectrum_of_noise_of_a_known_colour_is_found_with_its_cross_spectrum() -> None:
    generator = np.random.default_rng(1)
    grid = common_grid(0.0, 600.0, 0.02, [], 0.5)
    n = grid.points.size
    white = generator.standard_normal((2, n))
    slow = np.zeros(n)
    for k in range(1, n):
        slow[k] = 0.9 * slow[k - 1] + white[0, k]
    residual = np.stack((slow, 0.5 * slow + white[1]))
    found, _ = residual_spectrum([residual], [np.zeros_like(residual)], [grid], misfit=0.0)
    f = np.array([0.5, 2.0, 8.0])
    S = found.at(f)
    expected = 2.0 * 0.02 / np.abs(1.0 - 0.9 * np.exp(-2j * np.pi * f * 0.02)) ** 2
    np.testing.assert_allclose(S[:, 0, 0].real, expected, rtol=0.25)
    np.testing.assert_allclose(S[:, 1, 1].real, 0.25 * expected + 0.04, rtol=0.25)
    np.testing.assert_allclose(S[:, 0, 1].real, 0.5 * expected, rtol=0.3)
    assert np.all(np.linalg.eigvalsh(S) > 0.0)


def test_flat_residuals_leave_nothing_for_what_a_structure_lacks_and_coloured_ones_do() -> None:
    generator = np.random.default_rng(2)
    grid = common_grid(0.0, 60.0, 0.02, [], 0.5)
    motion = np.sin(2.0 * np.pi * 0.8 * grid.points)[None] + 0.1 * generator.standard_normal((1, grid.points.size))
    white = 0.001 * generator.standard_normal((1, grid.points.size))
    assert residual_spectrum([white], [motion], [grid])[1] == LEAST_MISFIT
    misfit = white + 0.02 * motion
    assert 0.01 < residual_spectrum([misfit], [motion], [grid])[1] <= LARGEST_MISFIT
    assert residual_spectrum([white + 0.5 * motion], [motion], [grid])[1] == LARGEST_MISFIT
