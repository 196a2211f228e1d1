"""A thrust of zero throughout is believed of a glider alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identify import identify
from sysid.signal_check.dead_thrust import without_dead_thrust
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import prepare

VEHICLE = load_vehicle("iitb-mav")
TRUTH = read_model("iitb-mav").values()


def zero(flight: FlightSignals, name: str, *gone: str) -> FlightSignals:
    """A flight with a column of zeros, and without some others."""
    one = flight.signals[name]
    kept = {key: each for key, each in flight.signals.items() if key not in gone}
    return replace(flight, signals={**kept, name: replace(one, values=np.zeros_like(one.values))})


@pytest.fixture(scope="module")
def powered() -> FlightSignals:
    return fly_mav("multisine", 91, duration=30.0)[0]


@pytest.fixture(scope="module")
def glide(powered: FlightSignals) -> FlightSignals:
    """The same motion through the air without thrust: it goes down with the air that carries it."""
    thrust, ax, airspeed = (powered.signals[name] for name in ("thrust", "ax", "airspeed"))
    force = np.interp(ax.time_s, thrust.time_s, thrust.values) / VEHICLE.mass.mass
    speed = np.interp(ax.time_s, airspeed.time_s, airspeed.values)
    lost = np.cumsum(force / 9.80665 * speed * np.gradient(ax.time_s))
    changed = {"ax": replace(ax, values=ax.values - force)}
    for name in ("altitude", "gps_altitude"):
        one = powered.signals[name]
        changed[name] = replace(one, values=one.values - np.interp(one.time_s, ax.time_s, lost))
    return replace(powered, signals={**powered.signals, **changed})


@pytest.mark.parametrize("name", ["throttle", "thrust"])
def test_a_column_that_was_never_filled_gives_no_drag(powered: FlightSignals, name: str) -> None:
    others = {"throttle", "thrust", "rpm"} - {name}
    found = identify([zero(powered, name, *others)], VEHICLE)
    reasons = {one.name: one.reason for one in found.refused}
    assert "drag needs thrust" in reasons["CD_0"]
    assert "drag needs thrust" in reasons["CD_k"]
    assert any(line.startswith(f"{name} is 0 throughout") for line in found.warnings)
    for coefficient in ("CL_alpha", "Cm_alpha", "Cm_de", "Cl_p"):
        one = found.model.coefficients[coefficient]
        assert one.value is not None
        assert one.std is not None
        assert abs(one.value - TRUTH[coefficient]) < 3.0 * one.std


def test_the_next_source_stands_for_a_dead_one(powered: FlightSignals) -> None:
    found = identify([zero(zero(powered, "thrust"), "throttle")], VEHICLE, method="ee")
    drag = found.model.coefficients["CD_0"]
    assert drag.value == pytest.approx(TRUTH["CD_0"], rel=0.1)


def test_a_glider_has_no_thrust(glide: FlightSignals) -> None:
    flight = zero(glide, "thrust", "throttle", "rpm")
    assert without_dead_thrust(flight, prepare(flight, VEHICLE)) is flight


def test_a_glider_in_rising_air_has_none_either(glide: FlightSignals) -> None:
    flight = zero(glide, "thrust", "throttle", "rpm")
    level = {name: replace(one, values=np.full_like(one.values, 100.0)) for name, one in flight.signals.items()
             if name in ("altitude", "gps_altitude")}  # fmt: skip
    flight = replace(flight, signals={**flight.signals, **level})
    assert without_dead_thrust(flight, prepare(flight, VEHICLE)) is flight


def test_without_a_height_nothing_is_said(powered: FlightSignals) -> None:
    flight = zero(powered, "thrust", "altitude", "gps_altitude", "vd", "throttle", "rpm")
    assert without_dead_thrust(flight, prepare(flight, VEHICLE)) is flight
