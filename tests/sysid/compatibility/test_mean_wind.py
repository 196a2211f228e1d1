"""The wind of a flight against closed forms: a known wind, a misread airspeed and heading, one heading alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import fly_mav

from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.compatibility.wind import mean_wind
from sysid.signals.flight import FlightData
from sysid.signals.preparation import Prepared, prepare

SPEED, STEP, COUNT = 15.0, 0.1, 1200
WIND = np.array([3.0, -2.0, 0.5])


@pytest.fixture(scope="module")
def shell() -> Prepared:
    """A prepared flight whose data the tests replace."""
    return prepare(fly_mav("elevator-3211", 1, duration=10.0)[0], load_vehicle("iitb-mav"))


def flown(shell: Prepared, heading: np.ndarray, reads: float = 1.0, turned: float = 0.0, seed: int = 1) -> Prepared:
    """Level flight along headings, rad. reads: what the airspeed reads of true. turned: error of the heading, rad."""
    alpha = np.full(COUNT, 0.05)
    air = SPEED * np.column_stack((np.cos(heading), np.sin(heading), np.zeros(COUNT)))
    # A gust that stays for some seconds.
    gusts = np.repeat(np.random.default_rng(seed).normal(0.0, 0.5, (COUNT // 20, 3)), 20, axis=0)
    ground = air + WIND + gusts
    columns = {
        **dict(zip(("vn", "ve", "vd"), ground.T, strict=True)),
        "airspeed": np.full(COUNT, reads * SPEED / shell.layout.airspeed_factor),
        "alpha": alpha, "beta": np.zeros(COUNT), "phi": np.zeros(COUNT), "theta": alpha, "psi": heading + turned,
    }  # fmt: skip
    return replace(shell, data=FlightData("a", STEP, STEP * np.arange(COUNT), columns))


def test_a_circle_tells_wind_from_airspeed_and_heading(shell: Prepared) -> None:
    circle = np.linspace(0.0, 4.0 * np.pi, COUNT)
    misses = []
    for seed in range(40):
        found = mean_wind([flown(shell, circle, reads=1.06, turned=0.04, seed=seed)])
        assert list(found) == ["wind_north", "wind_east", "wind_down"]
        misses += [(found[name][0] - true) / found[name][1] for name, true in zip(found, WIND, strict=True)]
        assert max(std for _, std, _ in found.values()) < 0.6
    assert np.max(np.abs(misses)) < 3.0
    assert np.mean(np.abs(misses) < 1.96) > 0.93


def test_one_heading_leaves_the_wind_to_what_is_known_of_airspeed_and_compass(shell: Prepared) -> None:
    north = np.zeros(COUNT)
    sure, misread = (mean_wind([flown(shell, north, reads)]) for reads in (1.0, 1.05))
    for found in (sure, misread):
        value, std, unit = found["wind_north"]
        assert unit == "m/s"
        assert abs(value - WIND[0]) < 2.0 * std
        assert std == pytest.approx(0.05 * SPEED, rel=0.3)  # a scale of 5 % along the flight
        assert found["wind_east"][1] == pytest.approx(0.06 * SPEED, rel=0.3)  # and 0.06 rad across it
    # What was estimated of the airspeed narrows it.
    value, std, _ = mean_wind([flown(shell, north, 1.05)], scale=(0.05, 0.005))["wind_north"]
    assert std < 0.5
    assert abs(value - WIND[0]) < 2.0 * std


def test_without_a_heading_there_is_no_wind(shell: Prepared) -> None:
    flight = flown(shell, np.zeros(COUNT))
    columns = {name: values for name, values in flight.data.columns.items() if name != "psi"}
    assert mean_wind([replace(flight, data=replace(flight.data, columns=columns))]) == {}
