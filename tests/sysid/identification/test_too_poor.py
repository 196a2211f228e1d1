"""A flight too poor for an axis gives no numbers of it, by whatever method: bars would not hold the truth."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from simulated import fly_mav

from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.identification.identify import Identification
from sysid.identification.result_file import result_json
from sysid.identify import identify
from sysid.problem.model_structure import is_longitudinal
from sysid.quality.flight_quality import LATERAL
from sysid.signals.flight import FlightSignals

pytestmark = pytest.mark.whole_flight


def without(signals: FlightSignals, *names: str) -> FlightSignals:
    """The flight without these signals."""
    return replace(signals, signals={name: one for name, one in signals.signals.items() if name not in names})


VEHICLE = load_vehicle("iitb-mav")
SIDESLIP = (
    "sideslip is reconstructed from 10 Hz signals: below 20 Hz its error is larger than the bars can say; log the IMU"
    " at 50 Hz or fit a beta vane"
)
SLOW = "gyros and accelerometers come at 4 Hz; have them sent at 50 Hz or more"


@pytest.fixture(scope="module")
def flight() -> FlightSignals:
    return fly_mav("multisine", 5)[0]


def at(flight: FlightSignals, hz: float) -> FlightSignals:
    """The flight as a link of that rate brings it."""
    signals = {}
    for name, one in flight.signals.items():
        stamps = np.arange(one.time_s[0], one.time_s[-1], 1.0 / hz)
        signals[name] = replace(one, time_s=stamps, values=np.interp(stamps, one.time_s, one.values))
    return replace(flight, signals=signals)


def told(found: Identification, longitudinal: bool) -> list[str]:
    return [name for name in found.model.values() if is_longitudinal(name) == longitudinal]


@pytest.mark.parametrize("method", ["ee", "oe", "fe"])
def test_a_sideslip_from_slow_signals_leaves_the_longitudinal_axes_alone(method: str) -> None:
    flight = fly_mav("elevator-3211,aileron-doublet,rudder-doublet", 3)[0]
    found = identify([at(without(flight, "beta"), 10.0)], VEHICLE, method=method, systematic=False)
    assert told(found, longitudinal=True)
    lateral = [name for name in found.model.coefficients if not is_longitudinal(name)]
    assert {found.model.coefficients[name].to_json()["refused"] for name in lateral} == {SIDESLIP}
    reasons = {one.name: one.reason for one in found.refused}
    assert {reasons[name] for name in lateral} == {SIDESLIP}
    assert found.model.correlation is not None
    assert not set(lateral) & set(found.model.correlation.names)
    assert {found.quality.of_axis(axis) for axis in LATERAL} == {"poor"}
    assert [one.sentence for one in found.quality.reasons if "reconstructed" in one.text] == [f"CY, Cl, Cn: {SIDESLIP}"]
    json.dumps(result_json(found), allow_nan=False)


@pytest.mark.parametrize("method", ["map", "auto"])
def test_a_sideslip_that_is_simulated_needs_no_fast_signals(method: str, flight: FlightSignals) -> None:
    found = identify([at(without(flight, "beta"), 10.0)], VEHICLE, method=method, systematic=False)
    truth = {"Cl_beta": -0.08, "Cl_p": -0.45, "Cl_da": 0.15, "Cn_beta": 0.08, "Cn_r": -0.12, "Cn_dr": -0.08}
    for name, value in truth.items():
        entry = found.model.coefficients[name]
        assert entry.value is not None
        assert entry.std is not None
        assert abs(entry.value - value) < 3.0 * entry.std < 0.2 * abs(value)
    assert "CY, Cl, Cn: no vane of the angle of sideslip: it is simulated; a vane, or calm air and large inputs" in [
        one.sentence for one in found.quality.reasons
    ]


@pytest.mark.parametrize("elevator", ["elevator-doublet", "elevator-3211"])
def test_a_sideslip_that_is_simulated_begins_where_kinematics_have_it(elevator: str) -> None:
    """Without them a motion that rolls at once by sideslip was likelier by 6 in logarithms, Cl_p 28 bars off."""
    flight = fly_mav(f"{elevator},aileron-doublet,rudder-doublet", 2)[0]
    found = identify([at(without(flight, "beta"), 25.0)], VEHICLE, method="map", systematic=False)
    for name, value in {"Cl_beta": -0.08, "Cl_p": -0.45, "Cl_da": 0.15, "Cn_beta": 0.08, "Cn_dr": -0.08}.items():
        entry = found.model.coefficients[name]
        assert entry.value is not None
        assert entry.std is not None
        assert abs(entry.value - value) < 3.0 * entry.std < 0.6 * abs(value)


@pytest.mark.parametrize(("hz", "vane"), [(20.0, False), (25.0, False), (10.0, True)])
def test_faster_signals_or_a_vane_give_the_lateral_numbers(hz: float, vane: bool, flight: FlightSignals) -> None:
    found = identify([at(flight if vane else without(flight, "beta"), hz)], VEHICLE, method="ee", systematic=False)
    assert "Cl_p" in told(found, longitudinal=False)


@pytest.mark.parametrize("method", ["map", "ee"])
def test_a_motion_sampled_too_seldom_gives_no_number_at_all(method: str, flight: FlightSignals) -> None:
    found = identify([at(flight, 4.0)], VEHICLE, method=method, systematic=False)
    assert {entry.refused for entry in found.model.coefficients.values()} == {SLOW}
    assert found.model.correlation is None
    assert found.quality.verdict == "poor"
    assert result_json(found)["model"]["coefficients"]["Cn_beta"] == {"refused": SLOW}


@pytest.mark.parametrize("method", ["map", "ee", "oe", "fe"])
def test_axes_that_nothing_flew_have_no_number(method: str) -> None:
    """The estimators' own rules see to it."""
    found = identify([fly_mav("elevator-3211", 2)[0]], VEHICLE, method=method, systematic=False)
    assert not told(found, longitudinal=False)
    assert told(found, longitudinal=True)


def test_a_law_of_thrust_with_nothing_to_put_into_it_leaves_drag_unknown(flight: FlightSignals) -> None:
    assert VEHICLE.propulsion is not None
    found = identify([without(flight, "thrust", "throttle", "rpm")], VEHICLE, method="map", systematic=False)
    entries = {name: entry for name, entry in found.model.coefficients.items() if name.startswith("CD")}
    assert all("drag needs thrust" in entry.refused for entry in entries.values())
    assert told(found, longitudinal=True)
