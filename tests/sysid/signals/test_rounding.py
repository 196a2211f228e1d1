"""Rounded surfaces against what they were, made without a line of ours; and what is no rounding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.arrays import Array
from sysid.signals.rounding import rounding_of, unrounded

TIME = 0.02 * np.arange(3000)
ELEVATOR = load_vehicle("iitb-mav").controls["elevator"]


def multisine(amplitude: float) -> Array:
    """Six sines to 5 Hz, rad."""
    generator = np.random.default_rng(3)
    waves = [np.sin(2.0 * np.pi * f * TIME + generator.uniform(0.0, 6.0)) for f in (0.2, 0.5, 1.1, 2.3, 3.7, 4.9)]
    return np.asarray(amplitude * np.sum(waves, axis=0) / 6.0)


@pytest.mark.parametrize("amplitude", [0.02, 0.1])
@pytest.mark.parametrize("known", [True, False])
def test_most_of_the_rounding_of_a_smooth_motion_is_taken_out(amplitude: float, known: bool) -> None:
    step = ELEVATOR.microsecond
    true = multisine(amplitude)
    rounded = step * np.round(true / step)
    control = ELEVATOR if known else None
    assert rounding_of(rounded, control).most == pytest.approx(0.5 * step, rel=1e-6)
    found = unrounded(TIME, rounded, control)
    before, after = np.std(rounded - true), np.std(found - true)
    assert before == pytest.approx(step / np.sqrt(12.0), rel=0.1)
    # A fifth of the band is motion: of white noise no filter that keeps it takes out more than all but 0.45.
    assert after < 0.55 * before
    assert np.abs(found - rounded).max() <= 0.5 * step * (1.0 + 1e-9)


@pytest.mark.parametrize("lost", [(20.0, 20.8), (31.0, 900.0)])
def test_what_jumps_over_lost_samples_is_smoothed_as_well(lost: tuple[float, float]) -> None:
    step = ELEVATOR.microsecond
    wave = 0.2 * multisine(0.02)
    behind = lost[0] <= TIME
    time_s, true = TIME + (lost[1] - lost[0]) * behind, wave + 0.15 * behind
    rounded = step * np.round(true / step)
    found = unrounded(time_s, rounded, ELEVATOR)
    whole = unrounded(TIME, step * np.round(wave / step), ELEVATOR)
    assert np.std(found - true) < 1.1 * np.std(whole - wave) < 0.7 * np.std(rounded - true)


@pytest.mark.parametrize("other", [1.0, 1.3])
def test_two_servos_are_rounded_each_by_itself(other: float) -> None:
    step = ELEVATOR.microsecond
    both = replace(ELEVATOR, servos=(2, 5), mix=(0.5, 0.5 * other), pwm=2 * ELEVATOR.pwm,
                   deflection=2 * ELEVATOR.deflection)  # fmt: skip
    true, roll = multisine(0.1), 0.03 * np.sin(2.0 * np.pi * 0.37 * TIME)
    left = true + roll
    right = (true - both.mix[0] * left) / both.mix[1]
    rounded = sum(mix * step * np.round(one / step) for mix, one in zip(both.mix, (left, right), strict=True))
    assert isinstance(rounded, np.ndarray)
    rounding = rounding_of(rounded, both)
    error = rounded - true
    assert np.std(error) == pytest.approx(rounding.std, rel=0.1)
    assert np.abs(error).max() <= rounding.most * (1.0 + 1e-9)
    assert np.std(unrounded(TIME, rounded, both) - true) < 0.55 * np.std(error)


def test_edges_stay_where_they_were() -> None:
    step = ELEVATOR.microsecond
    stick = step * np.round(np.where((TIME > 10.0) & (TIME < 12.0), 0.1, 0.0) / step)
    found = unrounded(TIME, stick, ELEVATOR)
    assert np.abs(found - stick).max() <= 0.5 * step * (1.0 + 1e-9)


@pytest.mark.parametrize(
    "values",
    [
        multisine(0.1),  # nothing is rounded
        np.where(TIME > 10.0, 0.1, 0.0),  # a step
        0.05 * np.sign(np.sin(TIME)) + 0.02 * np.sign(np.sin(1.7 * TIME)),  # a few positions of a stick
        np.round(np.random.default_rng(1).uniform(-0.3, 0.3, 30), 5).repeat(100),  # many, as they will
        np.zeros(3000),
    ],
)
def test_what_is_no_rounding_stays_as_it_is(values: Array) -> None:
    assert rounding_of(values, None).std == 0.0
    assert unrounded(TIME, values, None) is values
