"""Airspeed over a flight that changes its height: one density for each sample."""

from __future__ import annotations

import numpy as np
import pytest

from sim_vehicle.physics.atmosphere import density
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.compatibility.kinematics import body_velocity
from sysid.compatibility.reconstruction import check_compatibility, smoothed_states
from sysid.signals.flight import FlightSignals, Signal
from sysid.signals.preparation import prepare

SPEED, ALPHA, CLIMB, GRAVITY = 20.0, 0.06, 5.0, 9.80665


def climb() -> FlightSignals:
    """A steady climb from 0 to 500 m at 20 m/s of true airspeed, as a pitot of calibrated airspeed shows it."""
    time = 0.02 * np.arange(5001)
    random = np.random.default_rng(9)
    theta = np.arcsin(CLIMB / SPEED) + ALPHA
    rho = np.array([float(density(height)) for height in CLIMB * time])
    constant = {
        "ax": GRAVITY * np.sin(theta), "ay": 0.0, "az": -GRAVITY * np.cos(theta), "p": 0.0, "q": 0.0, "r": 0.0,
        "phi": 0.0, "theta": theta, "psi": 0.0, "alpha": ALPHA, "beta": 0.0, "thrust": 5.0, "throttle": 0.6,
    }  # fmt: skip
    noise = {"ax": 0.08, "ay": 0.08, "az": 0.08, "p": 5e-4, "q": 5e-4, "r": 5e-4, "alpha": 5e-3, "beta": 5e-3}
    columns = {
        name: value + noise.get(name, 5e-4) * random.standard_normal(time.size) for name, value in constant.items()
    }
    columns["airspeed"] = SPEED * np.sqrt(rho / 1.225) + 0.02 * random.standard_normal(time.size)
    columns |= {"air_density": rho, "de": 0.02 * np.sin(time)}
    return FlightSignals("climb", {name: Signal(time, values, "SI", "made") for name, values in columns.items()})


def test_true_airspeed_is_right_at_the_bottom_and_at_the_top_of_500_m() -> None:
    flight = prepare(climb(), load_vehicle("iitb-mav"), 0.0, 100.0)
    found = check_compatibility([flight])
    speed = np.concatenate([states["V"] for states in found.states])
    # One factor for the flight would be 1.2 %, 0.24 m/s, wrong at either end.
    assert speed[:250].mean() == pytest.approx(SPEED, abs=0.03)
    assert speed[-250:].mean() == pytest.approx(SPEED, abs=0.03)
    for stretch in flight.stretches:
        states = smoothed_states(stretch.record, flight.layout, {})
        ideal = body_velocity(np.array([SPEED]), np.array([ALPHA]), np.zeros(1))[0]
        assert np.mean(states["u"]) == pytest.approx(ideal[0], abs=0.03)


def test_flights_at_two_heights_do_not_share_one_density() -> None:
    low, high = (prepare(climb(), load_vehicle("iitb-mav"), start, start + 20.0) for start in (0.0, 80.0))
    found = check_compatibility([low, high])
    for states in found.states:
        assert states["V"].mean() == pytest.approx(SPEED, abs=0.03)
