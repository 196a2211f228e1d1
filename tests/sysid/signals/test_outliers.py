"""Single readings that no motion makes are left out; what an aircraft or a pilot does is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import fly_mav

from sysid.errors import SignalError
from sysid.signals.flight import FlightSignals, Signal
from sysid.signals.outliers import outliers
from sysid.signals.resampling import is_held, resample

TIMES = np.arange(1000) * 0.02
GENERATOR = np.random.default_rng(1)
MOTION = 0.3 * np.sin(2.0 * np.pi * 1.5 * TIMES) + 0.005 * GENERATOR.standard_normal(TIMES.size)


def test_wild_readings_are_found_and_no_others() -> None:
    values = MOTION.copy()
    places = [0, 137, 500, 501, 999]
    values[places] = [50.0, -8.0, 1e6, 1e6, -3.0]
    assert np.flatnonzero(outliers(values)).tolist() == places


def test_motion_pulses_steps_and_coarse_readings_are_none() -> None:
    pulse = np.where((TIMES > 5.0) & (TIMES < 5.07), 1.0, 0.0)
    coarse = np.round(MOTION / 0.1) * 0.1
    gusty = 3.0 * GENERATOR.standard_t(4.0, TIMES.size)
    for values in (MOTION, pulse + MOTION, coarse, gusty, np.zeros(1000), np.where(TIMES > 9.0, 5.0, 0.0)):
        assert not outliers(values).any()


@pytest.mark.parametrize("manoeuvres", ["elevator-3211", "elevator-doublet,aileron-doublet,rudder-doublet"])
def test_lift_that_breaks_off_in_a_stall_is_no_outlier(manoeuvres: str) -> None:
    """Hard stalls, in which az jumps by 6 m/s^2 for a single sample, and every reading is that of the simulator."""
    flight = fly_mav(manoeuvres, 1, effects=("stall:alpha_stall=0.2",), settings={"amplitude": 0.08})[0]
    assert np.abs(np.diff(flight.signals["az"].values)).max() > 5.0
    sensors = {name: one for name, one in flight.signals.items() if not is_held(name)}
    assert [name for name, one in sensors.items() if outliers(one.values).any()] == []


@pytest.mark.parametrize("hz", [10.0, 12.5, 20.0, 25.0, 30.0])
@pytest.mark.parametrize("elevator", ["elevator-3211", "elevator-doublet"])
def test_an_answer_to_a_doublet_of_a_slow_log_is_no_outlier_and_a_wild_reading_of_it_is(
    hz: float, elevator: str
) -> None:
    """Of a flight that is calm otherwise, every answer is one or two samples long."""
    flight = fly_mav(f"{elevator},aileron-doublet,rudder-doublet", 3)[0]
    slow = {}
    for name, one in flight.signals.items():
        stamps = np.arange(one.time_s[0], one.time_s[-1], 1.0 / hz)
        slow[name] = replace(one, time_s=stamps, values=np.interp(stamps, one.time_s, one.values))
    assert not any("far off" in text for text in resample(replace(flight, signals=slow)).warnings)
    for name, wild in (("q", 40.0), ("az", 400.0), ("airspeed", 60.0), ("vd", 20.0)):
        values = slow[name].values.copy()
        values[100] = wild
        spiked = replace(flight, signals={**slow, name: replace(slow[name], values=values)})
        assert any(text.startswith(f"{name}: 1 reading(s) far off") for text in resample(spiked).warnings), name


def test_a_sensor_that_is_wild_throughout_is_not_made_to_look_well() -> None:
    values = MOTION.copy()
    values[::20] = 1e4
    assert not outliers(values).any()


def test_a_spike_is_bridged_and_told_while_a_command_stays_as_it_was() -> None:
    values = MOTION.copy()
    values[300] = 1e12
    values[600] = 40.0
    signals = {name: Signal(TIMES, values, "rad/s", "made") for name in ("q", "de")}
    found = resample(FlightSignals("spiked", signals))
    assert np.abs(found["q"] - MOTION).max() < 0.05
    assert found["de"][600] == 40.0
    assert any(text.startswith("q: 1 reading(s) far off") for text in found.warnings)
    assert any("beyond 1e+09" in text for text in found.warnings)


def test_stamps_of_a_broken_clock_do_not_fill_the_memory() -> None:
    rng = np.random.default_rng(3)
    stamps = np.sort(rng.uniform(0.0, 9e8, 200))
    signals = {"q": Signal(stamps, rng.standard_normal(200), "rad/s", "made")}
    with pytest.raises(SignalError, match="clock"):
        resample(FlightSignals("clockless", signals))
