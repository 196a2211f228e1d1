"""What a flap, a spoiler on one wing and a difference of thrust do, from flights of another engine; and twins."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from jsbsim_flight import Aircraft, fly, measure
from named_controls import EFFECTS, moves, named_aircraft

from sim_vehicle.manoeuvres.plan import Plan
from sim_vehicle.manoeuvres.shapes import manoeuvre
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.vehicle.motors import motor_loads
from sim_vehicle.vehicle.vehicle_file import VEHICLES, Vehicle, vehicle_from_text
from sysid.design.simulated_flight import rehearse
from sysid.errors import SignalError
from sysid.identification.identify import identify
from sysid.signals.flight import FlightSignals, moved_controls

pytestmark = pytest.mark.whole_flight


MOTORS = "".join(
    f"""
[controls.{side}_motor]
servo = {servo}
pwm = [1000, 2000]
deflection = [0.0, 1.0]
[propulsion.{side}_motor]
line = [0.05, {place}, 0.0]
max_thrust = 4.0
tau = 0.1
sense = "{sense}"
"""
    for side, servo, place, sense in (("left", 6, -0.2, "ccw"), ("right", 7, 0.2, "cw"))
)


@cache
def flight(number: int) -> tuple[Aircraft, FlightSignals]:
    aircraft = named_aircraft(number)
    with TemporaryDirectory() as folder:
        flown = fly(Path(folder), aircraft, number + 1, 40.0, named=moves)
    return aircraft, measure(flown, number + 1, f"named-{number}")[0]


@pytest.mark.parametrize("method", ["oe", "fe", "map"])
@pytest.mark.parametrize("number", [41, 42])
def test_every_likelihood_gives_what_they_do_within_its_bars(method: str, number: int) -> None:
    aircraft, signals = flight(number)
    found, truth = identify([signals], aircraft.vehicle, method=method).model.coefficients, aircraft.model.values()
    off = {
        n: (one.value - truth.get(n, 0.0)) / one.std for n, one in found.items() if one.value is not None and one.std
    }
    own = {name for name in off if name.partition("_")[2] in EFFECTS}
    assert own == {f"{axis}_{control}" for axis in ("CL", "CD", "CY", "Cl", "Cm", "Cn") for control in EFFECTS}
    assert max(abs(value) for value in off.values()) < 4.0, off
    assert np.mean([abs(value) < 1.96 for value in off.values()]) >= 0.9, off


def test_equation_error_gives_moments_to_two_percent() -> None:
    aircraft, signals = flight(41)
    found, truth = identify([signals], aircraft.vehicle, method="ee").model.values(), aircraft.model.values()
    for name in ("Cl_left_spoiler", "Cn_thrust_difference"):
        assert found[name] == pytest.approx(truth[name], rel=0.02), name


@pytest.mark.parametrize("method", ["ee", "oe", "map"])
def test_a_flap_that_stands_elsewhere_in_each_flight_is_known_from_both(method: str) -> None:
    aircraft = named_aircraft(44)
    flights = []
    for seed, flap in ((1, 0.0), (2, 0.25)):

        def still(times: np.ndarray, generator: np.random.Generator, flap: float = flap) -> dict[str, np.ndarray]:
            return {**dict.fromkeys(EFFECTS, np.zeros(times.size)), "flap": np.where(times > 0.5, flap, 0.0)}

        with TemporaryDirectory() as folder:
            flown = fly(Path(folder), aircraft, seed, 30.0, named=still)
        signals = measure(flown, seed, f"set-{seed}")[0]
        # What is logged begins after it was set.
        late = {name: replace(one, time_s=one.time_s[100:], values=one.values[100:])
                for name, one in signals.signals.items() if one.time_s.size > 500}  # fmt: skip
        flights.append(replace(signals, signals=late))
    found = identify(flights, aircraft.vehicle, method=method)
    entry, truth = found.model.coefficients["CL_flap"], aircraft.model.values()
    assert entry.value is not None
    assert entry.std is not None
    assert abs(entry.value - truth["CL_flap"]) < 3.0 * entry.std
    assert entry.std < 0.2 * truth["CL_flap"]
    alone = identify(flights[1:], aircraft.vehicle, method=method)
    assert "CL_flap" not in alone.model.coefficients
    assert any(line.startswith("flap stood at 0.25 throughout") for line in alone.warnings)


def test_a_motor_without_its_throttle_is_named() -> None:
    vehicle, _, signals = twin()
    lost = replace(signals, signals={name: one for name, one in signals.signals.items() if name != "right_motor"})
    for method in ("oe", "map"):
        with pytest.raises(SignalError, match="right_motor: the throttle of a motor is missing"):
            identify([lost], vehicle, method=method)


def test_a_control_that_did_not_move_has_no_terms() -> None:
    still, moved = np.full(50, 0.3), np.linspace(0.0, 0.2, 50)
    named = ("flap", "spoiler", "tab")
    assert moved_controls(named, [{"flap": still, "spoiler": moved}]) == ["spoiler"]
    # Set elsewhere in another flight it has moved.
    assert moved_controls(named, [{"flap": still}, {"flap": 0.0 * still}]) == ["flap"]


@cache
def twin() -> tuple[Vehicle, Model, FlightSignals]:
    """A flight with differential thrust: sines on both motors, of other frequencies, beside those of the surfaces."""
    text = (VEHICLES / "iitb-mav.toml").read_text(encoding="utf-8")
    kept, _, rest = text.partition("[propulsion]")
    vehicle = vehicle_from_text(kept + "[" + rest.partition("\n[")[2] + MOTORS, Path("twin.toml"), tables_in=VEHICLES)
    model = read_model("iitb-mav")
    own = {"left_motor": 0.15, "right_motor": 0.15}
    sines = replace(manoeuvre("multisine"), axes=("elevator", "aileron", "rudder", *own), amplitudes=own, duration=24.0)
    plan = Plan((sines, manoeuvre("cruise", duration=4.0), manoeuvre("left_motor-doublet", amplitude=0.2)))
    return vehicle, model, rehearse(vehicle, model, plan, seed=3)[0]


@pytest.mark.parametrize("method", ["oe", "fe", "map"])
@pytest.mark.parametrize("measured", [True, False])
def test_differential_thrust_is_nothing_of_the_air(method: str, measured: bool) -> None:
    vehicle, model, signals = twin()
    if not measured:
        signals = replace(signals, signals={k: v for k, v in signals.signals.items() if k not in ("thrust", "rpm")})
    found = identify([signals], vehicle, method=method).model.coefficients
    truth = model.values()
    off = {
        name: (one.value - truth.get(name, 0.0)) / one.std
        for name, one in found.items()
        if one.value is not None and one.std
    }
    assert {"Cn_beta", "Cn_r", "Cl_p", "Cn_left_motor", "Cn_right_motor"} <= off.keys()
    assert max(abs(value) for value in off.values()) < 4.0, off
    assert np.mean([abs(value) < 1.96 for value in off.values()]) >= 0.9, off


def test_without_their_arms_the_motors_would_be_taken_for_the_fin() -> None:
    """The same flight by a vehicle file that puts both motors in the middle."""
    vehicle, _, signals = twin()
    middle = {name: replace(one, line=(0.05, 0.0, 0.0)) for name, one in vehicle.motors.items()}
    found = identify([signals], replace(vehicle, motors=middle), method="map").model.coefficients
    arm = 4.0 * 0.2 / (0.5 * 1.225 * 15.0**2 * vehicle.geometry.S * vehicle.geometry.b)  # of full throttle, at 15 m/s
    left, right = found["Cn_left_motor"].value, found["Cn_right_motor"].value
    assert left is not None
    assert right is not None
    assert (left, right) == pytest.approx((arm, -arm), rel=0.15)


def test_motors_turn_the_aircraft_by_their_arms_and_torques() -> None:
    vehicle = replace(twin()[0], environment=replace(twin()[0].environment, air_density=1.2))
    throttle = {"left_motor": np.array([0.5, 0.2]), "right_motor": np.array([0.5, 0.7])}
    loads = motor_loads(vehicle, throttle, np.array([14.0, 20.0]), np.array([1.2, 1.0]))
    np.testing.assert_allclose(loads.thrust, [4.0, 3.6])
    pressure = np.array([0.5 * 1.2 * 14.0**2, 0.5 * 1.0 * 20.0**2])
    # To the right of the nose pulls what pushes on the left: N = -y T.
    yaw = (0.2 * 4.0 * np.array([0.0, -0.5])) / (pressure * vehicle.geometry.S * vehicle.geometry.b)
    np.testing.assert_allclose(loads.moments, np.stack((np.zeros(2), np.zeros(2), yaw), axis=1), atol=1e-15)
