"""The thrust sensor's noise within the one-step estimate: hidden errors of thrust are found, and bars count them."""

from dataclasses import replace

import numpy as np
import pytest
from flight_bounds import GPS, LATERAL_OUTPUTS, LONGITUDINAL_OUTPUTS, Experiment, bounds, calm_information, slopes
from simulated import fly_mav, signals_of

from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.manoeuvres.plan import Plan
from sim_vehicle.manoeuvres.shapes import manoeuvre
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.compatibility.reconstruction import check_compatibility
from sysid.output_error.from_problem import fit
from sysid.output_error.linearisation import OutputErrorLinearisation
from sysid.problem.estimation_problem import free_coefficients
from sysid.problem.formulation import make_problem
from sysid.signals.preparation import prepare
from sysid.uncertainty.thrust_noise import with_input_noise, with_thrust_by_airspeed

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
    _, plain = with_input_noise(OutputErrorLinearisation(problem, model, names, (), result))
    push = 2.0 * record.thrust_doubt.sum(axis=0)
    pushed = replace(problem, records=(replace(record, thrust=record.thrust + push),))
    exact = fit(pushed, model, names)
    again, found = with_input_noise(OutputErrorLinearisation(pushed, model, names, (), exact))
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
    _, found = with_input_noise(OutputErrorLinearisation(problem, model, names, (), result))
    told = slopes(Experiment(flown, problem.vehicle, model, LONGITUDINAL_OUTPUTS, False))
    limit = bounds(told.names, calm_information(told), [*names, *SENSORS])
    for name in names:
        # The bound knows the noise, which the estimate finds to 2 % per output.
        assert found.std_white(name) == pytest.approx(limit[name], rel=0.05), name
    assert found.std("Cm_0") > 1.1 * result.std("Cm_0")


def test_thrust_that_is_no_measurement_adds_nothing(case):
    problem, model, names, result, _ = case
    exact = replace(problem, records=tuple(replace(r, thrust_doubt=np.zeros((0, 0))) for r in problem.records))
    assert with_input_noise(OutputErrorLinearisation(exact, model, names, (), result)) == (exact, result)


@pytest.fixture(scope="module")
def stick():
    """A flight of the Ultra Stick, whose propeller's torque rolls it: problem, model, names, estimates, flight, bound.

    Its propeller pulls 0.27 N less per m/s; measured airspeed has 0.02 m/s of noise, the counter 10 per minute.
    """
    vehicle, model = load_vehicle("ultrastick25e"), read_model("ultrastick25e")
    signals, flown = fly_mav("multisine", 23, vehicle=vehicle, model=model)
    prepared = [prepare(signals, vehicle)]
    problem = make_problem(prepared, vehicle, check_compatibility(prepared), ground=True)
    names = free_coefficients(list(model.coefficients), problem.motion)
    first = fit(problem, model, names)
    again, second = with_thrust_by_airspeed(problem, model, names, (), first)
    told = slopes(Experiment(flown, vehicle, model, (*LONGITUDINAL_OUTPUTS, *LATERAL_OUTPUTS, *GPS), True))
    return problem, model, names, again, second, flown, told


def test_thrust_that_falls_with_airspeed_costs_what_the_bound_says(stick):
    problem, model, names, again, second, flown, told = stick
    corrected, found = with_input_noise(OutputErrorLinearisation(again, model, names, (), second))

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
    # Its own noise is told as well: less, by what the measured airspeed's was.
    assert 0.0 < again.records[0].thrust_noise.sigma < problem.records[0].thrust_noise.sigma
    limit = bounds(told.names, calm_information(told), [*names, *problem.sensors])
    for name in ("CD_0", "CD_CL", "CD_k", "CL_q", "Cm_q"):
        assert found.std_white(name) == pytest.approx(limit[name], rel=0.05), name
        assert abs(found.value(name) - model.values()[name]) < 4.0 * limit[name], name


def test_noise_of_the_propellers_speed_costs_what_the_bound_says(stick):
    problem, model, names, again, second, _, told = stick
    _, found = with_input_noise(OutputErrorLinearisation(again, model, names, (), second))
    information = calm_information(told)
    limit = bounds(told.names, information, [*names, *problem.sensors])
    exact = [i for i, name in enumerate(told.names) if not name.startswith("rotor ")]
    without = bounds([told.names[i] for i in exact], information[np.ix_(exact, exact)], [*names, *problem.sensors])
    assert limit["Cn_dr"] > 1.15 * without["Cn_dr"]
    assert second.std_white("Cn_dr") < 1.05 * without["Cn_dr"]
    for name in ("Cn_dr", "Cl_da", "Cn_beta", "Cl_p", "Cn_da"):
        assert found.std_white(name) == pytest.approx(limit[name], rel=0.05), name
        assert abs(found.value(name) - model.values()[name]) < 4.0 * limit[name], name


def test_an_error_hidden_in_the_propellers_speed_is_found(stick):
    """One part in 2000 of its speed, which the estimate is told to be known to one in 700: only its torque tells it."""
    _, model, names, again, _, _, _ = stick
    (record,) = again.records
    doubted = replace(record, rotor_doubt=np.full((1, record.rho.size), 1.5e-3 * record.commands[:, 3].mean()))
    commands = record.commands.copy()
    commands[:, 3] *= 1.0005
    estimates = {}
    for case, throttle in (("as flown", record.commands), ("faster", commands)):
        problem = replace(again, records=(replace(doubted, commands=throttle),))
        exact = fit(problem, model, names)
        corrected, found = with_input_noise(OutputErrorLinearisation(problem, model, names, (), exact))
        estimates[case] = exact, found, corrected.records[0].commands[:, 3]
    moved = {n: abs(estimates["faster"][0].value(n) - estimates["as flown"][0].value(n)) for n in ("Cn_dr", "Cl_da")}
    left = {n: abs(estimates["faster"][1].value(n) - estimates["as flown"][1].value(n)) for n in moved}
    spread = {n: estimates["as flown"][0].std_white(n) for n in moved}
    assert all(moved[n] > 1.5 * spread[n] for n in moved), moved
    assert all(left[n] < 0.2 * moved[n] for n in moved), (moved, left)
    taken_off = np.mean(commands[:, 3] - record.commands[:, 3])
    assert np.mean(estimates["faster"][2] - estimates["as flown"][2]) < 0.2 * taken_off
