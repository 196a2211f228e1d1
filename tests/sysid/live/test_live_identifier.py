"""Coefficients while the simulator flies: its noise and integration step are hidden from the estimator."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from live_flights import half_elevator, pieces
from simulated import fly_mav

from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.live.identifier import LiveIdentifier, LiveReport
from sysid.signals.flight import FlightSignals

pytestmark = pytest.mark.whole_flight

TRUTH = {
    **{"CL_alpha": 2.453, "Cm_alpha": -0.5998, "Cm_de": 1.5894, "CD_k": 0.4, "CL_0": 0.1784, "CD_0": 0.0871},
    **{"Cl_p": -0.45, "Cl_da": 0.15, "Cn_beta": 0.08, "Cn_dr": -0.08, "CY_beta": -0.4},
}
MAIN = ("CL_alpha", "Cm_alpha", "Cm_de", "Cl_p", "Cl_da", "Cn_beta")


@pytest.fixture(scope="module")
def flight() -> FlightSignals:
    return fly_mav("multisine", 5, duration=12.0)[0]


def identified(
    signals: FlightSignals, without: tuple[str, ...] = (), scale: Mapping[str, float] | None = None
) -> LiveReport:
    live = LiveIdentifier(load_vehicle("iitb-mav"))
    report = live.report()
    for samples in pieces(signals, 0.1):
        kept = {name: entry for name, entry in samples.items() if name not in without}
        for name, factor in (scale or {}).items():
            kept[name] = (kept[name][0], factor * kept[name][1])
        live.take(kept)
    report = live.report()
    return report


def test_the_main_derivatives_are_known_after_ten_seconds_of_a_multisine(flight: FlightSignals) -> None:
    report = identified(flight)
    for name, true in TRUTH.items():
        one = report.coefficients[name]
        assert one.known, name
        assert abs(one.value - true) < max(4.0 * one.std, 0.01 * abs(true)), name
    for name in MAIN:
        assert abs(report.coefficients[name].value - TRUTH[name]) < 0.05 * abs(TRUTH[name])
    for name in ("accel_bias_x", "accel_bias_y", "accel_bias_z"):
        assert abs(report.sensors[name].value - 0.1962) < 4.0 * report.sensors[name].std
    assert abs(report.sensors["gyro_bias_q"].value - np.radians(0.25)) < 1e-3
    assert abs(report.sensors["wind_north"].value) < 4.0 * report.sensors["wind_north"].std
    assert report.changes == ()


def test_how_often_a_report_is_asked_for_does_not_matter(flight: FlightSignals) -> None:
    often, seldom = LiveIdentifier(load_vehicle("iitb-mav")), LiveIdentifier(load_vehicle("iitb-mav"))
    for samples in pieces(flight, 0.1):
        often.take(samples)
        often.report()
        seldom.take(samples)
    asked, unasked = often.report(), seldom.report()
    for name in MAIN:
        told = asked.coefficients[name]
        # Without the control derivatives in the equations all along, those of the roll axis were 2 % too small.
        assert abs(told.value - unasked.coefficients[name].value) < 0.3 * told.std, name


def test_what_is_not_known_says_why_and_what_to_fly() -> None:
    still = fly_mav("cruise", 6, duration=4.0)[0]
    report = identified(still, without=("beta",))
    elevator = report.coefficients["Cm_de"]
    assert not elevator.known
    assert elevator.why == "de has hardly moved"
    assert elevator.fly == "elevator-multisine"
    assert report.coefficients["Cn_beta"].why == "there is no sideslip vane (beta)"


def test_of_sensors_that_stand_still_without_any_noise_nothing_is_known() -> None:
    time_s = 0.02 * np.arange(600)
    level = {"az": -9.8, "airspeed": 15.0, "air_density": 1.2, "thrust": 1.0}
    names = ("ax", "ay", "az", "p", "q", "r", "alpha", "beta", "airspeed", "air_density", "phi", "theta", "psi")
    live = LiveIdentifier(load_vehicle("iitb-mav"))
    for part in np.split(np.arange(600), 20):
        commands = ("de", "da", "dr", "thrust", "vn", "ve", "vd")
        live.take({name: (time_s[part], np.full(part.size, level.get(name, 0.01))) for name in (*names, *commands)})
        report = live.report()
    assert not any(one.known for one in report.coefficients.values())
    assert report.coefficients["Cm_de"].why == "de has hardly moved"


def test_an_airspeed_that_reads_low_is_told(flight: FlightSignals) -> None:
    report = identified(flight, scale={"airspeed": 0.92})
    assert any(line.startswith("airspeed reads 8% low") for line in report.warnings), report.warnings
    assert identified(flight).warnings == ()


def test_an_elevator_that_answers_at_half_is_told_with_its_time() -> None:
    signals = half_elevator(fly_mav("multisine", 7, duration=20.0)[0], 14.0)
    live = LiveIdentifier(load_vehicle("iitb-mav"))
    told: list[float] = []
    for samples in pieces(signals, 0.4):
        live.take(samples)
        report = live.report()
        if report.changes and not told:
            told.append(report.time_s)
            change = report.changes[0]
    assert told
    assert 14.0 < told[0] < 17.0
    assert (change.axis, change.coefficient) == ("Cm", "Cm_de")
    assert abs(change.time_s - 14.0) < 0.6
    assert report.sentences()[0].startswith("the elevator: ")
    named = report.changes[0].causes[0]
    assert named.cause.short == "ELEVATOR"
    assert named.size == pytest.approx(50.0, abs=max(3.0 * named.std, 2.0))


def first_known(signals: FlightSignals) -> dict[str, tuple[float, float]]:
    """Value and standard error of each coefficient as it is told for the first time."""
    live, found = LiveIdentifier(load_vehicle("iitb-mav")), dict[str, tuple[float, float]]()
    for count, samples in enumerate(pieces(signals, 0.1), 1):
        live.take(samples)
        if count % 4 == 0:
            for name, one in live.report().coefficients.items():
                if one.known:
                    found.setdefault(name, (one.value, one.std))
    return found


def test_error_bars_hold_from_the_first_ones_on() -> None:
    errors = []
    for seed in range(200, 208):
        told = first_known(fly_mav("multisine", seed, duration=4.0)[0])
        errors += [(value - TRUTH[name]) / std for name, (value, std) in told.items() if name in TRUTH]
    assert len(errors) > 60
    assert np.mean(np.abs(errors) < 1.96) >= 0.9
    assert np.max(np.abs(errors)) < 4.0


def test_of_an_axis_that_only_noise_moves_nothing_is_known() -> None:
    told = first_known(fly_mav("elevator-3211", 1, duration=8.0)[0])
    assert {"CL_alpha", "Cm_alpha", "Cm_de"} <= told.keys()
    assert not {"Cn_beta", "Cl_beta", "Cl_p", "Cl_da", "Cn_r", "CY_beta"} & told.keys()
