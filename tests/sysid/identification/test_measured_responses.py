"""Frequency responses from records: against transfer functions in closed form, and a flight against its own model."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy import signal
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.arrays import Array
from sysid.identification.linear_model import RESPONSES, linearise
from sysid.identification.measured_responses import averaged, measured_response
from sysid.signals.preparation import prepare

pytestmark = pytest.mark.whole_flight

DT, SECONDS = 0.02, 200.0
# A short-period mode's transfer function, and one of the first order.
SECOND = ([3.0, 4.0], [1.0, 4.0, 25.0])
FIRST = ([2.0], [0.3, 1.0])


def moved(generator: np.random.Generator) -> Array:
    """An input that is held from sample to sample, most of it below 5 Hz."""
    b, a = signal.butter(2, 4.0, fs=1.0 / DT)
    return 0.05 * np.asarray(signal.lfilter(b, a, generator.standard_normal(round(SECONDS / DT))))


def answer(system: tuple[list[float], list[float]], u: Array) -> Array:
    """The output at the samples, exact for a held input."""
    numerator, denominator, _ = signal.cont2discrete(system, DT)
    return np.asarray(signal.lfilter(np.ravel(numerator), denominator, u))


def transfer(system: tuple[list[float], list[float]], frequency_hz: Array) -> Array:
    return np.asarray(signal.freqs(*system, worN=2.0 * np.pi * frequency_hz)[1])


def test_gain_and_phase_of_a_known_system_within_their_bars() -> None:
    generator = np.random.default_rng(2)
    u = moved(generator)
    y = answer(SECOND, u)
    found = averaged([(u[None], y + 0.3 * np.std(y) * generator.standard_normal(y.size))], DT)
    assert found is not None
    shown = (found.coherence > 0.6) & (found.frequency_hz < 5.0)
    assert shown.sum() > 30
    true = transfer(SECOND, found.frequency_hz)
    ratio = found.response / true
    # Between samples the held input is a staircase: sinc(f dt) of it, 1.6 % at 5 Hz.
    gain = (20.0 * np.log10(np.abs(ratio)) / np.maximum(found.gain_std_db, 0.1))[shown]
    phase = (np.angle(ratio) / np.maximum(found.phase_std_rad, 0.01))[shown]
    for off in (gain, phase):
        assert 0.5 < np.sqrt(np.mean(off**2)) < 1.6
        assert np.mean(np.abs(off) < 1.96) > 0.8


def test_coherence_is_the_share_of_the_output_that_the_input_makes() -> None:
    generator = np.random.default_rng(3)
    u = generator.standard_normal(round(20.0 * SECONDS / DT)) * 0.1
    y = answer(FIRST, u)
    noise = 0.01 * generator.standard_normal(y.size)
    found = averaged([(u[None], y + noise)], DT)
    assert found is not None
    # Of white input and noise: |H|^2 S_u / (|H|^2 S_u + S_n).
    made = np.abs(transfer(FIRST, found.frequency_hz)) ** 2 * 0.1**2
    off = (found.coherence - made / (made + 0.01**2))[found.frequency_hz < 4.0]
    # Of 200 windows a coherence of 0.8 is known to 0.02.
    assert abs(off.mean()) < 0.01
    assert np.abs(off).max() < 0.1


def test_an_input_is_freed_of_what_goes_with_another() -> None:
    generator = np.random.default_rng(4)
    first = moved(generator)
    second = 0.6 * first + 0.8 * moved(generator)
    y = answer(SECOND, first) + answer(FIRST, second)
    found = averaged([(np.stack([first, second]), y)], DT)
    alone = averaged([(first[None], y)], DT)
    assert found is not None
    assert alone is not None
    shown = (found.frequency_hz > 0.5) & (found.frequency_hz < 4.0)
    ratio = found.response / transfer(SECOND, found.frequency_hz)
    assert np.abs(ratio[shown] - 1.0).max() < 0.1
    # What takes the two for one is far off.
    shown = (alone.frequency_hz > 0.5) & (alone.frequency_hz < 4.0)
    assert np.abs(alone.response / transfer(SECOND, alone.frequency_hz) - 1.0)[shown].mean() > 0.3


@pytest.mark.parametrize(
    "seconds", [(12, 10, 10, 10, 10, 10), (12, *[10] * 20), (22, 19, 19, 19, 19), (40, *[15] * 20)]
)
def test_stretches_of_unequal_lengths_count_all(seconds: tuple[int, ...]) -> None:
    generator = np.random.default_rng(6)
    u = moved(generator)
    y = answer(SECOND, u)
    y = y + 0.3 * np.std(y) * generator.standard_normal(y.size)
    edges = np.cumsum([0, *(round(one / DT) for one in seconds)])
    u, y = np.resize(u, edges[-1]), np.resize(y, edges[-1])
    found = averaged([(u[None, a:b], y[a:b]) for a, b in pairwise(edges.tolist())], DT)
    assert found is not None
    ratio = found.response / transfer(SECOND, found.frequency_hz)
    shown = (found.coherence > 0.6) & (found.frequency_hz < 5.0)
    assert shown.sum() >= 8
    off = (20.0 * np.log10(np.abs(ratio)) / np.maximum(found.gain_std_db, 0.1))[shown]
    assert 0.3 < np.sqrt(np.mean(off**2)) < 2.0


def test_frequencies_at_which_feedback_alone_moves_the_input_are_left_out() -> None:
    """Above the test's band the controller answers the sensor's noise, and shows itself, inverted."""
    generator = np.random.default_rng(7)
    spectrum = np.fft.rfft(generator.standard_normal(12_000))
    spectrum[np.fft.rfftfreq(12_000, DT) > 2.0] = 0.0
    test = np.fft.irfft(spectrum, 12_000)
    y, noise, gain = np.zeros(12_000), 0.3 * generator.standard_normal(12_000), 0.2
    u = np.zeros(12_000)
    for k in range(11_999):
        u[k] = test[k] - gain * (y[k] + noise[k])
        y[k + 1] = 0.9 * y[k] + 0.1 * u[k]
    found = averaged([(u[None], y + noise)], DT)
    assert found is not None
    assert 1.5 < found.frequency_hz.max() < 2.5


def test_an_input_that_hardly_moves_or_a_record_too_short_shows_nothing() -> None:
    u = moved(np.random.default_rng(5))
    assert averaged([(1e-3 * u[None], answer(SECOND, u))], DT) is None
    assert averaged([(u[None, :100], answer(SECOND, u)[:100])], DT) is None


@pytest.mark.parametrize(("source", "output"), RESPONSES)
def test_a_flight_shows_the_response_that_its_model_has(source: str, output: str) -> None:
    """The simulation is not linear, and its sensors are those of Table II."""
    vehicle, model = load_vehicle("iitb-mav"), read_model("iitb-mav")
    flight = prepare(fly_mav("multisine", 3, duration=60.0)[0], vehicle)
    found = measured_response([flight], source, output)
    assert found is not None
    shown = (found.coherence > 0.8) & (found.frequency_hz > 0.3)
    assert shown.sum() >= 5
    there = linearise(vehicle, model, vehicle.flight.airspeed, 1.213).response(source, output, found.frequency_hz)[0]
    ratio = (found.response / there)[shown]
    assert abs(20.0 * np.log10(np.abs(ratio)).mean()) < 1.5
    assert abs(np.degrees(np.angle(ratio).mean())) < 10.0
