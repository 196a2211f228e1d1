"""The bounds and figures that the identification campaign judges by."""

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from dryden import dryden_spectrum
from flight_bounds import (
    GPS,
    LATERAL_OUTPUTS,
    LONGITUDINAL_OUTPUTS,
    STATES,
    Experiment,
    Slopes,
    bounds,
    calm_information,
    simulated,
    slopes,
    true_model,
    true_states,
)
from gust_bounds import gust_information, gust_model, linear_path

from sim_vehicle.effects import parse_effect
from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.flight.wind import dryden_gusts
from sim_vehicle.manoeuvres.plan import Plan
from sim_vehicle.manoeuvres.shapes import manoeuvre
from sim_vehicle.model.model_file import read_model
from sim_vehicle.physics.layout import CHANNELS
from sim_vehicle.vehicle.packed_model import flatten
from sysid.problem.model_structure import default_structure

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "campaign"))

import paper_tables
from tables import rows_of, verdict

SIGMA, LENGTH = 0.3, 20.0
SHORT = Plan((replace(manoeuvre("multisine"), duration=1.0, start=0.0, length=1.0, low=0.9, high=8.0),))


def flight(seed, plan, vehicle, model, noise="table2"):
    generator = np.random.default_rng(seed)
    plant = Plant(vehicle, model, max_step=0.0021)
    return fly(plant, plan, suite=SensorSuite(vehicle, noise=noise, generator=generator), generator=generator)


@pytest.fixture(scope="module")
def short():
    """A flight of 1 s with all surfaces moving."""
    vehicle, model = paper_tables.paper_vehicle(True), read_model("iitb-mav")
    flown = flight(3, SHORT, vehicle, model)
    structure = default_structure(("de", "da", "dr"))
    return Experiment(
        flown, vehicle, true_model(model, structure), (*LONGITUDINAL_OUTPUTS, *LATERAL_OUTPUTS, *GPS), True
    )


def test_calm_bound_is_that_of_the_paper_tables():
    vehicle, full = paper_tables.paper_vehicle(True), read_model("iitb-mav")
    _, flown = paper_tables.fly_experiment(vehicle, full, 5, thrust_noise=True)
    other = paper_tables.cramer_rao(flown, vehicle, full, thrust_noise=True)
    model = true_model(full, paper_tables.COEFFICIENTS)
    told = slopes(Experiment(flown, vehicle, model, LONGITUDINAL_OUTPUTS, False))
    names = [*paper_tables.SENSORS, *paper_tables.COEFFICIENTS]
    found = bounds(told.names, calm_information(told), names)
    # Here the steps of gyros and accelerometers count as noise (1 %), and how thrust follows the throttle is unknown.
    ratio = np.array([found[name] for name in names]) / other
    assert ratio.min() > 0.995
    assert ratio.max() < 1.06


def test_gust_filters_have_drydens_spectrum():
    gusts, dt, speed = gust_model(SIGMA, LENGTH, 15.0, 0.02), 0.02, 15.0
    frequency = np.array([0.2, 1.0, 5.0, 20.0])
    shaper = np.linalg.cholesky(gusts.Q)
    for i, expected in enumerate(dryden_spectrum(frequency, SIGMA, LENGTH, speed).T):
        shift = np.exp(1j * frequency[i] * dt) * np.eye(5) - gusts.F
        answer = gusts.H @ np.linalg.solve(shift, shaper)
        assert np.sum(np.abs(answer) ** 2, axis=1) * dt / np.pi == pytest.approx(expected, rel=0.03)


def test_gust_bound_is_that_of_the_dense_covariance(short):
    """The filter's information against S' (R + G G')^-1 S, G being whole simulations with one gust each."""
    told, gusts = slopes(short), gust_model(SIGMA, LENGTH, short.vehicle.flight.airspeed, 0.02)
    found = gust_information(told, linear_path(short), gusts)
    count = short.flown.time_s.size
    answers = gust_answers(short, count)
    # Covariance of the gusts of all steps, calm before the first.
    shaper, step = np.linalg.cholesky(gusts.Q), np.zeros((5, 5 * count))
    rows = []
    for k in range(count):
        rows.append(gusts.H @ step)
        step = gusts.F @ step
        step[:, 5 * k : 5 * k + 5] += shaper
    G = answers @ np.concatenate(rows)
    used = np.isfinite(told.sigma).ravel()
    covariance = (G @ G.T)[np.ix_(used, used)] + np.diag(told.sigma.ravel()[used] ** 2)
    S = told.values.reshape(-1, len(told.names))[used]
    dense = told.prior + S.T @ np.linalg.solve(covariance, S)
    unknown = [*short.coefficients, "accel_bias_x", "gyro_bias_q", "alpha_scale"]
    from_filter, from_dense = (bounds(told.names, one, unknown) for one in (found, dense))
    calm = bounds(told.names, calm_information(told), unknown)
    for name in unknown:
        assert from_filter[name] == pytest.approx(from_dense[name], rel=0.02), name
    assert np.median([from_filter[name] / calm[name] for name in unknown]) > 1.5


def test_steps_with_lagging_servos_follow_whole_simulations():
    """What begins differently goes on by the steps' matrices as by another simulation's whole flight.

    Where it does not, the filter sees innovations in what coefficients and starts can imitate, and the bound of what
    those leave (airspeed's scale factor in turbulence) is several times too small.
    """
    vehicle, model = paper_tables.paper_vehicle(True), read_model("iitb-mav")
    model = model.with_effect(*parse_effect("actuator_lag:tau=0.05"))
    plan = Plan((replace(manoeuvre("multisine"), duration=6.0, start=0.0, length=6.0, low=0.4, high=8.0),))
    experiment = Experiment(
        flight(4, plan, vehicle, model, noise="none"), vehicle, model, (*LONGITUDINAL_OUTPUTS, *LATERAL_OUTPUTS), True
    )
    told, path = slopes(experiment), linear_path(experiment)
    starts = [told.names.index(f"start {name}") for name in ("u", "w", "p", "theta")]
    whole = told.values[:, :, starts]
    state = np.eye(9)[:, [STATES.index(name) for name in ("u", "w", "p", "theta")]]
    steps = np.zeros_like(whole)
    for k in range(len(whole)):
        steps[k] = path.C[k] @ state
        state = path.A[k] @ state
    assert np.all(np.linalg.norm(steps - whole, axis=0) < 0.01 * np.linalg.norm(whole, axis=0))


def fly_again(experiment, gusts):
    """Readings (N, outputs) of the commands flown once more from trim, gusts (N, 3) being those at the samples."""
    plant = Plant(experiment.vehicle, experiment.model, max_step=0.01)
    columns = [CHANNELS.index(name) for name in experiment.outputs]
    state, still, out = plant.trim().state, np.zeros(3), np.zeros((len(gusts), len(columns)))
    plant.evaluate(state, still, gusts[0], 0.0)
    out[0] = plant.read(state)[columns]
    for k, (begin, end) in enumerate(pairwise(gusts)):
        plant.step(state, experiment.flown.command[k], 0.02, still, 0.5 * (begin + end), end)
        out[k + 1] = plant.read(state)[columns]
    return out


def gust_answers(experiment, count):
    """Outputs' answer to 1 m/s of gust at every single sample, (N * outputs, 3 N), by flying the plant again."""
    answers = np.zeros((count * len(experiment.outputs), 3 * count))
    for place in range(3 * count):
        gusts = 1e-3 * np.eye(3 * count)[place].reshape(count, 3)
        answers[:, place] = (fly_again(experiment, gusts) - fly_again(experiment, -gusts)).ravel() / 2e-3
    return answers


def test_flight_in_gusts_is_what_the_bounds_take_it_for(short):
    """Flown in turbulence by the simulator's own loop, against the same commands with and without the gusts it met."""
    rough = short.model.with_effect(*parse_effect(f"turbulence:sigma=0.05:length={LENGTH}"))
    flown = flight(5, SHORT, short.vehicle, rough, noise="none")
    again = replace(short, flown=flown, outputs=(*LONGITUDINAL_OUTPUTS, *LATERAL_OUTPUTS))
    seen = np.stack([flown.measured[name][1] for name in again.outputs], axis=1)
    calm, gusty = (fly_again(again, gusts) for gusts in (np.zeros_like(flown.gust_body), flown.gust_body))
    # What is left of the gusts' effect is that of the integration's step.
    assert np.all(np.std(seen - gusty, axis=0) < 0.01 * np.std(seen - calm, axis=0))
    # The sensitivities are taken along that flight: from its own gusts, by another simulation.
    flat, path = flatten(again.vehicle, again.model), true_states(flown)
    simulation = simulated(again, flat, path, flat.C, path[0], flown.truth["thrust"], flown.command)
    assert np.all(np.std(seen - simulation, axis=0) < 0.01 * np.std(seen - calm, axis=0))


def test_gusts_that_are_flown_have_the_spectrum_of_the_bound():
    gusts = gust_model(SIGMA, LENGTH, 15.0, 0.02)
    flown = dryden_gusts(400_000, 0.02, sigma=SIGMA, length=LENGTH, airspeed=15.0, generator=np.random.default_rng(1))
    stationary = np.zeros((5, 5))
    for _ in range(2000):
        stationary = gusts.F @ stationary @ gusts.F.T + gusts.Q
    for lag in (0, 10, 50):
        expected = np.diag(gusts.H @ np.linalg.matrix_power(gusts.F, lag) @ stationary @ gusts.H.T)
        seen = np.mean(flown[lag:] * flown[: flown.shape[0] - lag], axis=0)
        # 400 000 samples are some 3000 times the correlation time: 3 sigma of a variance are 8 %.
        assert seen == pytest.approx(expected, abs=0.08 * SIGMA**2)


def test_an_unknown_error_costs_and_a_known_one_does_not(short):
    told = slopes(short)
    information = calm_information(told)
    alone = bounds(told.names, information, short.coefficients)
    with_error = bounds(told.names, information, [*short.coefficients, "alpha_scale", "accel_bias_z"])
    assert all(with_error[name] >= (1.0 - 1e-6) * alone[name] for name in alone)
    assert with_error["CL_0"] > 1.01 * alone["CL_0"]


def test_information_of_samples_that_are_not_there_is_none():
    values = np.arange(12.0).reshape(3, 2, 2)
    sigma = np.full((3, 2), 0.5)
    sigma[1] = np.inf
    left = values[[0, 2]].reshape(-1, 2) / 0.5
    told = Slopes(("a", "b"), values, sigma, np.eye(2))
    assert calm_information(told) == pytest.approx(left.T @ left + np.eye(2))


def test_figures_of_a_parameter():
    def line(estimates, bound):
        return {"estimates": estimates, "bounds": {"Cm_q": bound}, "true": {"Cm_q": -4.0}, "failure": None}

    lines = [
        line({"Cm_q": [-4.3, 0.1, -4.5, -4.1]}, 0.3),
        line({"Cm_q": [-3.9, 0.1, -4.1, -3.7]}, 0.4),
        line({}, 0.5),
    ]
    (row,) = rows_of(lines)
    assert row.told == 2
    assert row.refused == pytest.approx(1 / 3)
    assert row.bias == pytest.approx(-0.1)
    assert row.rms == pytest.approx(np.sqrt(0.05))
    assert row.bound == pytest.approx(np.sqrt(0.5 / 3))
    assert row.coverage == 0.5
    assert row.identifiable
    (vague,) = rows_of([line({"Cm_q": [-4.3, 0.1, -4.5, -4.1]}, 0.9)])
    assert not vague.identifiable


def test_a_scenario_in_one_line():
    def line(cm_q, cl_0):
        found = {"Cm_q": [cm_q, 0.1, cm_q - 0.2, cm_q + 0.2]} if cm_q is not None else {}
        found["CL_0"] = [cl_0, 0.01, cl_0 - 0.02, cl_0 + 0.02]
        return {
            "estimates": found, "bounds": {"Cm_q": 0.1, "CL_0": 0.01}, "true": {"Cm_q": -4.0, "CL_0": 0.2},
            "failure": None,
        }  # fmt: skip

    lines = [line(-4.1, 0.2)] * 5 + [line(-3.7, 0.21)] * 4 + [line(None, 0.19)]
    found = verdict(rows_of(lines))
    # Cm_q: 5 errors of 0.1, 4 of 0.3 outside their intervals; CL_0: 5 errors of 0.01 out of 10.
    ratios = np.sqrt([(5 * 0.01 + 4 * 0.09) / 9, 5 * 1e-4 / 10]) / [0.1, 0.01]
    assert (found.median, found.largest) == pytest.approx((ratios.mean(), ratios[0]))
    assert found.worst == found.low.name == "Cm_q"
    assert found.pooled == pytest.approx(15 / 19)
    assert (found.missed, found.asked) == ({"Cm_q": 1}, 20)
    assert found.covered == (False, False)
    assert found.efficient(gusty=False) is False
    assert verdict(rows_of(lines[:3])) is None
