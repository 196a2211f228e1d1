"""What is imposed on the simulation: airspeed behind a lagging pitot, flow angles behind swinging vanes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from simulated import fly_mav
from table_two import with_table_two

from sim_vehicle.flight.wind import dryden_gusts
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.posterior.flight_part import make_part, with_vane
from sysid.posterior.smoothing import airspeed_through, expected, noise_beside_walk, smoothed
from sysid.signals.flight import FlightSignals, Signal

TIME = np.arange(0.0, 40.0, 0.002)
PRIOR = (0.05, 0.05)


def speeds() -> tuple[np.ndarray, np.ndarray]:
    """Airspeed that changes by a few m/s as in manoeuvres, and its rate."""
    V, rate = 17.0 + 0.0 * TIME, 0.0 * TIME
    for hz, size in ((0.11, 1.2), (0.4, 0.5), (1.1, 0.12)):
        V = V + size * np.sin(2.0 * np.pi * hz * TIME + 5.0 * hz)
        rate = rate + 2.0 * np.pi * hz * size * np.cos(2.0 * np.pi * hz * TIME + 5.0 * hz)
    return V, rate


@pytest.mark.parametrize("lag", [0.0, 0.04, 0.12])
def test_the_lag_of_a_pitot_is_told_by_the_accelerometers(lag: float) -> None:
    V, rate = speeds()
    g = np.random.default_rng(1)
    read = V if lag == 0.0 else signal.lfilter(*lagging(lag), V - 17.0) + 17.0
    grid = np.arange(0.0, 39.9, 0.01)
    stamps = TIME[::10]
    noisy = read[::10] + 0.03 * g.standard_normal(stamps.size)
    along = np.interp(grid, TIME, rate) + 0.05 * g.standard_normal(grid.size)
    found = airspeed_through(stamps, noisy, grid, along, PRIOR)
    assert abs(found.lag - lag) < 0.005  # half a step of the grid
    assert np.std((found.values - np.interp(grid, TIME, V))[200:]) < 0.02


@pytest.mark.parametrize("lag", [0.0, 0.08])
def test_behind_a_lag_that_the_vehicle_file_knows_is_the_airspeed_itself(lag: float) -> None:
    V, rate = speeds()
    read = V if lag == 0.0 else signal.lfilter(*lagging(lag), V - 17.0) + 17.0
    grid = np.arange(0.0, 39.9, 0.01)
    found = airspeed_through(TIME[::10], read[::10], grid, np.interp(grid, TIME, rate), (lag, 0.0))
    assert (found.lag, found.lag_std) == (lag, 0.0)
    # A reading taken for a step of the grid later than it is would be wrong by a fiftieth of this motion.
    assert np.std((found.values - np.interp(grid, TIME, V))[200:-100]) < 0.002 * np.std(V)


def test_a_calibrated_airspeed_follows_the_density_as_the_aircraft_climbs() -> None:
    signals, flown = fly_mav("elevator-multisine", 5, noise="none")
    plane = with_table_two(load_vehicle("iitb-mav"))
    part = make_part(signals, plane, 0.0, float(flown.time_s[-1]))
    true = np.interp(part.grid, flown.time_s, flown.truth["V"])
    assert np.std((part.airspeed.values - true)[100:-100]) < 0.003


def lagging(lag: float) -> tuple[np.ndarray, np.ndarray]:
    """A first-order lag on the grid of TIME."""
    left = math.exp(-(TIME[1] - TIME[0]) / lag)
    return np.array([1.0 - left]), np.array([1.0, -left])


def test_a_flow_angle_is_what_it_was_before_its_vane_swung() -> None:
    plane = load_vehicle("ultrastick25e")
    plane = replace(
        plane, sensors=replace(plane.sensors, alpha_vane=replace(plane.sensors.alpha_vane, position=(0, 0, 0)))
    )
    alpha = 0.06 + 0.03 * np.sin(2.0 * np.pi * 0.9 * TIME) + 0.01 * np.sin(2.0 * np.pi * 2.1 * TIME)
    omega, damping, scale, clock = 2.0 * np.pi * 4.0, 0.6, 1.08, 0.012
    vane = signal.lsim(([omega**2], [1.0, 2.0 * damping * omega, omega**2]), alpha - 0.06, TIME)[1]
    read = scale * (0.06 + vane)
    still = {
        "phi": 0.0,
        "theta": 0.06,
        "p": 0.0,
        "q": 0.0,
        "r": 0.0,
        "ax": 0.6,
        "ay": 0.0,
        "az": -9.8,
        "airspeed": 17.0,
    }
    g = np.random.default_rng(2)
    signals = {
        name: Signal(TIME[::10], value + 1e-4 * g.standard_normal(TIME[::10].size), "", "HIGHRES_IMU.x")
        for name, value in still.items()
    }
    signals["alpha"] = Signal(TIME[::10] + clock, read[::10], "rad", "AOA_SSA.aoa")
    part = make_part(FlightSignals("made", signals), plane, 0.0, 40.0)
    values = {
        "vane_clock": clock, "vane_period": 0.25, "vane_log_damping": math.log(damping),
        "alpha_scale": scale,
    }  # fmt: skip
    inside = slice(200, -200)
    truth = np.interp(part.grid, TIME, alpha)[inside]
    before = part.motion["alpha"][inside] - truth
    after = with_vane(part, "alpha", plane.sensors, values).motion["alpha"][inside] - truth
    assert np.std(before) > 0.008
    assert np.std(after) < 0.001


def test_derivatives_by_a_noisy_vane_are_right_by_what_it_is_expected_to_stand_for() -> None:
    g = np.random.default_rng(8)
    stamps, grid = np.arange(0.0, 60.0, 0.02), np.arange(0.0, 59.98, 0.01)
    flow = signal.lfilter([1.0 - 0.95], [1.0, -0.95], g.standard_normal(stamps.size))
    flow *= 0.004 / flow.std()
    read = flow + 0.005 * g.standard_normal(stamps.size)
    force = -0.4 * np.interp(grid, stamps, flow)
    slopes = []
    for told in (smoothed(stamps, read, grid, 0.1), expected(stamps, read, grid)):
        off = told - told.mean()
        slopes.append(float(off @ force / (off @ off)))
    assert slopes[0] > -0.36  # attenuated by the noise that the window leaves
    assert slopes[1] == pytest.approx(-0.4, rel=0.05)
    # A vane without noise is left as it is, fast gusts and all, and where samples are lost it goes on as a line.
    clean = 0.05 * np.sin(2.0 * np.pi * 6.0 * stamps)
    inside = (grid > 1.0) & (grid < 59.0)
    at_grid = 0.05 * np.sin(2.0 * np.pi * 6.0 * grid)
    np.testing.assert_allclose(expected(stamps, clean, grid)[inside], at_grid[inside], atol=2e-3)
    kept = (stamps < 30.0) | (stamps > 30.6)
    assert np.abs(expected(stamps[kept], clean[kept], grid)).max() < 0.06
    # One that is dead reads what it reads, and of a few samples a curve goes through their middle.
    np.testing.assert_array_equal(expected(stamps, 0.0 * stamps, grid), 0.0 * grid)
    few = expected(stamps[:12], 3.0 + stamps[:12] ** 2, grid[:22])
    np.testing.assert_allclose(few, 3.0 + grid[:22] ** 2, atol=1e-3)


@pytest.mark.parametrize(("gusts", "noise"), [(1.0, 0.3), (0.3, 0.3), (0.0, 0.3), (2.0, 0.6)])
def test_noise_of_a_vane_is_found_beside_gusts(gusts: float, noise: float) -> None:
    settings = {"sigma": gusts, "length": 20.0, "airspeed": 15.0, "generator": np.random.default_rng(5)}
    vertical = dryden_gusts(1500, 0.02, **settings)[:, 2] / 15.0
    read = vertical + math.radians(noise) * np.random.default_rng(6).standard_normal(1500)
    assert noise_beside_walk(read) == pytest.approx(math.radians(noise), rel=0.15)


def test_a_vane_that_swings_only_at_the_end_of_a_part_is_not_smoothed_away() -> None:
    stamps, grid = np.arange(0.0, 25.0, 0.02), np.arange(0.0, 24.96, 0.01)
    swings = np.where(stamps > 19.0, 0.1 * np.sin(2.0 * np.pi * 1.5 * stamps), 0.0)
    read = swings + 0.005 * np.random.default_rng(4).standard_normal(stamps.size)
    inside = (grid > 20.0) & (grid < 24.5)
    truth = np.interp(grid, stamps, swings)[inside]
    said = expected(stamps, read, grid)[inside]
    assert float(said @ truth / (truth @ truth)) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("length_s", [2.0, 3.0, 3.7, 5.0])
def test_what_a_short_series_stands_for_is_no_more_than_it_reads(length_s: float) -> None:
    stamps, grid = np.arange(0.0, length_s, 0.02), np.arange(0.0, length_s - 0.02, 0.01)
    for seed in range(60):
        read = 0.05 + 0.005 * np.random.default_rng(seed).standard_normal(stamps.size)
        assert np.abs(expected(stamps, read, grid) - 0.05).max() < 0.02


def wandering(stamps: np.ndarray) -> np.ndarray:
    """An angle of flow in a short period and slow turns, rad."""
    return np.asarray(0.05 * np.sin(2.0 * np.pi * 1.3 * stamps) + 0.02 * np.sin(2.0 * np.pi * 0.2 * stamps + 1.0))


@pytest.mark.parametrize(("share", "apart"), [(0.05, 3e-4), (0.05, 2e-5), (0.002, 1e-5)])
def test_samples_that_come_almost_at_once_are_one(share: float, apart: float) -> None:
    g = np.random.default_rng(7)
    stamps = np.arange(0.0, 20.0, 0.02)
    twice = g.choice(stamps.size, max(int(share * stamps.size), 1), replace=False)
    stamps = np.sort(np.concatenate((stamps, stamps[twice] + apart)))
    read = wandering(stamps) + 0.003 * g.standard_normal(stamps.size)
    grid = np.arange(0.0, 19.9, 0.01)
    said, truth = expected(stamps, read, grid), wandering(grid)
    assert np.std(said - truth) < 0.002
    assert np.polyfit(truth, said, 1)[0] == pytest.approx(1.0, abs=0.02)


def test_bursts_of_a_bus_are_as_often_as_they_bring_something_new() -> None:
    g = np.random.default_rng(8)
    stamps = np.sort(np.concatenate([np.arange(0.0, 600.0, 0.08) + 2e-5 * i for i in range(4)]))
    read = wandering(stamps) + 0.003 * g.standard_normal(stamps.size)
    grid = np.arange(0.0, 599.9, 0.01)
    assert np.std(expected(stamps, read, grid) - wandering(grid)) < 0.004


def test_a_vane_that_is_read_seldom_keeps_its_motion() -> None:
    """Above a quarter of its band a vane of 5 Hz has the short period, which is no noise."""
    grid = np.arange(0.0, 19.9, 0.01)
    for seed in range(4):
        g = np.random.default_rng(seed)
        stamps = np.arange(0.0, 20.0, 0.2)
        read = wandering(stamps) + 0.003 * g.standard_normal(stamps.size)
        windows = smoothed(stamps, read, grid, 2.6 * 0.2)
        assert np.std(expected(stamps, read, grid) - wandering(grid)) < 1.01 * np.std(windows - wandering(grid))
