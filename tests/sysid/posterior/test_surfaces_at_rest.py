"""Flights whose ailerons or elevator do nothing but what an autopilot holds level with them: some steps of a servo."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from own_bars import own_bar
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identification.identify import identify
from sysid.live.posterior_window import estimate_window
from sysid.posterior.observations import common_grid
from sysid.posterior.residual_spectrum import noise_share
from sysid.signals.record import SURFACES

pytestmark = pytest.mark.whole_flight

VEHICLE = load_vehicle("iitb-mav")
TRUTH = {name: entry.value for name, entry in read_model("iitb-mav").coefficients.items() if entry.value is not None}


@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize("manoeuvres", ["rudder-multisine", "rudder-multisine,elevator-multisine"])
def test_rolling_by_sideslip_is_right_though_the_ailerons_hardly_move(manoeuvres: str, seed: int) -> None:
    flight, flown = fly_mav(manoeuvres, seed)
    assert flown.truth["da"].std() < 0.003
    found = identify([flight], VEHICLE, method="map", systematic=False).model.coefficients
    for name in ("CY_beta", "CY_dr", "Cl_beta", "Cl_r", "Cn_beta", "Cn_r", "Cn_dr"):
        one = found[name]
        assert one.value is not None
        assert one.std is not None
        assert abs(one.value - TRUTH[name]) < 3.5 * own_bar(one), name
        assert own_bar(one) < (0.4 if name.startswith("CY") else 0.2) * abs(TRUTH[name]), name


@pytest.mark.parametrize("seed", [1, 3])
def test_a_window_where_the_elevator_rests_says_nothing_that_its_bars_do_not_hold(seed: int) -> None:
    """The loop that holds the pitch shows in the residuals; the vane's noise is as large as what alpha does."""
    flight, _ = fly_mav("elevator-multisine,rudder-multisine,aileron-multisine", seed)
    columns = {name: (one.time_s, one.values) for name, one in flight.signals.items()}
    for end in (54.0, 64.0, 69.0):
        found = estimate_window(VEHICLE, columns, end - 25.0, end)
        known = {name: one for name, one in found.coefficients.items() if one.known and name in TRUTH}
        assert known
        for name, one in known.items():
            assert abs(one.value - TRUTH[name]) < 4.5 * one.std, (name, end)


@pytest.mark.parametrize("seed", [1, 3])
def test_windows_of_a_rudder_that_begins_to_move_end_at_the_optimum_one_after_another(seed: int) -> None:
    """Where rolling follows sideslip at once is a lesser optimum, and one window's end is the next one's start."""
    flight, _ = fly_mav("elevator-3211,rudder-multisine,aileron-3211", seed)
    columns = {name: (one.time_s, one.values) for name, one in flight.signals.items()}
    near: Mapping[str, Mapping[str, float]] = {}
    for end in (19.0, 20.0, 21.0, 22.0, 24.0):
        found = estimate_window(VEHICLE, columns, 0.0, end, near)
        near = found.ends
        for name in ("Cl_beta", "Cl_r", "Cn_beta", "Cn_r", "Cn_dr"):
            one = found.coefficients[name]
            assert not one.known or abs(one.value - TRUTH[name]) < 3.5 * one.std, (name, end)
    assert all(found.coefficients[name].known for name in ("Cl_beta", "Cl_r", "Cn_r", "Cn_dr"))


def test_noise_of_a_measured_position_is_no_motion_of_its_surface() -> None:
    flight, flown = fly_mav("rudder-multisine", 2)
    generator = np.random.default_rng(7)
    positions = {name: flown.truth[name] + 8e-4 * generator.standard_normal(flown.time_s.size) for name in SURFACES}
    signals = {name: replace(flight.signals[name], values=values) for name, values in positions.items()}
    measured = replace(flight, signals={**flight.signals, **signals})
    controls = {name: replace(one, signal="position") for name, one in VEHICLE.controls.items()}
    found = identify([measured], replace(VEHICLE, controls=controls), method="map", systematic=False).model
    for name in ("Cl_da", "Cn_da"):
        assert found.coefficients[name].value is None
    for name in ("Cn_beta", "Cn_r", "Cn_dr"):
        one = found.coefficients[name]
        assert one.value is None or abs(one.value - TRUTH[name]) < 4.0 * own_bar(one), name


def test_noise_of_a_vane_shows_in_the_upper_end_of_its_spectrum() -> None:
    grid = common_grid(0.0, 60.0, 0.02, [], 0.5)
    generator = np.random.default_rng(1)
    motion = 0.02 * np.sin(2.0 * np.pi * 0.7 * grid.points)
    for std in (0.002, 0.01):
        noise = std * generator.standard_normal(grid.points.size)
        in_band = std**2 * 15.0 / 25.0
        expected = in_band / (in_band + np.mean(motion**2))
        assert noise_share([motion + noise], [grid], 15.0) == pytest.approx(expected, rel=0.15)
