"""A flown flight: published trim and modes, kinematics that hold, times, seeds, take-off and landing."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import curve_fit

from sim_vehicle.errors import PlanError
from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.flight.flight_loop import fly, wind_of
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.flight.tick import Tick
from sim_vehicle.manoeuvres.plan import Plan, plan_of
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import Flight, load_vehicle

VEHICLE = load_vehicle("iitb-mav")
MODEL = read_model("iitb-mav")


def flown(plan: Plan, noise: str = "none", altitude: float = 100.0, seed: int = 1, **options: object) -> FlownFlight:
    vehicle = replace(VEHICLE, flight=Flight(15.0, altitude))
    plant = Plant(vehicle, MODEL)
    suite = SensorSuite(vehicle, noise=noise, generator=np.random.default_rng(seed))
    wind = wind_of(plant, options.pop("wind", (0.0, 0.0, 0.0)))  # type: ignore[arg-type]
    return fly(plant, plan, suite=suite, generator=np.random.default_rng(seed), wind=wind, **options)  # type: ignore[arg-type]


def test_trim_and_pulse_at_sea_level() -> None:
    flight = flown(plan_of(["elevator-pulse"]), altitude=0.0)
    truth = flight.truth
    # An independent computation with these coefficients, 1 kg and 15 m/s: alpha 3.90 deg, elevator 0.086 deg, 3.735 N;
    # a 2 deg pulse takes alpha from 1.3 to 12.1 deg.
    assert np.degrees(truth["alpha"][0]) == pytest.approx(3.90, abs=0.005)
    assert truth["thrust"][0] == pytest.approx(3.735, abs=0.005)
    assert np.degrees(truth["de"][40]) == pytest.approx(0.086, abs=0.03)  # whole microseconds: steps of 0.05 deg
    assert np.degrees(truth["alpha"].min()) == pytest.approx(1.3, abs=0.15)
    assert np.degrees(truth["alpha"].max()) == pytest.approx(12.1, abs=0.15)


def test_short_period_of_the_free_response() -> None:
    flight = flown(plan_of(["elevator-pulse"]).with_settings({"amplitude": 0.00087}), altitude=0.0)
    after = flight.time_s > 2.04
    time, rate = flight.time_s[after] - 2.04, flight.truth["q"][after]

    def mode(t: np.ndarray, a: float, phase: float, f: float, zeta: float) -> np.ndarray:
        omega = 2.0 * np.pi * f
        return a * np.exp(-zeta * omega * t) * np.sin(omega * np.sqrt(1.0 - zeta**2) * t + phase)

    def modes(t: np.ndarray, *both: float) -> np.ndarray:
        return mode(t, *both[:4]) + mode(t, *both[4:])

    start = (-0.02, 0.0, 1.5, 0.2, 0.01, 0.0, 0.12, 0.2)
    (_, _, short, short_damping, _, _, phugoid, phugoid_damping), _ = curve_fit(modes, time, rate, p0=start)
    # The same independent computation, linearised: 1.66 Hz with damping 0.23, 0.146 Hz with 0.25.
    assert (short, short_damping) == (pytest.approx(1.66, abs=0.02), pytest.approx(0.23, abs=0.01))
    assert (phugoid, phugoid_damping) == (pytest.approx(0.146, abs=0.003), pytest.approx(0.25, abs=0.01))


def test_true_motion_obeys_kinematics() -> None:
    flight = flown(plan_of(["multisine"]))
    truth, dt = flight.truth, 0.02
    phi, theta, psi = truth["phi"], truth["theta"], truth["psi"]
    theta_rate = truth["q"] * np.cos(phi) - truth["r"] * np.sin(phi)
    # Newton: the change of velocity over the flight is the specific force turned to earth axes, and gravity.
    down = (
        -np.sin(theta) * truth["ax"]
        + np.sin(phi) * np.cos(theta) * truth["ay"]
        + np.cos(phi) * np.cos(theta) * truth["az"]
        + 9.80665
    )
    north = (
        np.cos(theta) * np.cos(psi) * truth["ax"]
        + (np.sin(phi) * np.sin(theta) * np.cos(psi) - np.cos(phi) * np.sin(psi)) * truth["ay"]
        + (np.cos(phi) * np.sin(theta) * np.cos(psi) + np.sin(phi) * np.sin(psi)) * truth["az"]
    )
    pairs = ((truth["vd"], down), (truth["vn"], north), (theta, theta_rate), (truth["north"], truth["vn"]))
    for value, rate in pairs:
        change = np.cumsum((rate[1:] + rate[:-1]) / 2.0) * dt
        assert np.abs(value[1:] - value[0] - change).max() < 0.02 * np.ptp(value)


def test_lasts_exactly_as_long_as_the_plan() -> None:
    assert flown(plan_of(["elevator-pulse"])).time_s[-1] == pytest.approx(10.0)
    assert flown(plan_of(["elevator-pulse"]), duration=23.0).time_s[-1] == pytest.approx(23.0)
    assert flown(plan_of(["elevator-pulse"]), duration=4.0).time_s.size == 201


def test_wind_triangle() -> None:
    flight = flown(plan_of(["cruise"]), wind=(3.0, -2.0, 0.5))
    truth = flight.truth
    over_ground = np.stack([truth["vn"], truth["ve"], truth["vd"]])
    through_air = over_ground - np.array([[3.0], [-2.0], [0.5]])
    np.testing.assert_allclose(np.linalg.norm(through_air, axis=0), truth["V"], rtol=1e-9)
    assert truth["V"][0] == pytest.approx(15.0)
    assert flight.sensor_errors["wind_east"] == -2.0


def test_measured_is_truth_where_there_is_no_noise() -> None:
    flight = flown(plan_of(["elevator-3211"]))
    for name in ("q", "theta", "rpm", "vn", "phi"):
        times, values = flight.measured[name]
        index = np.round(times / 0.02).astype(int)
        np.testing.assert_allclose(values, flight.truth[name][index], atol=1e-12)
    # The vane on its boom also feels rates: alpha_cg = alpha_m + x q / V - y p / V.
    _, vane = flight.measured["alpha"]
    boom = VEHICLE.sensors.alpha_vane.position
    truth = flight.truth
    moved = vane + boom[0] * truth["q"] / truth["V"] - boom[1] * truth["p"] / truth["V"]
    np.testing.assert_allclose(moved, truth["alpha"], atol=1e-9)


def test_surfaces_fly_the_pulse_widths_sent() -> None:
    flight = flown(plan_of(["multisine"]), noise="table2")
    elevator = VEHICLE.controls["elevator"]
    sent = flight.servos[2]
    np.testing.assert_array_equal(sent, np.round(sent))
    np.testing.assert_allclose(elevator.deflection_from_pwm(sent), flight.command[:, 0], atol=1e-15)
    # The surface seen at a tick is that of the command before it.
    np.testing.assert_allclose(flight.truth["de"][1:], flight.command[:-1, 0], atol=1e-15)


def test_seed_decides_everything() -> None:
    first = flown(plan_of(["cruise"]), noise="table2", seed=9)
    again = flown(plan_of(["cruise"]), noise="table2", seed=9)
    other = flown(plan_of(["cruise"]), noise="table2", seed=10)
    np.testing.assert_array_equal(first.measured["ax"][1], again.measured["ax"][1])
    assert not np.array_equal(first.measured["ax"][1], other.measured["ax"][1])


def test_deceleration_slows_down_at_level_flight() -> None:
    flight = flown(plan_of(["deceleration"]))
    assert flight.truth["V"][-1] == pytest.approx(11.0, abs=0.3)
    assert np.abs(flight.truth["down"] + 100.0).max() < 6.0
    assert flight.truth["alpha"][-1] > flight.truth["alpha"][0] + 0.08


@pytest.mark.whole_flight
def test_a_whole_flight_from_the_ground_to_the_ground() -> None:
    told: list[Tick] = []
    flight = flown(plan_of(["elevator-pulse"]), noise="table2", altitude=40.0, taxi=True, on_tick=told.append)
    armed = np.array([tick.armed for tick in told])
    edges = np.flatnonzero(np.diff(armed.astype(int)))
    assert armed.size == flight.time_s.size
    assert (bool(armed[0]), bool(armed[-1]), edges.size) == (False, False, 2)
    up = np.flatnonzero(flight.airborne)
    assert flight.time_s[up[0]] - flight.time_s[edges[0]] > 3.0
    assert flight.truth["down"].min() < -36.0
    standing = ~flight.airborne
    assert np.abs(flight.truth["down"][standing]).max() < 0.5
    # Speed, attitude and height do not jump at lift-off and touch-down.
    for name, jump in (("V", 0.5), ("theta", 0.03), ("phi", 0.03), ("down", 0.5), ("north", 0.5)):
        assert np.abs(np.diff(flight.truth[name])).max() < jump
    # At rest the accelerometer reads gravity.
    force = np.sqrt(flight.truth["ax"][0] ** 2 + flight.truth["az"][0] ** 2)
    assert force == pytest.approx(9.80665)
    (pulse,) = flight.segments
    assert flight.airborne[round(pulse.start_s / 0.02)]


def test_a_plan_shorter_than_a_tick_is_refused() -> None:
    with pytest.raises(PlanError, match="longer than one tick"):
        flown(plan_of(["cruise"]), duration=0.001)
