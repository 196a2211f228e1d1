"""Where a gap is: what swings alike by chance is no dependence."""

import numpy as np
from scipy.signal import lfilter

from sysid.arrays import Array
from sysid.discrepancy.localisation import _explained

INTERVAL, COUNT = 0.02, 2000


def dutch_roll(generator: np.random.Generator) -> Array:
    """Noise through a lightly damped swing of 1 Hz."""
    pole = np.exp((-0.6 + 2j * np.pi) * INTERVAL)
    noise = generator.standard_normal(COUNT + 500)
    return np.asarray(lfilter([1.0], np.real(np.poly([pole, np.conj(pole)])), noise)[500:], dtype=np.float64)


def test_two_swings_of_one_frequency_that_know_nothing_of_each_other() -> None:
    """Counted by the residual's own correlation up to its first zero, nine of a hundred pairs were beyond 0.001."""
    generator = np.random.default_rng(5)
    chances = np.array([_explained(dutch_roll(generator), dutch_roll(generator))[1] for _ in range(100)])
    assert float(np.mean(chances < 1e-3)) < 0.02
    assert float(np.mean(chances < 0.05)) < 0.1


def test_a_swing_that_follows_another_is_found_through_noise() -> None:
    generator = np.random.default_rng(6)
    cause = dutch_roll(generator)
    residual = 1.5 * cause / cause.std() + dutch_roll(generator) / dutch_roll(generator).std()
    share, chance = _explained(residual, cause)
    assert 0.55 < share < 0.85
    assert chance < 1e-4
