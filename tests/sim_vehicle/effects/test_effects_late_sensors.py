"""Sensors that come late, and a thrust sensor with play, against flights without them."""

from __future__ import annotations

import hand_flight as hf
import numpy as np
import pytest
from numpy.typing import NDArray

from sim_vehicle.effects.sensor_time_skew import GROUPS, late_reading
from sim_vehicle.errors import ModelFileError
from sim_vehicle.flight.plant import Plant
from sim_vehicle.physics.layout import CHANNELS

Array = NDArray[np.float64]

MEMBERS = {
    "vanes": ("alpha", "beta"),
    "air_data": ("airspeed",),
    "imu": ("p", "q", "r", "ax", "ay", "az"),
    "attitude": ("phi", "theta", "psi"),
}
COLUMN = {name: j for j, name in enumerate(CHANNELS)}


def readings(effects: dict[str, dict[str, float]], dt: float, ticks: int, repeat: int = 1) -> Array:
    """(N, 19) of a flight under commands that change smoothly every `repeat` ticks."""
    plant = Plant(hf.vehicle(tau=0.1), hf.model_with(effects), max_step=0.005)
    state = hf.state_of(plant)
    found = np.empty((ticks, len(CHANNELS)))
    for k in range(ticks):
        found[k] = state.reading
        phase = 3.0 * dt * (k // repeat) * repeat
        plant.step(state, hf.SURFACES + 0.03 * np.sin(phase + np.arange(4.0)) * [1, 1, 1, 5], dt)
    return found


@pytest.mark.parametrize("group", GROUPS)
def test_a_delay_of_whole_ticks_shows_the_readings_of_so_many_ticks_before(group: str) -> None:
    plain = readings({}, 0.02, 40)
    late = readings({"sensor_time_skew": {"delay": 0.06, "group": float(GROUPS.index(group))}}, 0.02, 40)
    for name, j in COLUMN.items():
        wanted = plain[:, j]
        if name in MEMBERS[group]:
            wanted = np.concatenate((np.full(3, wanted[0]), wanted[:-3]))
        np.testing.assert_allclose(late[:, j], wanted, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("ticks", [1, 2, 3, 5])
def test_between_ticks_the_motion_is_that_of_a_flight_in_finer_ticks(ticks: int) -> None:
    """Once the delay is past the start: exactly, though held commands bend the slopes within every tick."""
    fine = readings({}, 0.005, 400, repeat=4)
    effects = {"sensor_time_skew": {"delay": 0.005 * ticks, "group": float(GROUPS.index("imu"))}}
    late = readings(effects, 0.02, 100)
    for name in ("p", "q", "r", "ax", "az"):
        wanted = fine[4 * np.arange(25, 100) - ticks, COLUMN[name]]
        np.testing.assert_allclose(late[25:, COLUMN[name]], wanted, atol=1e-9, err_msg=name)


def test_a_heading_that_comes_late_passes_south_as_it_should() -> None:
    heading = np.pi - 0.05 + 0.04 * np.arange(8.0)
    wrapped = (heading + np.pi) % (2.0 * np.pi) - np.pi
    for last in range(4, 8):
        wanted = (heading[last] - 0.04 * 1.5 + np.pi) % (2.0 * np.pi) - np.pi
        assert late_reading(wrapped, last, 1.5, True) == pytest.approx(wanted, abs=1e-12)


def test_a_delay_longer_than_what_is_kept_is_refused() -> None:
    plant = Plant(hf.vehicle(), hf.model_with({"sensor_time_skew": {"delay": 0.25, "group": 0.0}}))
    with pytest.raises(ModelFileError, match=r"sensor_time_skew: delay must be at most 0\.2"):
        plant.step(hf.state_of(plant), hf.SURFACES, 1.0 / 300.0)


def test_a_thrust_sensor_with_play_reads_half_a_width_behind_its_load() -> None:
    """Throttle up and down again on a motor without lag: the reading stays, then follows half a width away."""
    width, ticks = 0.4, 60
    throttle = 0.5 + 0.01 * np.concatenate((np.arange(30.0), np.arange(30.0)[::-1]))
    read = {}
    for effects in ({}, {"thrust_sensor_hysteresis": {"width": width}}):
        plant = hf.plant_with(effects)
        state = hf.state_of(plant)
        read[len(effects)] = np.empty(ticks)
        for k in range(ticks):
            plant.step(state, np.array([hf.DE, hf.DA, hf.DR, throttle[k]]), 0.02)
            read[len(effects)][k] = state.reading[COLUMN["thrust"]]
    load, told = read[0], read[1]
    top = int(np.argmax(load))
    rising = np.flatnonzero(load[:top] > load[0] + 0.5 * width + 1e-9)
    np.testing.assert_allclose(told[rising], load[rising] - 0.5 * width, atol=1e-9)
    falling = top + np.flatnonzero(load[top:] < load[top] - width - 1e-9)
    assert rising.size > 5
    assert falling.size > 5
    np.testing.assert_allclose(told[falling], load[falling] + 0.5 * width, atol=1e-9)
    stuck = top + np.flatnonzero(load[top:] > load[top] - width + 1e-9)
    np.testing.assert_allclose(told[stuck], load[top] - 0.5 * width, atol=1e-9)
