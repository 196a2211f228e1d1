"""Flights without a thrust sensor: thrust from the propeller's speed or the throttle, and what that costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from one_record import make_record
from own_bars import own_bar
from simulated import fly_mav

from gcs.analysis.results import identification_text
from sim_vehicle.model.model_file import read_model
from sim_vehicle.physics.actuation import advance_actuators, start_actuators
from sim_vehicle.physics.layout import ACTUATOR_SIZE
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.propulsion import Polynomial, Propulsion
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.errors import SignalError
from sysid.identification.result_file import result_json
from sysid.identify import Identification, identify
from sysid.signals.flight import FlightData, FlightSignals
from sysid.signals.thrust.source import thrust_source

# The published APC 12 x 6E of the University of Minnesota's Ultra Stick 25e, on the paper's aircraft at 7000 rpm.
CT = Polynomial((0.0604, 0.1089, -0.896, 1.08, -0.4314), (0.0, 0.6))
CQ = Polynomial((0.00354916, 0.00264834, 0.00655718, -0.08441578, 0.08043691), (0.0, 0.6))
MOTOR = Propulsion(line=(0.1, 0.0, 0.01), diameter=0.3048, CT=CT, CQ=CQ, tau=0.1, max_rpm=8500.0)


def aircraft() -> Vehicle:
    """Without torque, so that the ailerons rest and the longitudinal motion alone is estimated."""
    return replace(load_vehicle("iitb-mav"), propulsion=replace(MOTOR, CQ=()))


def without(signals: FlightSignals, *names: str) -> FlightSignals:
    return FlightSignals(signals.name, {key: one for key, one in signals.signals.items() if key not in names})


@pytest.fixture(scope="module")
def flown() -> FlightSignals:
    signals, _ = fly_mav("elevator-3211", 11, vehicle=aircraft(), duration=10.0)
    return signals


def judge(found: Identification, allowed: float = 4.0) -> None:
    """Every longitudinal coefficient within so many standard errors of what the simulator flew, and not refused."""
    true = read_model("iitb-mav").values()
    for name in ("CL_0", "CL_alpha", "CL_de", "CD_0", "CD_k", "Cm_0", "Cm_alpha", "Cm_de"):
        entry = found.model.coefficients[name]
        assert entry.value is not None, f"{name}: {entry.refused}"
        assert entry.std is not None
        assert abs(entry.value - true[name]) < allowed * own_bar(entry), f"{name}: {entry.value} for {true[name]}"


@pytest.mark.parametrize("signal", ["rpm", "throttle"])
def test_the_coefficients_are_recovered_without_a_thrust_sensor(flown: FlightSignals, signal: str) -> None:
    missing = ("thrust",) if signal == "rpm" else ("thrust", "rpm")
    found = identify([without(flown, *missing)], aircraft(), method="oe", systematic=signal == "throttle")
    judge(found)
    result = result_json(found)
    source = f"from {signal} by CT(J)"
    assert list(result["thrust"].values()) == [source]
    assert f"thrust: {source}" in identification_text(result).splitlines()
    assert any(source in warning and "thrust_5pct" in warning for warning in result["warnings"])
    if signal == "rpm":
        return
    # Told 1 % more thrust, the whole estimation moves by a fifth of what the column says of 5 %.
    stronger = replace(MOTOR, CT=Polynomial(tuple(1.01 * c for c in CT.coefficients), CT.range), CQ=())
    other = identify(
        [without(flown, *missing)], replace(aircraft(), propulsion=stronger), method="oe", systematic=False
    ).model.values()
    for name in ("CL_0", "CD_0", "CD_k", "Cm_0"):
        column = result["model"]["coefficients"][name]["systematic"]["thrust_5pct"]
        assert other[name] - found.model.values()[name] == pytest.approx(0.2 * column, rel=0.15), name


def test_measured_thrust_needs_no_such_column(flown: FlightSignals) -> None:
    result = result_json(identify([flown], aircraft()))
    assert list(result["thrust"].values()) == ["measured"]
    columns = [entry["systematic"] for entry in result["model"]["coefficients"].values() if "systematic" in entry]
    assert columns
    assert not any("thrust_5pct" in column for column in columns)


@pytest.mark.parametrize("method", ["ee", "oe", "fe"])
def test_the_methods_of_the_books_need_thrust_and_say_so_in_one_line(method: str, flown: FlightSignals) -> None:
    with pytest.raises(SignalError, match="neither a thrust signal nor rpm nor a throttle") as caught:
        identify([without(flown, "thrust", "rpm", "throttle")], aircraft(), method=method)
    assert "\n" not in str(caught.value)
    bare = replace(load_vehicle("iitb-mav"), propulsion=None)
    with pytest.raises(SignalError, match="the vehicle file no law for it"):
        identify([without(flown, "thrust")], bare, method=method)


def flight(**columns: float) -> FlightData:
    time = 0.02 * np.arange(300)
    values = {name: np.full(300, value) for name, value in columns.items()} | {"de": 0.01 * np.sin(time)}
    return FlightData("f", 0.02, time, values)


@pytest.mark.parametrize(
    ("signals", "motor", "told"),
    [
        ({"thrust": 3.0, "rpm": 6000.0, "throttle": 0.5}, MOTOR, "measured"),
        ({"rpm": 6000.0, "throttle": 0.5}, MOTOR, "from rpm by CT(J)"),
        ({"throttle": 0.5}, MOTOR, "from throttle by CT(J)"),
        ({"rpm": 6000.0}, replace(MOTOR, max_rpm=None), "from rpm by CT(J)"),
        ({"throttle": 0.5}, replace(MOTOR, max_rpm=None, max_thrust=8.0), "from throttle by max_thrust"),
        ({"rpm": 6000.0}, Propulsion(max_thrust=8.0, max_rpm=9000.0), "from rpm by max_thrust (rpm / max_rpm)^2"),
        ({"rpm": 6000.0, "throttle": 0.5}, Propulsion(max_thrust=8.0), "from throttle by max_thrust"),
    ],
)
def test_measured_comes_before_rpm_and_rpm_before_throttle(
    signals: dict[str, float], motor: Propulsion, told: str
) -> None:
    plane = replace(load_vehicle("iitb-mav"), propulsion=motor)
    assert str(thrust_source(flight(**signals), plane)) == told


def test_thrust_by_the_square_of_the_speed() -> None:
    plane = replace(load_vehicle("iitb-mav"), propulsion=Propulsion(max_thrust=8.0, max_rpm=9000.0))
    record = make_record(flight(rpm=4500.0), plane, 50, 250)
    np.testing.assert_allclose(record.thrust, 2.0, rtol=1e-12)


def test_the_counters_noise_is_told_of_thrust_and_throttle_alike() -> None:
    """A constant speed read 232 times: its mean is known to sigma / sqrt(232), and T = c n^2, so dT / T = 2 dn / n."""
    motor = Propulsion(max_thrust=8.0, max_rpm=9000.0, diameter=0.23, CQ=CQ, tau=0.1)
    plane = replace(load_vehicle("iitb-mav"), propulsion=motor)
    steady = flight(rpm=4500.0)
    noise = 20.0 * np.random.default_rng(3).standard_normal(300)
    noisy = FlightData("f", 0.02, steady.time_s, {**steady.columns, "rpm": steady["rpm"] + noise})
    record = make_record(noisy, plane, 60, 262)
    assert record.rho.size == 232
    assert record.thrust_doubt.shape == record.rotor_doubt.shape == (1, 232)
    doubt = 20.0 / np.sqrt(232) / 4500.0
    np.testing.assert_allclose(np.abs(record.thrust_doubt), 2.0 * doubt * 2.0, rtol=0.15)
    np.testing.assert_allclose(np.abs(record.rotor_doubt), doubt * 0.5, rtol=0.15)
    # Of a constant the mean alone passes the smoothing, so that the filter's state is as large.
    assert record.thrust_noise.sigma == pytest.approx(2.0 * doubt * 2.0, rel=0.15)
    # One error of the counter moves both.
    np.testing.assert_allclose(record.thrust_doubt / record.thrust, 2.0 * record.rotor_doubt / record.commands[:, 3])


@pytest.mark.parametrize("tau", [0.0, 0.05, 0.3])
def test_the_simulated_propeller_turns_as_it_was_measured(tau: float) -> None:
    """The commands of the record, passed through the simulator's motor lag, give the measured speeds again."""
    plane = replace(load_vehicle("iitb-mav"), propulsion=replace(MOTOR, tau=tau))
    time = 0.02 * np.arange(300)
    rpm = 6000.0 + 800.0 * np.sin(2.0 * time) + 300.0 * np.cos(5.0 * time)
    data = FlightData("f", 0.02, time, {"rpm": rpm, "de": 0.01 * np.sin(time)})
    record = make_record(data, plane, 50, 250)
    flat = flatten(plane, read_model("iitb-mav"))
    actuators, mean, end = np.zeros(ACTUATOR_SIZE), np.zeros(4), np.zeros(4)
    start_actuators(record.commands[0], actuators)
    turned = []
    for k in range(record.commands.shape[0] - 1):
        for half in range(2):
            advance_actuators(
                record.commands, k, 0.01 * half, 0.01, 0.02, flat.P, flat.E, actuators, mean, end
            )  # fmt: skip
        turned.append(end[3] * 8500.0)
    first = 50 - record.start
    np.testing.assert_allclose(turned[5:], rpm[first + 6 : 250], rtol=1e-3)
