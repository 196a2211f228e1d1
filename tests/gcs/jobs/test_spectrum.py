"""Power spectral densities of recorded signals, against closed forms."""

import numpy as np
import pytest

from gcs.jobs.spectrum import power_spectral_density


def test_white_noise_has_its_variance_spread_evenly() -> None:
    generator = np.random.default_rng(5)
    time, values = np.arange(20_000) / 50.0, 0.3 * generator.standard_normal(20_000)
    frequency, density = power_spectral_density(time, values)
    middle = (frequency > 2.0) & (frequency < 23.0)
    assert np.mean(density[middle]) == pytest.approx(0.09 / 25.0, rel=0.03)  # one-sided: variance over half the rate
    assert np.trapezoid(density, frequency) == pytest.approx(0.09, rel=0.05)


def test_a_vibration_stands_at_its_frequency_with_its_power_at_any_stamps() -> None:
    generator = np.random.default_rng(6)
    time = np.sort(np.arange(6000) / 100.0 + generator.uniform(-0.002, 0.002, 6000))
    time = np.delete(time, slice(3000, 3050))  # half a second lost
    values = 2.0 * np.sin(2 * np.pi * 7.0 * time) + 3.0 + 0.1 * time
    values[10] = np.nan
    frequency, density = power_spectral_density(time, values)
    assert frequency[np.argmax(density)] == pytest.approx(7.0, abs=0.1)
    around = np.abs(frequency - 7.0) < 1.0
    assert np.trapezoid(density[around], frequency[around]) == pytest.approx(2.0, rel=0.1)  # half of the square


@pytest.mark.parametrize(
    ("time", "values"),
    [
        (np.arange(10.0), np.arange(10.0)),
        (np.zeros(100), np.ones(100)),
        (np.arange(100.0), np.full(100, np.nan)),
        (np.concatenate((np.arange(50.0), 1e6 + np.arange(50.0))), np.ones(100)),  # nearly all of it is a gap
        (np.arange(100.0), np.full(100, 1e300)),
    ],
)
def test_what_has_no_spectrum_has_none(time: np.ndarray, values: np.ndarray) -> None:
    frequency, density = power_spectral_density(time, values)
    assert frequency.size == density.size
    assert np.all(np.isfinite(density))
