"""Gusts against the closed forms of the Dryden spectra, and the wind as the effects ask for it."""

import numpy as np
import pytest
from dryden import dryden_spectrum
from scipy import integrate, signal

from sim_vehicle.flight.wind import WindField, dryden_gusts

SIGMA, LENGTH, AIRSPEED, DT = 0.7, 20.0, 15.0, 0.02


@pytest.fixture(scope="module")
def gusts() -> np.ndarray:
    return dryden_gusts(400_000, DT, sigma=SIGMA, length=LENGTH, airspeed=AIRSPEED, generator=np.random.default_rng(5))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_spectrum_integrates_to_the_variance(axis: int) -> None:
    whole, _ = integrate.quad(
        lambda w: float(dryden_spectrum(w, SIGMA, LENGTH, AIRSPEED)[axis]), 0.0, np.inf, limit=200
    )
    assert whole == pytest.approx(SIGMA**2, rel=1e-6)


def test_spectra_at_zero_frequency_are_the_printed_ones() -> None:
    # MIL-F-8785C: Phi_u(0) = 2 sigma^2 L / (pi V), Phi_w(0) = sigma^2 L / (pi V), per rad/s.
    along, side, down = dryden_spectrum(0.0, SIGMA, LENGTH, AIRSPEED)
    assert along == pytest.approx(2.0 * SIGMA**2 * LENGTH / (np.pi * AIRSPEED))
    assert side == down == pytest.approx(SIGMA**2 * LENGTH / (np.pi * AIRSPEED))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_variance(gusts: np.ndarray, axis: int) -> None:
    # 8000 s hold about 6000 correlation times of 1.33 s: the standard deviation is known to about 1 %.
    assert np.std(gusts[:, axis]) == pytest.approx(SIGMA, rel=0.05)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_spectrum_of_the_samples(gusts: np.ndarray, axis: int) -> None:
    hertz, power = signal.welch(gusts[:, axis], fs=1.0 / DT, nperseg=4096)
    # Sampling folds the tail back: what lies above the Nyquist frequency is small up to a tenth of it.
    band = (hertz > 0.05) & (hertz < 2.5)
    expected = dryden_spectrum(2.0 * np.pi * hertz[band], SIGMA, LENGTH, AIRSPEED)[axis] * 2.0 * np.pi
    assert np.mean(power[band] / expected) == pytest.approx(1.0, abs=0.03)
    slope = np.polyfit(np.log(hertz[band]), np.log(power[band] / expected), 1)[0]
    assert abs(slope) < 0.05


def test_correlation_of_the_along_gust(gusts: np.ndarray) -> None:
    # An exponential with L / V: 1/e after 1.333 s, at 67 samples 0.3660.
    along = gusts[:, 0]
    lag = 67
    measured = np.mean(along[:-lag] * along[lag:]) / np.mean(along**2)
    assert measured == pytest.approx(np.exp(-lag * DT * AIRSPEED / LENGTH), abs=0.03)


def test_axes_are_independent(gusts: np.ndarray) -> None:
    correlation = np.corrcoef(gusts.T)
    assert np.abs(correlation - np.eye(3)).max() < 0.04


def test_gusts_grow_from_calm_air_and_repeat_with_the_seed() -> None:
    field = WindField(sigma=SIGMA, length=LENGTH)
    first = field.gusts(500, DT, AIRSPEED, np.random.default_rng(1))
    again = field.gusts(500, DT, AIRSPEED, np.random.default_rng(1))
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first[0], np.zeros(3))
    assert np.ptp(first) > 0.5


def test_effects_add_to_the_wind_asked_for() -> None:
    effects = {
        "steady_wind": {"north": 1.0, "east": -2.0, "down": 0.5},
        "wind_shear": {"gradient": 0.05},
        "turbulence": {"sigma": 0.3, "length": 30.0},
    }
    field = WindField.from_effects((3.0, 0.0, 0.0), effects, 100.0)
    np.testing.assert_allclose(field.at(100.0), [4.0, -2.0, 0.5])
    np.testing.assert_allclose(field.at(120.0), [5.0, -2.0, 0.5])
    assert (field.sigma, field.length) == (0.3, 30.0)


def test_calm_air_without_effects() -> None:
    field = WindField.from_effects((0.0, 0.0, 0.0), {}, 100.0)
    assert not field.at(50.0).any()
    assert not field.gusts(10, DT, AIRSPEED, np.random.default_rng(0)).any()
