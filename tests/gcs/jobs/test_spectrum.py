"""Power spectral densities of recorded signals, against closed forms."""

import numpy as np
import pytest

from gcs.jobs.spectrum import power_spectral_density, spectrogram


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


def test_a_spectrogram_shows_when_a_frequency_changes() -> None:
    time = 30.0 + np.arange(6000) / 100.0
    values = np.where(time < 60.0, 2.0 * np.sin(2 * np.pi * 5.0 * time), 0.5 * np.sin(2 * np.pi * 20.0 * time))
    middle, frequency, density = spectrogram(time, values)
    assert density.shape == (frequency.size, middle.size)
    assert middle[0] > 30.0
    assert middle[-1] < 90.0
    assert np.ptp(np.diff(middle)) < 1e-9
    strongest = frequency[np.argmax(density, axis=0)]
    assert np.all(np.abs(strongest[middle < 58.0] - 5.0) < 0.5)
    assert np.all(np.abs(strongest[middle > 62.0] - 20.0) < 0.5)
    power = np.sum(density, axis=0) * frequency[0]
    assert np.median(power[middle < 58.0]) == pytest.approx(2.0, rel=0.05)  # half of the square
    assert np.median(power[middle > 62.0]) == pytest.approx(0.125, rel=0.05)


def test_a_spectrogram_of_an_hour_has_few_columns_and_of_nothing_none() -> None:
    time = np.arange(180_000) / 50.0
    middle, frequency, density = spectrogram(time, np.random.default_rng(1).standard_normal(time.size))
    assert 150 <= middle.size <= 300
    assert np.ptp(np.diff(middle)) < 1e-6
    assert 3600.0 - middle[-1] < 2.0 * (middle[1] - middle[0])  # to its end
    assert density.shape == (frequency.size, middle.size)
    assert all(part.size == 0 for part in spectrogram(time[:20], time[:20]))
