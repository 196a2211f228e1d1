"""Channels as ordinary logs have them: slower than the gyros, with samples missing, dead. None of them ends a job."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from own_bars import own_bar
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.errors import SysidError
from sysid.identification.repaired_flight import attitude_rate
from sysid.identification.result_file import result_json
from sysid.identify import Identification, identify
from sysid.signals.flight import FlightSignals, Signal

pytestmark = pytest.mark.whole_flight

VEHICLE = load_vehicle("iitb-mav")
TRUE = read_model("iitb-mav").values()


@pytest.fixture(scope="module")
def flight() -> FlightSignals:
    return fly_mav("multisine", 5)[0]


def changed(flight: FlightSignals, **signals: Signal) -> FlightSignals:
    return replace(flight, signals={**flight.signals, **signals})


def worst(found: Identification) -> float:
    """Largest error in standard errors of what is reported."""
    entries = found.model.coefficients.items()
    return max(abs(e.value - TRUE[n]) / own_bar(e) for n, e in entries if e.value is not None and e.std and n in TRUE)


@pytest.mark.parametrize("name", ["theta", "airspeed", "az", "q"])
def test_ten_hertz_on_the_stamps_of_the_gyros(name: str, flight: FlightSignals) -> None:
    one = flight.signals[name]
    slow = replace(one, time_s=one.time_s[::5], values=one.values[::5])
    found = identify([changed(flight, **{name: slow})], VEHICLE, systematic=False)
    assert not [one.name for one in found.refused if one.name in TRUE]
    assert worst(found) < 4.0


@pytest.mark.parametrize("gone", ["not there", "not a number"])
def test_two_samples_of_an_attitude_missing(gone: str, flight: FlightSignals) -> None:
    one = flight.signals["theta"]
    if gone == "not there":
        keep = np.ones(one.time_s.size, dtype=bool)
        keep[400:402] = False
        theta = replace(one, time_s=one.time_s[keep], values=one.values[keep])
    else:
        values = one.values.copy()
        values[400:402] = np.nan
        theta = replace(one, values=values)
    found = identify([changed(flight, theta=theta)], VEHICLE, systematic=False)
    assert worst(found) < 4.0


@pytest.mark.parametrize(("name", "lost"), [("ay", {"CY"}), ("az", set()), ("ax", {"CD"})])
def test_a_dead_accelerometer_is_done_without(name: str, lost: set[str], flight: FlightSignals) -> None:
    dead = replace(flight.signals[name], values=np.zeros_like(flight.signals[name].values))
    found = identify([changed(flight, **{name: dead})], VEHICLE, systematic=False)
    assert result_json(found)["method"] == "map"
    assert worst(found) < 4.0
    assert any(f"no change of {name}: it is done without" in warning for warning in found.warnings)
    assert {one.name[:2] for one in found.refused if one.name in TRUE} <= lost


@pytest.mark.parametrize(("name", "change"), [("q", "dead"), ("p", "not there"), ("r", "not a number")])
def test_the_attitude_stands_for_a_gyro_that_is_lost(name: str, change: str, flight: FlightSignals) -> None:
    signals, one = dict(flight.signals), flight.signals[name]
    if change == "not there":
        del signals[name]
    else:
        signals[name] = replace(one, values=np.full_like(one.values, 0.0 if change == "dead" else np.nan))
    found = identify([replace(flight, signals=signals)], VEHICLE, systematic=False)
    assert worst(found) < 4.0
    assert any(f"{name}: the attitude's rate of change is taken in its place" in warning for warning in found.warnings)
    assert not [one.name for one in found.refused if one.name in TRUE]


@pytest.mark.parametrize("lost", [("ax", "ay", "az"), ("p", "q", "r")])
def test_no_accelerometer_or_no_gyro_at_all_leaves_an_answer_that_holds(
    lost: tuple[str, ...], flight: FlightSignals
) -> None:
    left = {name: one for name, one in flight.signals.items() if name not in lost}
    found = identify([replace(flight, signals=left)], VEHICLE, systematic=False)
    assert worst(found) < 4.5
    assert sum(entry.value is not None for entry in found.model.coefficients.values()) > 14
    assert found.quality.verdict == "care"
    assert any("done without" in reason.text for reason in found.quality.reasons)


def test_rates_of_an_attitude_are_those_of_the_body_in_a_turn_that_climbs(flight: FlightSignals) -> None:
    time_s = np.arange(0.0, 10.0, 0.02)
    angles = {
        "phi": 0.5 + 0.1 * np.sin(time_s),
        "theta": 0.2 + 0.05 * time_s / 10.0,
        "psi": (0.4 * time_s) % (2 * np.pi),
    }
    turning = changed(flight, **{n: Signal(time_s, one, "rad", "ATTITUDE") for n, one in angles.items()})
    dpsi, dtheta = 0.4, 0.005
    for name, true in {
        "p": lambda t: 0.1 * np.cos(t) - dpsi * np.sin(0.2 + dtheta * t),
        "q": lambda t: (
            dtheta * np.cos(0.5 + 0.1 * np.sin(t)) + dpsi * np.cos(0.2 + dtheta * t) * np.sin(0.5 + 0.1 * np.sin(t))
        ),
        "r": lambda t: (
            dpsi * np.cos(0.2 + dtheta * t) * np.cos(0.5 + 0.1 * np.sin(t)) - dtheta * np.sin(0.5 + 0.1 * np.sin(t))
        ),
    }.items():
        rate = attitude_rate(turning, name)
        assert rate is not None
        assert rate.values == pytest.approx(true(rate.time_s), abs=1e-4)
    assert attitude_rate(replace(flight, signals={"psi": flight.signals["psi"]}), "q") is None


@pytest.mark.parametrize(("surface", "axes"), [("da", ("CY", "Cl", "Cn")), ("de", ("CL", "CD", "Cm"))])
def test_a_surface_whose_channel_is_dead_is_named_and_spoils_its_own_axes_alone(
    surface: str, axes: tuple[str, ...], flight: FlightSignals
) -> None:
    dead = replace(flight.signals[surface], values=np.zeros_like(flight.signals[surface].values))
    found = identify([changed(flight, **{surface: dead})], VEHICLE, method="map", systematic=False)
    entries = found.model.coefficients.items()
    assert all((entry.value is None) == name.startswith(axes) for name, entry in entries)
    assert worst(found) < 4.0
    assert any(f"{surface}: repeats one value" in warning for warning in found.warnings)


def test_a_thrust_sensor_that_is_dead_while_the_throttle_moves_is_left_out(flight: FlightSignals) -> None:
    moving = fly_mav("multisine,throttle-step", 5)[0]
    thrust = moving.signals["thrust"]
    dead = changed(moving, thrust=replace(thrust, values=np.full_like(thrust.values, 1.5)))
    found = result_json(identify([dead], VEHICLE, systematic=False))
    assert list(found["thrust"].values()) == ["from rpm by max_thrust (rpm / max_rpm)^2"]
    assert any("the sensor is dead; it is left out" in warning for warning in found["warnings"])


@pytest.mark.parametrize("method", ["ee", "oe"])
def test_the_methods_of_the_books_read_signals_as_meant_too(flight: FlightSignals, method: str) -> None:
    ay = flight.signals["ay"]
    reversed_ay = changed(flight, ay=replace(ay, values=-ay.values))
    found = identify([reversed_ay], VEHICLE, method=method, systematic=False)
    assert [(one.signal, one.kind) for one in found.mistakes] == [("ay", "sign")]
    assert any("ay has the wrong sign" in line for line in found.warnings)
    kept = identify([reversed_ay], VEHICLE, method=method, systematic=False, as_recorded=["ay"])
    assert kept.mistakes == ()


def test_a_method_that_needs_every_sample_names_the_one_that_does_not(flight: FlightSignals) -> None:
    speed = flight.signals["airspeed"]
    slow = changed(flight, airspeed=replace(speed, time_s=speed.time_s[::5], values=speed.values[::5]))
    with pytest.raises(SysidError, match=r"no airborne part .*; --method map does without"):
        identify([slow], VEHICLE, method="oe", systematic=False)
