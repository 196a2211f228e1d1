"""Thrust by the battery's power: held against propellers of a wind tunnel and of published models, and against flights
whose motor, propeller and battery are others than the estimator's.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from electric_drive import TABLES, Drive, with_battery
from simulated import fly_mav

from sim_vehicle.errors import VehicleFileError
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.propulsion import Propulsion
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.errors import SignalError
from sysid.identification.result_file import result_json
from sysid.identify import identify
from sysid.signals.flight import FlightSignals, Signal
from sysid.signals.thrust.electric import BY_BATTERY, PrintedPropeller, with_electric_thrust

INCH = 0.0254
FLOWN = read_model("iitb-mav").with_coefficient("CL_q", 3.0).with_coefficient("Cm_q", -6.0)


def printed(vehicle: Vehicle, drive: Drive, **more: float) -> Vehicle:
    """The vehicle with no more known of its propeller than its print."""
    assert vehicle.propulsion is not None
    known = Propulsion(line=vehicle.propulsion.line, diameter=drive.diameter, pitch=4.7 * INCH, tau=0.1, **more)
    return replace(vehicle, propulsion=known)


def flown(manoeuvres: str, seed: int, drive: Drive, rate_hz: float = 5.0) -> tuple[FlightSignals, np.ndarray]:
    signals, flight = fly_mav(manoeuvres, seed, model=FLOWN, max_step=0.005)
    truth = flight.truth
    given = {"time_s": flight.time_s, "thrust": truth["thrust"], "airspeed": truth["V"], "rho": truth["rho"]}
    thrust = np.column_stack((flight.time_s, truth["thrust"]))
    return with_battery(signals, drive, given, rate_hz, seed), thrust


@pytest.mark.parametrize("name", TABLES)
def test_a_propeller_of_the_wind_tunnel_gives_what_its_print_says(name: str) -> None:
    diameter, rows = TABLES[name]
    J, CT, CP = np.array(rows[1:]).T
    rho, turns = np.full(J.size, 1.1), 95.0
    airspeed = J * turns * diameter
    thrust, power = CT * rho * turns**2 * diameter**4, CP * rho * turns**3 * diameter**5
    found = PrintedPropeller(diameter, 4.7 * INCH).thrust(power, airspeed, rho)
    np.testing.assert_allclose(found, thrust, rtol=0.12)


def test_published_propellers_of_other_pitch_are_within_the_doubt() -> None:
    """University of Minnesota's 12 x 6 and Beard & McLain's Aerosonde, CT and CQ from their publications."""
    J = np.linspace(0.15, 0.4, 6)
    thin = (0.0604 + 0.1089 * J - 0.896 * J**2 + 1.08 * J**3 - 0.4314 * J**4,
            0.003549155 + 0.002648338 * J + 0.006557184 * J**2 - 0.084415782 * J**3 + 0.080436908 * J**4)  # fmt: skip
    large = 0.09357 - 0.06044 * J - 0.1079 * J**2, 0.00523 + 0.00497 * J - 0.01664 * J**2
    for diameter, pitch, (CT, CQ) in ((12 * INCH, 6 * INCH, thin), (20 * INCH, 16 * INCH, large)):
        rho, turns = np.full(J.size, 1.225), 80.0
        thrust, power = CT * rho * turns**2 * diameter**4, 2.0 * np.pi * CQ * rho * turns**3 * diameter**5
        airspeed = J * turns * diameter
        propeller = PrintedPropeller(diameter, pitch)
        found = propeller.thrust(power, airspeed, rho)
        # Two standard deviations of what the law and the blades' drag may be wrong by.
        by_blades = found - replace(propeller, blades=1.3 * propeller.blades).thrust(power, airspeed, rho)
        assert np.all(np.abs(found - thrust) < 2.0 * np.hypot(0.08 * found, by_blades))
        np.testing.assert_allclose(found, thrust, rtol=0.25)


def test_power_and_thrust_are_each_other_s_inverse_and_too_little_power_gives_none() -> None:
    propeller = PrintedPropeller(0.25, 0.13)
    thrust, airspeed = np.array([0.2, 1.0, 3.0, 8.0, 1.0]), np.array([12.0, 12.0, 20.0, 5.0, 0.0])
    rho = np.full(5, 1.0)
    np.testing.assert_allclose(
        propeller.thrust(propeller.power(thrust, airspeed, rho), airspeed, rho), thrust, rtol=1e-6
    )
    nothing = propeller.thrust(np.array([0.0, -5.0, 0.5]), np.full(3, 15.0), np.full(3, 1.2))
    np.testing.assert_array_equal(nothing, 0.0)


def test_between_readings_thrust_follows_the_throttle() -> None:
    drive = Drive()
    signals, truth = flown("throttle-step", 3, drive, rate_hz=2.0)
    vehicle = printed(load_vehicle("iitb-mav"), drive)
    found = with_electric_thrust(signals, vehicle).signals[BY_BATTERY]
    wanted = np.interp(found.time_s, *truth.T)
    assert float(np.ptp(wanted)) > 1.0
    gain = float(found.values @ wanted / (wanted @ wanted))
    assert 0.8 < gain < 1.2
    # A step is half a second late at most where the battery is read twice a second: here it is sharp.
    assert float(np.sqrt(np.mean((found.values / gain - wanted) ** 2))) < 0.06 * float(np.max(wanted))


@pytest.mark.parametrize(
    ("method", "propeller", "seed"), [("auto", "10x4.7", 411), ("oe", "11x4.7", 412), ("ee", "10x4.7", 413)]
)
def test_drag_is_known_without_a_thrust_sensor(method: str, propeller: str, seed: int) -> None:
    drive = Drive(propeller, kv=92.0, resistance=0.08, controller=0.92)
    signals, _ = flown("multisine,throttle-step", seed, drive)
    result = result_json(identify([signals], printed(load_vehicle("iitb-mav"), drive), method=method))
    entries, truth = result["model"]["coefficients"], FLOWN.values()
    told = {name: entry for name, entry in entries.items() if entry.get("value") is not None}
    assert {"CD_0", "CD_k"} <= told.keys()
    for name, entry in told.items():
        assert abs(entry["value"] - truth.get(name, 0.0)) < 3.0 * entry["std"], name
    assert any("thrust from battery power by diameter and pitch, not measured" in line for line in result["warnings"])


def test_a_gain_of_the_thrust_is_found_where_flight_shows_it() -> None:
    drive = Drive(kv=110.0, resistance=0.05)
    signals, truth = flown("multisine,throttle-step", 421, drive)
    vehicle = printed(load_vehicle("iitb-mav"), drive)
    taken = with_electric_thrust(signals, vehicle).signals[BY_BATTERY]
    wanted = np.interp(taken.time_s, *truth.T)
    gain = float(np.sum(taken.values * wanted) / np.sum(taken.values**2))
    (found,) = (
        one
        for one in result_json(identify([signals], vehicle, method="map"))["nuisances"]
        if one["name"] == "thrust_error"
    )
    assert found["std"] < 0.09  # 0.13 before
    assert abs(1.0 - found["value"] - gain) < 3.0 * found["std"]


def test_a_low_voltage_weakens_what_the_throttle_gives() -> None:
    time_s = np.arange(0.0, 10.0, 0.02)
    throttle = Signal(time_s, np.full(time_s.size, 0.8), "1", "SERVO_OUTPUT_RAW")
    voltage = Signal(np.arange(0.0, 10.0, 0.5), np.full(20, 9.9), "V", "SYS_STATUS")
    signals = FlightSignals("low", {"throttle": throttle, "battery_voltage": voltage})
    craft = load_vehicle("iitb-mav")
    by_thrust = replace(craft, propulsion=Propulsion(max_thrust=8.0, voltage=11.0))
    by_speed = replace(
        craft, propulsion=Propulsion(CT=((0.0, 0.1), (0.7, 0.0)), diameter=0.25, max_rpm=9000.0, voltage=11.0)
    )
    for vehicle, wanted in ((by_thrust, 0.8 * 0.81), (by_speed, 0.8 * 0.9), (craft, 0.8)):
        np.testing.assert_allclose(with_electric_thrust(signals, vehicle).signals["throttle"].values, wanted)


def test_without_the_battery_or_its_print_thrust_is_asked_for(tmp_path: object) -> None:
    drive = Drive()
    signals, _ = flown("multisine", 3, drive)
    bare = replace(signals, signals={name: one for name, one in signals.signals.items() if name != "battery_current"})
    with pytest.raises(SignalError, match="diameter and pitch, where the battery's voltage and current are logged"):
        identify([bare], printed(load_vehicle("iitb-mav"), drive), method="oe")


@pytest.mark.parametrize(("keys", "words"), [
    ("pitch = 0.12", "diameter.*is missing; pitch needs it"),
    ("diameter = 0.25\npitch = 0.12\nefficiency = 76", "share of the battery's power"),
    ("diameter = 0.25", "diameter and pitch for thrust by the battery's voltage and current"),
])  # fmt: skip
def test_a_vehicle_file_that_cannot_be_meant_is_refused(keys: str, words: str, tmp_path) -> None:
    from sim_vehicle.vehicle.vehicle_file import VEHICLES

    text = (VEHICLES / "iitb-mav.toml").read_text(encoding="utf-8")
    begin = text.index("[propulsion]")
    end = text.index("\n[", begin + 1)
    path = tmp_path / "mine.toml"
    path.write_text(f"{text[:begin]}[propulsion]\n{keys}\n{text[end:]}", encoding="utf-8")
    with pytest.raises(VehicleFileError, match=words):
        load_vehicle(str(path))
