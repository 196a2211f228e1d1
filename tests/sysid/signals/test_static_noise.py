"""Noise of a sensor at rest, from series whose noise is known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from sysid.errors import SignalError
from sysid.signals.flight import Signal
from sysid.signals.static_noise import allan_deviation, sensor_noise

RATE = 50.0
FLOOR = math.sqrt(2.0 * math.log(2.0) / math.pi)  # of the Allan deviation of flicker, IEEE Std 952


def series(seed: int, white: float, flicker: float = 0.0, walk: float = 0.0, size: int = 15_000) -> NDArray[np.float64]:
    """Samples with two-sided density white^2 + flicker^2 / (2 pi f) + walk^2 / (2 pi f)^2."""
    generator = np.random.default_rng(seed)
    values = white * math.sqrt(RATE) * generator.normal(size=size)
    values += walk / math.sqrt(RATE) * np.cumsum(generator.normal(size=size))
    if flicker:
        long = 4 * size  # so that the record does not begin and end alike
        frequencies = np.fft.rfftfreq(long, 1.0 / RATE)[1:]
        spread = np.sqrt(flicker**2 / (2.0 * math.pi * frequencies) / 2.0 * long * RATE)
        parts = generator.normal(size=(2, frequencies.size)) * spread
        values += np.fft.irfft(np.concatenate(([0.0], parts[0] + 1j * parts[1])), long)[:size]
    return values


def at_rest(values: NDArray[np.float64]) -> Signal:
    return Signal(np.arange(values.size) / RATE, values, "rad/s", "HIGHRES_IMU.xgyro")


def test_the_allan_deviation_is_its_definition_and_falls_with_the_root_of_time_for_white_noise() -> None:
    values = series(1, 0.01, size=4096)
    taus, deviations = allan_deviation(values, 1.0 / RATE)
    for m in (1, 4, 64):
        means = np.array([values[i : i + m].mean() for i in range(values.size - m + 1)])
        definition = math.sqrt(np.mean((means[m:] - means[:-m]) ** 2) / 2.0)
        assert deviations[list(taus * RATE).index(m)] == pytest.approx(definition, rel=1e-9)
    assert deviations[:7] == pytest.approx(0.01 / np.sqrt(taus[:7]), rel=0.2)


def test_white_noise_is_found_with_an_honest_error_and_nothing_else_is() -> None:
    misses = []
    for seed in range(40):
        noise = sensor_noise(at_rest(series(seed, 0.01)))
        assert noise.white.value is not None
        assert noise.white.std is not None
        misses.append((noise.white.value - 0.01) / noise.white.std)
        assert noise.bias_instability.value is None
        assert noise.rate_random_walk.value is None
        assert noise.peaks == ()
        assert noise.quantisation is None
        assert noise.dead_zone is None
        assert noise.sample_std == pytest.approx(0.01 * math.sqrt(RATE), rel=0.03)
    assert abs(np.mean(misses)) < 4.0 / math.sqrt(40)
    assert 0.7 < np.std(misses) < 1.35


@pytest.mark.parametrize(("flicker", "walk"), [(0.02, 0.0), (0.0, 0.01)])
def test_the_kind_of_drift_is_named_only_where_it_can_be_told(flicker: float, walk: float) -> None:
    told, misses = 0, []
    for seed in range(20):
        noise = sensor_noise(at_rest(series(seed, 0.01, flicker, walk)))
        right, wrong = noise.bias_instability, noise.rate_random_walk
        true = flicker * FLOOR
        if walk:
            right, wrong, true = wrong, right, walk
        assert wrong.value is None
        assert wrong.refused
        if right.value is not None:
            assert right.std is not None
            told += 1
            misses.append((right.value - true) / right.std)
    assert told >= 10
    assert np.abs(misses).max() < 4.0


def test_a_motor_shows_as_a_line_of_its_own() -> None:
    time = np.arange(15_000) / RATE
    motor = 0.03 * math.sqrt(2.0) * np.sin(2.0 * math.pi * 17.3 * time)
    noise = sensor_noise(at_rest(series(3, 0.01) + motor))
    assert len(noise.peaks) == 1
    assert noise.peaks[0].frequency_hz == pytest.approx(17.3, abs=2.0 * RATE / 15_000)
    assert noise.peaks[0].rms == pytest.approx(0.03, rel=0.05)
    assert noise.white.value == pytest.approx(0.01, rel=0.03)


def test_a_filter_in_the_sensor_is_seen_and_does_not_lower_its_noise() -> None:
    values = series(4, 0.01)
    filtered = np.empty_like(values)
    state, share = 0.0, 1.0 - math.exp(-2.0 * math.pi * 8.0 / RATE)
    for i, value in enumerate(values):
        state += share * (value - state)
        filtered[i] = state
    noise = sensor_noise(at_rest(filtered))
    assert noise.bandwidth_hz is not None
    assert 5.0 < noise.bandwidth_hz < 14.0
    assert noise.white.value == pytest.approx(0.01, rel=0.15)


@pytest.mark.parametrize("step", [0.001, 0.02, 0.08])
def test_the_step_of_a_reading_is_found(step: float) -> None:
    noise = sensor_noise(at_rest(step * np.rint(series(5, 0.01) / step) + 0.0123))
    assert noise.quantisation == pytest.approx(step, rel=1e-6)


def test_a_vane_that_sticks_has_a_dead_zone() -> None:
    free = np.cumsum(np.random.default_rng(6).normal(0.0, 0.002, 15_000))
    stuck = np.empty_like(free)
    place = 0.0
    for i, wanted in enumerate(free):
        if abs(wanted - place) > 0.02:
            place = wanted
        stuck[i] = place
    noise = sensor_noise(at_rest(stuck))
    assert noise.dead_zone == pytest.approx(0.02, rel=0.2)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.zeros(1000), "never changes"),
        (np.random.default_rng(0).normal(size=50), "too few"),
        (np.where(np.arange(1000) % 3 == 0, np.random.default_rng(0).normal(size=1000), np.nan), None),
        (np.full(1000, np.nan), "too few"),
    ],
)
def test_what_tells_nothing_is_refused_in_words(values: NDArray[np.float64], words: str | None) -> None:
    if words is None:  # every third sample alone is a slower sensor
        assert sensor_noise(at_rest(values)).rate_hz == pytest.approx(RATE / 3.0)
    else:
        with pytest.raises(SignalError, match=words):
            sensor_noise(at_rest(values))


def test_stamps_that_stand_still_and_lost_samples_are_named() -> None:
    values = series(0, 0.01, size=1000)
    with pytest.raises(SignalError, match="do not advance"):
        sensor_noise(Signal(np.zeros(1000), values, "rad/s", "x"))
    with pytest.raises(SignalError, match="missing"):
        sensor_noise(Signal(np.arange(1000) / RATE + 5.0 * (np.arange(1000) // 200), values, "rad/s", "x"))


@pytest.mark.parametrize("lost", [0.002, 0.05])
def test_lost_samples_do_not_change_the_step(lost: float) -> None:
    values = 0.01 * np.rint(series(7, 0.01) / 0.01)
    values[np.random.default_rng(2).random(values.size) < lost] = np.nan
    assert sensor_noise(at_rest(values)).quantisation == pytest.approx(0.01, rel=1e-6)


@pytest.mark.parametrize("rate", [30.0, 120.0, 300.0, 400.0])
def test_stamps_in_whole_milliseconds_are_a_clock_all_the_same(rate: float) -> None:
    values = np.random.default_rng(3).normal(0.0, 0.1, 6000)
    stamps = np.floor(1000.0 * np.arange(6000) / rate) / 1000.0
    noise = sensor_noise(Signal(stamps, values, "rad", "ATTITUDE.roll"))
    assert noise.rate_hz == pytest.approx(rate, rel=1e-4)
    assert noise.white.value is not None
    assert noise.white.std is not None
    assert abs(noise.white.value - 0.1 / math.sqrt(rate)) < 4.0 * noise.white.std
