"""Mistakes of a single sensor that only the whole motion tells come back as they were put in; else none is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from signal_mistakes import GROUPS, Injection, times
from simulated import fly_mav

from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.errors import SignalError
from sysid.identify import Identification, identify
from sysid.numerics.smoothing import sample_noise
from sysid.signal_check.check import check_signals
from sysid.signals.flight import FlightSignals
from sysid.signals.preparation import prepare
from sysid.signals.resampling import resample

pytestmark = pytest.mark.whole_flight

TRUE = read_model("iitb-mav").values()
VEHICLE = load_vehicle("iitb-mav")


@pytest.fixture(scope="module")
def flight() -> FlightSignals:
    return fly_mav("multisine", 61)[0]


def told(flight: FlightSignals) -> Identification:
    return identify([flight], VEHICLE, method="oe", systematic=False)


def test_a_clean_flight_blames_no_sensor(flight: FlightSignals) -> None:
    assert told(flight).check.findings() == []


def test_the_scale_of_the_lateral_accelerometer_is_told(flight: FlightSignals) -> None:
    (found,) = told(Injection(("ay",), "scale", "", times(("ay",), 0.9)).apply(flight)).check.findings()
    assert (found.signal, found.kind, found.usable) == ("ay", "scale", True)
    assert found.found == pytest.approx(1.0 / 0.9, abs=4.0 * found.std)
    assert found.std < 0.03


def test_a_scale_beyond_use_stops_the_job(flight: FlightSignals) -> None:
    with pytest.raises(SignalError, match=r"ay reads 1\.[23]\d? of true: scale it by 0\.7"):
        told(Injection(("ay",), "scale", "", times(("ay",), 1.3)).apply(flight))


def test_a_late_lateral_accelerometer_is_put_right(flight: FlightSignals) -> None:
    found = told(Injection(("ay",), "delay", "", None, 0.02).apply(flight))
    (late,) = found.check.delays
    assert late.signals == ("ay",)
    assert late.value == pytest.approx(0.02, abs=4.0 * late.std)
    true, read = TRUE["CY_beta"], found.model.coefficients["CY_beta"]
    assert read.value == pytest.approx(true, abs=4.0 * (read.std or 0.0))


def test_airspeed_that_comes_late_is_told_though_little_changes() -> None:
    """A heavier aircraft, whose airspeed hardly answers the surfaces: kinematics do not see 200 ms."""
    craft, model = load_vehicle("ultrastick25e"), read_model("ultrastick25e")
    flight = fly_mav("multisine", 500, vehicle=craft, model=model)[0]
    wrong = Injection(("airspeed",), "delay", "", None, 0.2).apply(flight)
    found = identify([wrong], craft, method="oe", systematic=False).check
    assert [one.signals for one in found.delays] == [("airspeed",)]
    assert found.delays[0].value == pytest.approx(0.2, abs=4.0 * found.delays[0].std)


def test_accelerometers_late_by_parts_of_a_sample_are_told_in_spite_of_gusts_that_they_feign(
    flight: FlightSignals,
) -> None:
    found = told(Injection(GROUPS["accelerometers"], "delay", "", None, 0.005).apply(flight))
    late = {one.signals: one for one in found.check.delays}
    assert late["az",].value == pytest.approx(0.005, abs=5e-4)


def test_gyros_far_too_late_are_not_taken_for_a_vane_of_the_wrong_sign() -> None:
    flight = fly_mav("multisine", 500, duration=10.0)[0]
    wrong = Injection(GROUPS["gyros"], "delay", "", None, 0.2).apply(flight)
    (late,) = check_signals([prepare(wrong, VEHICLE)], VEHICLE).delays
    assert late.signals == GROUPS["gyros"]
    assert late.value == pytest.approx(0.2, abs=1e-3)


def test_physics_that_the_model_lacks_is_blamed_on_no_sensor() -> None:
    flight = fly_mav("multisine", 62, effects=("lift_alpha_elevator:CL_alpha_de=3",))[0]
    assert told(flight).check.findings() == []


def test_lift_that_follows_late_is_no_accelerometer_that_is_early() -> None:
    """The Ultra Stick's CL_alphadot, which the default structure lacks, made az seem 6.9 ± 1.3 ms early here."""
    craft, model = load_vehicle("ultrastick25e"), read_model("ultrastick25e")
    wind = "steady_wind:north=-1,east=1,down=0"
    flight = fly_mav("elevator-3211", 101, effects=(wind,), vehicle=craft, model=model)[0]
    assert identify([flight], craft, method="oe", systematic=False).check.delays == ()


def test_the_time_base_is_that_of_the_stamps_that_most_signals_share(flight: FlightSignals) -> None:
    late = Injection(GROUPS["accelerometers"], "delay", "", None, 0.005).apply(flight)
    data = resample(late)
    assert np.array_equal(data["q"], flight.signals["q"].values)
    signals = {n: replace(s, time_s=s.time_s + 0.005) for n, s in flight.signals.items()}
    assert np.array_equal(resample(FlightSignals("late", signals))["ax"], flight.signals["ax"].values)


def test_noise_is_told_of_interpolated_readings_and_of_motion() -> None:
    noise = np.random.default_rng(5).standard_normal(4000)
    time = 0.02 * np.arange(noise.size)
    for part in (0.0, 0.25, 0.5):
        read = (1.0 - part) * noise[:-1] + part * noise[1:] + 40.0 * np.sin(2.0 * np.pi * 1.5 * time[1:])
        assert sample_noise(read, 0.02) == pytest.approx(np.hypot(1.0 - part, part), rel=0.08)


def test_noise_of_the_thrust_in_a_short_stretch_is_no_mistake_of_another_sensor() -> None:
    """What it does in the seven seconds of a rudder doublet looks like an accelerometer with a wrong scale."""
    wind = ("steady_wind:north=1,east=-1,down=0",)
    found = told(fly_mav("elevator-3211,aileron-doublet,rudder-doublet", 108, effects=wind)[0])
    assert found.check.findings() == []
    for name in ("CY_dr", "Cl_r", "Cn_r"):
        entry = found.model.coefficients[name]
        assert entry.value is not None
        assert entry.std is not None
        assert abs(entry.value - TRUE[name]) < 3.5 * entry.std
