"""The thrust sensor's noise within the one-step estimate: hidden errors of thrust are found, and bars count them."""

from dataclasses import replace

import numpy as np
import pytest
from flight_bounds import GPS, LATERAL_OUTPUTS, LONGITUDINAL_OUTPUTS, Experiment, bounds, calm_information, slopes
from simulated import fly_mav, signals_of

from sim_vehicle.fly import fly
from sim_vehicle.manoeuvres import manoeuvre
from sim_vehicle.model import read_model
from sim_vehicle.plan import Plan
from sim_vehicle.plant import Plant
from sim_vehicle.sensors import SensorSuite
from sim_vehicle.vehicle import load_vehicle
from sysid.estimate import fit, free_coefficients
from sysid.inputnoise import with_thrust_by_airspeed, with_thrust_noise
from sysid.posing import make_problem
from sysid.prepare import check_compatibility, prepare

SENSORS = ("accel_bias_x", "accel_bias_z", "gyro_bias_q", "alpha_scale")


@pytest.fixture(scope="module")
def case():
    """A flight of three pulses with the throttle working between them: problem, model, names, result, flight."""
    vehicle, model = load_vehicle("iitb-mav"), read_model("iitb-mav")
    pulse = replace(manoeuvre("elevator-pulse"), duration=4.0)
    generator = np.random.default_rng(11)
    plan = Plan(tuple(replace(pulse, amplitude=sign * pulse.amplitude) for sign in (1.0, -1.0, 1.0)))
    suite = SensorSuite(vehicle, generator=generator)
    flown = fly(Plant(vehicle, model, max_step=0.0021), plan, suite=suite, generator=generator)
    prepared = [prepare(signals_of(flown, vehicle, "pulses"), vehicle)]
    problem = make_problem(prepared, vehicle, check_compatibility(prepared), SENSORS)
    names = free_coefficients(list(model.coefficients), problem.motion)
    return problem, model, names, fit(problem, model, names), flown


def test_an_error_hidden_in_the_thrust_is_found(case):
    problem, model, names, result, flown = case
    (record,) = problem.records
    _, plain = with_thrust_noise(problem, model, names, (), result)
    push = 2.0 * record.thrust_doubt.sum(axis=0)
    pushed = replace(problem, records=(replace(record, thrust=record.thrust + push),))
    exact = fit(pushed, model, names)
    again, found = with_thrust_noise(pushed, model, names, (), exact)
    spread = {name: result.std_white(name) for name in ("CL_alpha", "CL_de")}
    fooled = {name: abs(exact.value(name) - result.value(name)) / spread[name] for name in spread}
    left = {name: abs(found.value(name) - plain.value(name)) / spread[name] for name in spread}
    assert all(moved > 1.0 for moved in fooled.values()), fooled
    assert all(left[name] < 0.35 * fooled[name] for name in spread), (fooled, left)
    bias = record.moving_mass * flown.sensor_errors["accel_bias_x"]
    true = flown.truth["thrust"] + bias

    def moved_about_its_mean(thrust):
        return np.std(thrust - true)

    assert moved_about_its_mean(again.records[0].thrust) < 0.5 * moved_about_its_mean(pushed.records[0].thrust)


def test_standard_errors_are_those_of_the_bound_with_thrust_unknown(case):
    problem, model, names, result, flown = case
    _, found = with_thrust_noise(problem, model, names, (), result)
    told = slopes(Experiment(flown, problem.vehicle, model, LONGITUDINAL_OUTPUTS, False))
    limit = bounds(told.names, calm_information(told), [*names, *SENSORS])
    for name in names:
        # The bound knows the noise, which the estimate finds to 2 % per output.
        assert found.std_white(name) == pytest.approx(limit[name], rel=0.05), name
    assert found.std("Cm_0") > 1.1 * result.std("Cm_0")


def test_thrust_that_is_no_measurement_adds_nothing(case):
    problem, model, names, result, _ = case
    exact = replace(problem, records=tuple(replace(r, thrust_doubt=np.zeros((0, 0))) for r in problem.records))
    assert with_thrust_noise(exact, model, names, (), result) == (exact, result)


def test_thrust_that_falls_with_airspeed_costs_what_the_bound_says():
    """The Ultra Stick's propeller pulls 0.27 N less per m/s, and the measured airspeed has 0.02 m/s of noise."""
    vehicle, model = load_vehicle("ultrastick25e"), read_model("ultrastick25e")
    signals, flown = fly_mav("multisine", 23, vehicle=vehicle, model=model)
    prepared = [prepare(signals, vehicle)]
    problem = make_problem(prepared, vehicle, check_compatibility(prepared), ground=True)
    names = free_coefficients(list(model.coefficients), problem.motion)
    first = fit(problem, model, names)
    again, second = with_thrust_by_airspeed(problem, model, names, (), first)
    corrected, found = with_thrust_noise(again, model, names, (), second)

    def error(some):
        return float(np.std(some.records[0].thrust - flown.truth["thrust"]))

    assert error(problem) > 4e-3
    # True airspeed, where the sensor tells a calibrated one that is 0.1 m/s less.
    assert np.std(again.records[0].airspeed - flown.truth["V"]) < 0.01
    assert abs(np.mean(again.records[0].airspeed - flown.truth["V"])) < 0.03
    slope = np.polyfit(flown.truth["V"] - again.records[0].law.about, flown.truth["thrust"], 2)[1]
    assert again.records[0].law.slope == pytest.approx(slope, rel=0.03)
    assert error(again) < 2.5e-3
    assert error(corrected) < 2.5e-3
    told = slopes(Experiment(flown, vehicle, model, (*LONGITUDINAL_OUTPUTS, *LATERAL_OUTPUTS, *GPS), True))
    limit = bounds(told.names, calm_information(told), [*names, *problem.sensors])
    for name in ("CD_0", "CD_CL", "CD_k", "CL_q", "Cm_q"):
        assert found.std_white(name) == pytest.approx(limit[name], rel=0.05), name
        assert abs(found.value(name) - model.values()[name]) < 4.0 * limit[name], name
