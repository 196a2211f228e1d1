"""Inputs as functions of time and servos against closed forms and scipy's simulation of a linear system."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy import signal

from sysid.arrays import Array
from sysid.posterior.analysis import stirred_in
from sysid.posterior.flight_part import FlightPart
from sysid.posterior.inputs import InputSignal, in_steps, input_signal, interval_means, servo, surface_signal, swing

TIMES = np.arange(0.0, 4.0, 0.02)


def commanded(time_s: Array, values: Array, held: bool = False) -> InputSignal:
    """The command of a loop that has no other."""
    return input_signal(time_s, values, in_steps([values]), held)


def test_a_command_that_steps_is_held_and_one_that_never_rests_is_a_smooth_curve() -> None:
    stick = np.where(TIMES > 2.0, 0.1, 0.0)
    assert commanded(TIMES, stick).kind == "held"
    between = np.array([2.0099, 2.0199, 2.0201])
    np.testing.assert_array_equal(commanded(TIMES, stick).at(between), [0.0, 0.0, 0.1])
    wave = np.sin(2.0 * np.pi * 6.0 * TIMES)
    curve = commanded(TIMES, wave)
    middle = TIMES[20:-20] + 0.01
    assert np.abs(curve.at(middle) - np.sin(2.0 * np.pi * 6.0 * middle)).max() < 0.01
    # Straight lines lose far more.
    line = InputSignal(TIMES, wave, "joined")
    assert np.abs(line.at(middle) - np.sin(2.0 * np.pi * 6.0 * middle)).max() > 0.05


def test_a_measured_position_is_a_curve_that_keeps_what_lines_lose_and_does_not_overshoot() -> None:
    slow = np.arange(0.0, 4.0, 0.05)
    between = np.arange(0.5, 3.5, 0.001)
    wave = surface_signal(slow, np.sin(2.0 * np.pi * 2.0 * slow), None, position=True, stepping=True)
    line = InputSignal(wave.time_s, wave.values, "joined")
    gain = [
        2.0 * np.mean(one.at(between) * np.sin(2.0 * np.pi * 2.0 * between)) for one in (wave, line)
    ]  # whole periods
    assert abs(gain[0] - 1.0) < 0.25 * abs(gain[1] - 1.0)
    stick = np.where(slow > 2.0, 0.1, 0.0)
    step = surface_signal(slow, stick, None, position=True, stepping=True).at(between)
    assert step.min() >= 0.0
    assert step.max() <= 0.1


def test_steps_of_a_loop_that_is_faster_than_the_log_lie_between_its_stamps_and_do_not_overshoot() -> None:
    slow = np.arange(0.0, 4.0, 0.1)
    stick = commanded(slow, np.where(slow > 2.05, 0.1, 0.0))
    assert stick.kind == "eased"
    read = stick.at(np.arange(0.0, 3.9, 0.005))
    assert read.min() >= 0.0
    assert read.max() <= 0.1
    assert stick.at(np.array([2.05]))[0] == pytest.approx(0.05)


def test_a_command_that_is_known_to_stay_is_held_where_the_log_has_every_one() -> None:
    wave = np.sin(2.0 * np.pi * 2.0 * TIMES)
    assert commanded(TIMES, wave, held=True).kind == "held"
    # One of five commands is in this log: what was between them is not known.
    assert commanded(TIMES[::5], wave[::5], held=True).kind == "splined"


def test_a_curve_is_not_drawn_through_lost_samples() -> None:
    kept = (TIMES < 1.0) | (TIMES > 1.5)
    curve = commanded(TIMES[kept], np.sin(9.0 * TIMES[kept]))
    edge = np.sin(9.0 * TIMES[kept])[[49, 50]]
    stamps = TIMES[kept][[49, 50]]
    np.testing.assert_allclose(curve.at(np.array([1.25])), np.interp(1.25, stamps, edge))


@pytest.mark.parametrize("lag", [0.02, 0.06, 0.15])
def test_a_servo_is_the_second_order_system_with_that_lag_behind_its_delay(lag: float) -> None:
    grid = np.arange(0.0, 4.0, 0.005)
    told = InputSignal(TIMES, np.interp(TIMES, [0.0, 1.0, 1.5, 4.0], [0.0, 0.0, 0.2, 0.1]), "joined")
    delay, omega = 0.035, 1.6 / lag  # the corners of the command fall on the grid, where it is exact
    system = signal.TransferFunction([omega**2], [1.0, 1.6 * omega, omega**2])
    fine = np.arange(0.0, 4.0, 0.001)
    _, expected, _ = signal.lsim(system, told.at(fine - delay), fine)
    np.testing.assert_allclose(servo(told, grid, delay, lag, 0.0), expected[::5], atol=2e-5)


def test_backlash_holds_until_the_command_has_crossed_the_play() -> None:
    grid = np.arange(0.0, 4.0, 0.01)
    told = InputSignal(grid, np.abs((grid + 1.0) % 2.0 - 1.0), "joined")  # a triangle between 0 and 1
    moved = servo(told, grid, 0.0, 0.0, 0.05)
    assert np.abs(moved - told.values).max() == pytest.approx(0.05)
    assert np.ptp(moved[300:]) == pytest.approx(0.9, abs=0.02)


def test_means_over_intervals_are_exact_for_cubics_and_for_steps() -> None:
    h = 0.05
    middles = h * (np.arange(22) - 0.5)
    edges = 2.0 * h * np.arange(11)
    np.testing.assert_allclose(interval_means(middles**3, False), np.diff(edges**4) / 4.0 / (2.0 * h))
    # A step anywhere counts by exactly the share of its interval that it leaves.
    for moment in (0.3, 0.317, 0.325, 0.351):
        told = InputSignal(np.array([-1.0, moment]), np.array([0.0, 1.0]), "held")
        expected = np.clip((edges[1:] - moment) / (2.0 * h), 0.0, 1.0)
        np.testing.assert_allclose(interval_means(told.at(middles, h), True), expected, atol=1e-12)


def test_a_vane_swings_as_the_linear_system_of_its_frequency_and_damping() -> None:
    grid = np.arange(0.0, 3.0, 0.01)
    read = np.column_stack((np.sin(2.0 * np.pi * grid), np.cos(3.0 * grid) - 1.0))
    expected = []
    omega, fine = 2.0 * np.pi * 6.0, np.arange(0.0, 3.0, 0.001)
    for column in read.T:
        _, y, _ = signal.lsim(([omega**2], [1.0, 0.8 * omega, omega**2]), np.interp(fine, grid, column), fine)
        expected.append(y[::10])
    at_once = read.copy()
    swing(read, np.full(grid.size, 1.0 / 6.0), 0.01, 0.4)
    np.testing.assert_allclose(read.T, expected, atol=0.003)
    # A vane that swings faster and faster follows at once, and without a period it is no vane.
    for period, off in ((1e-3, 0.02), (1e-5, 2e-4), (0.0, 1e-12)):
        fast = at_once.copy()
        swing(fast, np.full(grid.size, period), 0.01, 0.4)
        np.testing.assert_allclose(fast, at_once, atol=off)


def test_a_step_that_comes_a_little_later_moves_the_servo_a_little() -> None:
    grid = np.arange(0.0, 4.0, 0.005)
    told = InputSignal(TIMES, np.where(TIMES > 2.0, 0.1, 0.0), "held")
    moved = [servo(told, grid, delay, 0.04, 0.0) for delay in (0.0302, 0.0307, 0.0312)]
    rate = (moved[2] - moved[0]) / 0.001
    assert rate.sum() * 0.005 == pytest.approx(-0.1, rel=1e-6)
    assert np.abs(rate + np.gradient(moved[1], grid)).max() < 0.2 * np.abs(rate).max()


def test_a_stick_in_whole_microseconds_is_no_step_and_a_step_beside_rounding_is() -> None:
    pulse = 0.00087
    asked = np.where((TIMES > 1.0) & (TIMES < 1.6), 0.06, 0.0)
    by_hand = np.zeros(TIMES.size)
    for i in range(1, TIMES.size):
        by_hand[i] = asked[i] + (by_hand[i - 1] - asked[i]) * np.exp(-(TIMES[i] - TIMES[i - 1]) / 0.03)
    rounded = np.round(by_hand / pulse) * pulse
    assert np.mean(np.diff(rounded) == 0.0) > 0.5
    assert commanded(TIMES, rounded).kind == "splined"
    trimmed = np.round((asked + 0.004 * np.sin(0.5 * TIMES)) / pulse) * pulse
    assert commanded(TIMES, trimmed).kind == "held"
    half_rate = np.repeat(0.05 * np.sin(7.0 * TIMES[::2]), 2)[: TIMES.size]
    assert commanded(TIMES, half_rate).kind == "held"


@pytest.mark.parametrize(("travel", "resolution", "stirs"), [
    (0.07, 0.03, True),  # 0.1 rad at 2 Hz in a log of 10 Hz, whose third differences are motion
    (0.0027, 2.5e-4, True),  # a sixth of a degree in steps of a twentieth
    (0.0021, 8e-4, False),  # no more than its sensor's noise
    (5e-5, 0.0, False),
])  # fmt: skip
def test_a_surface_stirs_that_moves_much_or_by_more_than_its_log_resolves(
    travel: float, resolution: float, stirs: bool
) -> None:
    signal = InputSignal(TIMES, np.zeros(TIMES.size), "eased", resolution)
    part = SimpleNamespace(inputs={"da": signal}, named=(), travel=lambda name: travel)
    assert stirred_in([cast("FlightPart", part)]) == (frozenset({"da"}) if stirs else frozenset())
