"""Actuator effects: surface positions and what the motion feels of them, against closed forms.

What the motion feels is the integral of the surface. An aircraft with no aerodynamics but `Cm_de`, no thrust and no
gravity turns it into a pitch rate: q(t) = Cm_de qbar S c / Iyy * integral of de. Cm_de is so small that the aircraft
keeps its attitude, so this is exact.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import hand_flight as hf
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from sim_vehicle.effects import EFFECTS
from sim_vehicle.errors import ModelFileError
from sim_vehicle.flight.plant import Plant
from sim_vehicle.model.model_file import Model
from sim_vehicle.physics.layout import STATE_SIZE

Array = NDArray[np.float64]

DT = 0.02
CM_DE = 1e-6
RATE_PER_INTEGRAL = CM_DE * 0.5 * hf.RHO * hf.V**2 * hf.S * hf.C / hf.IYY


def flown(
    effects: dict[str, dict[str, float]], commands: Array, max_step: float = 0.005, dt: float = DT
) -> tuple[Array, Array]:
    """Surface behind each tick, and its integral as the motion felt it; commands: (N,) held, from rest at 0."""
    vehicle = hf.vehicle()
    vehicle = replace(vehicle, environment=replace(vehicle.environment, gravity=1e-15))
    model = Model("elevator", {}).with_coefficient("Cm_de", CM_DE)
    for name, values in effects.items():
        model = model.with_effect(EFFECTS[name], values)
    plant = Plant(vehicle, model, max_step=max_step)
    x = np.zeros(STATE_SIZE)
    x[3], x[6] = hf.V, 1.0
    state = plant.state_at(x, np.zeros(4), np.zeros(4))
    surface, integral = np.empty(commands.size), np.empty(commands.size)
    for k, command in enumerate(commands):
        plant.step(state, np.array([command, 0.0, 0.0, 0.0]), dt)
        surface[k], integral[k] = state.surfaces[0], state.x[11] / RATE_PER_INTEGRAL
    return surface, integral


def times(count: int) -> Array:
    return DT * np.arange(1, count + 1)


@pytest.mark.parametrize("max_step", [0.02, 0.007, 0.001])
def test_without_effects_the_surface_is_the_command(max_step: float) -> None:
    commands = np.random.default_rng(1).normal(0.0, 0.1, 40)
    surface, integral = flown({}, commands, max_step)
    np.testing.assert_array_equal(surface, commands)
    np.testing.assert_allclose(integral, DT * np.cumsum(commands), atol=1e-14)


@pytest.mark.parametrize("max_step", [0.02, 0.007, 0.001])
@pytest.mark.parametrize("tau", [0.004, 0.04, 0.2])
def test_a_lag_answers_a_step_with_an_exact_exponential(tau: float, max_step: float) -> None:
    surface, integral = flown({"actuator_lag": {"tau": tau}}, np.full(50, 0.1), max_step)
    t = times(50)
    np.testing.assert_allclose(surface, 0.1 * (1.0 - np.exp(-t / tau)), atol=1e-14)
    np.testing.assert_allclose(integral, 0.1 * (t - tau * (1.0 - np.exp(-t / tau))), atol=1e-13)


@pytest.mark.parametrize("max_step", [0.02, 0.007, 0.001])
@pytest.mark.parametrize("rate", [0.3, 1.7, 40.0])
def test_a_rate_limit_answers_a_step_with_a_ramp(rate: float, max_step: float) -> None:
    surface, integral = flown({"actuator_rate_limit": {"rate": rate}}, np.full(50, 0.1), max_step)
    t, end = times(50), 0.1 / rate
    np.testing.assert_allclose(surface, np.minimum(rate * t, 0.1), atol=1e-14)
    wanted = np.where(t < end, 0.5 * rate * t**2, 0.5 * 0.1 * end + 0.1 * (t - end))
    np.testing.assert_allclose(integral, wanted, atol=1e-13)


def test_a_rate_limit_is_the_same_upwards_and_downwards() -> None:
    commands = np.concatenate((np.full(20, 0.1), np.full(30, -0.2)))
    surface, _ = flown({"actuator_rate_limit": {"rate": 0.5}}, commands)
    np.testing.assert_allclose(np.diff(surface[:8]), 0.5 * DT, atol=1e-12)
    np.testing.assert_allclose(np.diff(surface[19:45]), -0.5 * DT, atol=1e-12)


@pytest.mark.parametrize("max_step", [0.02, 0.007, 0.001])
@pytest.mark.parametrize("delay", [0.0, 0.007, 0.02, 0.033, 0.04, 0.2, 1.0])
def test_a_delay_shifts_the_command_by_fractions_of_a_sample(delay: float, max_step: float) -> None:
    commands = np.random.default_rng(2).normal(0.0, 0.1, 80)
    _, integral = flown({"actuator_delay": {"delay": delay}}, commands, max_step)
    # The integral of a held command is a polygon through these points; the delay shifts it in time.
    knots, heights = DT * np.arange(81), np.concatenate(([0.0], DT * np.cumsum(commands)))
    np.testing.assert_allclose(integral, np.interp(times(80) - delay, knots, heights, left=0.0), atol=1e-13)


def test_a_delay_of_whole_ticks_shows_the_command_of_so_many_ticks_before() -> None:
    commands = np.random.default_rng(3).normal(0.0, 0.1, 40)
    surface, _ = flown({"actuator_delay": {"delay": 3 * DT}}, commands)
    np.testing.assert_allclose(surface, np.concatenate((np.zeros(3), commands[:-3])), atol=1e-12)


def test_a_delay_longer_than_what_is_kept_is_refused_not_cut_short() -> None:
    with pytest.raises(ModelFileError, match=r"at most 0\.63 s") as caught:
        flown({"actuator_delay": {"delay": 0.7}}, np.zeros(3), dt=0.01)
    assert "\n" not in str(caught.value)


def test_free_play_holds_the_surface_until_the_drive_has_crossed_it() -> None:
    """Full width 0.03 rad, worked out by hand: contact is 0.015 rad behind the drive on the side it comes from."""
    commands = np.array([0.01, 0.10, 0.08, 0.071, 0.0, -0.1, -0.08])
    wanted = np.array([0.0, 0.085, 0.085, 0.085, 0.015, -0.085, -0.085])
    surface, integral = flown({"actuator_backlash": {"width": 0.03}}, commands)
    np.testing.assert_allclose(surface, wanted, atol=1e-15)
    np.testing.assert_allclose(integral, DT * np.cumsum(wanted), atol=1e-14)


def test_free_play_turns_a_sine_into_a_hysteresis_loop_of_its_width() -> None:
    amplitude, width = 0.1, 0.03
    phase = np.linspace(0.0, 4.0 * math.pi, 400)
    commands = amplitude * np.sin(phase)
    surface, _ = flown({"actuator_backlash": {"width": width}}, commands)
    assert surface[200:].max() == pytest.approx(amplitude - width / 2, abs=2e-5)
    middle = np.argsort(np.abs(commands[200:]))[:2] + 200
    assert abs(surface[middle[0]] - surface[middle[1]]) == pytest.approx(width, abs=2e-3)


def test_free_play_behind_a_lag_is_felt_as_the_lag_less_half_the_width() -> None:
    tau, width = 0.05, 0.02
    effects = {"actuator_lag": {"tau": tau}, "actuator_backlash": {"width": width}}
    surface, _ = flown(effects, np.full(50, 0.1))
    drive = 0.1 * (1.0 - np.exp(-times(50) / tau))
    np.testing.assert_allclose(surface, np.maximum(drive - width / 2, 0.0), atol=1e-14)
    # Once in contact the integral grows with that of the lag: exact from tick to tick.
    _, integral = flown(effects, np.full(50, 0.1), max_step=0.02)
    rest = 0.1 * tau * np.exp(-times(50) / tau)
    grown = (0.1 - width / 2) * DT + np.diff(rest)
    np.testing.assert_allclose(np.diff(integral)[2:], grown[2:], atol=1e-13)


def test_elevator_gain_turns_the_elevator_alone_further() -> None:
    plant = hf.plant_with({"elevator_gain": {"scale": 0.12}})
    state = hf.state_of(plant)
    plant.step(state, np.array([0.1, 0.1, 0.1, 0.5]), DT)
    np.testing.assert_allclose(state.surfaces, [0.112, 0.1, 0.1, 0.5], rtol=1e-14)


def test_trim_with_a_false_gain_asks_for_less_and_flies_the_same() -> None:
    trims = [hf.plant_with(effects).trim() for effects in ({}, {"elevator_gain": {"scale": 0.12}})]
    np.testing.assert_allclose(trims[1].state.surfaces, trims[0].state.surfaces, atol=1e-9)
    assert trims[1].command[0] == pytest.approx(trims[0].command[0] / 1.12, abs=1e-9)


@pytest.mark.parametrize("channel", [0, 1, 2])
def test_actuator_effects_act_on_all_three_surfaces(channel: int) -> None:
    effects = {"actuator_lag": {"tau": 0.05}}
    plant = hf.plant_with(effects)
    state = hf.state_of(plant, command=np.array([0.0, 0.0, 0.0, 0.5]))
    command = np.array([0.0, 0.0, 0.0, 0.5])
    command[channel] = 0.1
    plant.step(state, command, DT)
    wanted = np.array([0.0, 0.0, 0.0, 0.5])
    wanted[channel] = 0.1 * (1.0 - math.exp(-DT / 0.05))
    np.testing.assert_allclose(state.surfaces, wanted, atol=1e-14)


NEUTRAL: dict[str, dict[str, float]] = {
    "actuator_delay": {"delay": 0.0},
    "actuator_backlash": {"width": 0.0},
    "elevator_gain": {"scale": 0.0},
}


@given(
    commands=st.lists(st.floats(-0.4, 0.4), min_size=1, max_size=12),
    max_step=st.sampled_from([0.02, 0.01, 0.003]),
    name=st.sampled_from(sorted(NEUTRAL)),
)
def test_an_actuator_effect_of_nothing_changes_nothing(commands: list[float], max_step: float, name: str) -> None:
    plain, neutral = (flown(effects, np.array(commands), max_step) for effects in ({}, {name: NEUTRAL[name]}))
    np.testing.assert_allclose(neutral[0], plain[0], atol=1e-15)
    np.testing.assert_allclose(neutral[1], plain[1], atol=1e-15)


@given(
    commands=st.lists(st.floats(-0.4, 0.4), min_size=2, max_size=15),
    effect=st.sampled_from(
        [
            ("actuator_lag", {"tau": 0.03}),
            ("actuator_rate_limit", {"rate": 2.0}),
            ("actuator_delay", {"delay": 0.031}),
            ("actuator_backlash", {"width": 0.05}),
        ]
    ),
)
def test_no_actuator_leaves_the_range_of_its_commands(
    commands: list[float], effect: tuple[str, dict[str, float]]
) -> None:
    surface, integral = flown({effect[0]: effect[1]}, np.array(commands))
    reach = max(*commands, 0.0) + 1e-12, min(*commands, 0.0) - 1e-12
    assert reach[1] <= surface.min() <= surface.max() <= reach[0]
    mean = np.diff(integral, prepend=0.0) / DT
    assert reach[1] <= mean.min() <= mean.max() <= reach[0]


@pytest.mark.parametrize(
    "effects",
    [
        {"actuator_lag": {"tau": 0.03}, "actuator_rate_limit": {"rate": 1.0}},
        {"actuator_lag": {"tau": 0.03}, "actuator_delay": {"delay": 0.027}},
        {"actuator_rate_limit": {"rate": 1.0}, "actuator_backlash": {"width": 0.02}},
        {"actuator_lag": {"tau": 0.03}, "actuator_rate_limit": {"rate": 1.0}, "actuator_backlash": {"width": 0.02}},
    ],
)
def test_several_elements_in_a_row_hardly_depend_on_the_step(effects: dict[str, dict[str, float]]) -> None:
    """Combinations are not advanced exactly; the step of an estimator must still be good enough for one."""
    commands = 0.1 * np.sin(2.0 * math.pi * 1.3 * DT * np.arange(100)) + np.where(np.arange(100) > 50, 0.1, 0.0)
    coarse, fine = flown(effects, commands, 0.01), flown(effects, commands, 0.0005)
    np.testing.assert_allclose(coarse[0], fine[0], atol=1.5e-3)
    np.testing.assert_allclose(coarse[1], fine[1], atol=5e-5)


def play(commands: Array, width: float, respond: Callable[[float, float], float]) -> Array:
    """Independent play operator in its rate form: the surface moves with the drive only while pushed."""
    out, position = [], 0.0
    for command in commands:
        position += respond(command - position, width)
        out.append(position)
    return np.array(out)


@given(commands=st.lists(st.floats(-0.4, 0.4), min_size=1, max_size=20), width=st.floats(0.0, 0.1))
def test_free_play_is_the_play_operator(commands: list[float], width: float) -> None:
    surface, _ = flown({"actuator_backlash": {"width": width}}, np.array(commands))
    wanted = play(np.array(commands), width, lambda gap, full: math.copysign(max(abs(gap) - full / 2.0, 0.0), gap))
    np.testing.assert_allclose(surface, wanted, atol=1e-14)


def test_a_dead_band_ignores_changes_of_up_to_half_its_width_and_then_obeys() -> None:
    commands = np.array([0.004, 0.005, 0.0051, 0.0, 0.0101, 0.0150, 0.0152, -0.01])
    wanted = np.array([0.0, 0.0, 0.0051, 0.0, 0.0101, 0.0101, 0.0152, -0.01])
    surface, integral = flown({"servo_deadband": {"width": 0.01}}, commands)
    np.testing.assert_allclose(surface, wanted, atol=1e-15)
    np.testing.assert_allclose(integral, DT * np.cumsum(wanted), atol=1e-14)


def test_a_servo_with_a_dead_band_lags_behind_what_it_has_accepted() -> None:
    tau = 0.04
    effects = {"servo_deadband": {"width": 0.02}, "actuator_lag": {"tau": tau}}
    surface, _ = flown(effects, np.concatenate((np.full(10, 0.1), np.full(20, 0.105))))
    np.testing.assert_allclose(surface, 0.1 * (1.0 - np.exp(-times(30) / tau)), atol=1e-14)


@pytest.mark.parametrize("cubic", [-2.0, 3.0])
def test_a_crooked_linkage_adds_the_cube_of_the_servos_position(cubic: float) -> None:
    commands = np.random.default_rng(4).normal(0.0, 0.1, 40)
    surface, integral = flown({"linkage_nonlinearity": {"cubic": cubic}}, commands)
    wanted = commands + cubic * commands**3
    np.testing.assert_allclose(surface, wanted, atol=1e-15)
    np.testing.assert_allclose(integral, DT * np.cumsum(wanted), atol=1e-14)


def test_the_aircraft_is_trimmed_through_a_crooked_linkage_with_a_wrong_gain() -> None:
    effects = {"linkage_nonlinearity": {"cubic": 4.0}, "elevator_gain": {"scale": 0.1}}
    straight, crooked = (Plant(hf.vehicle(), hf.model_with(one)).trim() for one in ({}, effects))
    np.testing.assert_allclose(crooked.state.surfaces, straight.state.surfaces, atol=1e-12)
    held = crooked.command[:3] + 4.0 * crooked.command[:3] ** 3
    np.testing.assert_allclose(held * [1.1, 1.0, 1.0], straight.command[:3], atol=1e-12)
