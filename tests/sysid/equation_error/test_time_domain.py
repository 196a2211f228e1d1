"""Equation error against closed forms: exact responses to held commands, and the Gauss-Markov bound."""

import numpy as np
import pytest
from held_response import BODY, DENSITY, SPEED, STEP_S, multisine, rolling

from sim_vehicle.model.aerodynamic_terms import parse_term
from sysid.equation_error.equations import Equations
from sysid.equation_error.time_domain import equation_error
from sysid.signals.flight import FlightData


@pytest.mark.parametrize("damping", [-0.1, -0.45, -0.9])
def test_a_fast_roll_mode_between_held_commands_is_told_without_bias(damping):
    """At -0.9 the roll mode takes 24 ms, hardly more than a sample; the mean of two commands gives 5 % there."""
    found = equation_error(rolling(damping, 0.15), BODY, ["Cl_0", "Cl_p", "Cl_da"])["Cl"]
    assert found.values == pytest.approx([0.0, damping, 0.15], rel=3e-3, abs=1e-5)


def test_two_surfaces_and_their_product_bend_the_rate_too():
    """The same with a moment 0.15 da + 0.3 da de: the jump of a product counts as a whole."""
    data = rolling(-0.45, 0.15)
    elevator = multisine(np.random.default_rng(5), data.time_s.size, 0.3, 2.0, 0.02)
    command = data["da"] * (0.15 + 0.3 * elevator) / 0.15
    moved = rolling(-0.45, 0.15)
    moment = 0.5 * DENSITY * SPEED**2 * BODY.S * BODY.b
    rate = moment * 0.45 * BODY.b / (2.0 * SPEED) / BODY.Ixx
    decay = np.exp(-rate * STEP_S)
    p = moved["p"].copy()
    for k in range(p.size - 1):
        p[k + 1] = decay * p[k] + (1.0 - decay) / rate * moment * 0.15 / BODY.Ixx * command[k]
    columns = {**data.columns, "p": p, "de": elevator}
    data = FlightData("roll", STEP_S, data.time_s, columns, (), data.notes)
    found = equation_error(data, BODY, ["Cl_0", "Cl_p", "Cl_da", "Cl_de_da"])["Cl"]
    assert found.values == pytest.approx([0.0, -0.45, 0.15, 0.3], rel=3e-3, abs=1e-5)


def test_weights_reach_the_gauss_markov_bound_where_airspeed_varies():
    """Constant noise of az means noise of CL that goes with 1/V^2; the bound is that of statsmodels' WLS."""
    import statsmodels.api as sm

    rng = np.random.default_rng(3)
    count = 1500
    speed = np.linspace(10.0, 26.0, count)
    alpha = 0.06 + multisine(rng, count, 0.2, 2.0, 0.004)
    qs = 0.5 * DENSITY * speed**2 * BODY.S
    lift = qs * (0.2 + 4.0 * alpha)
    zero = np.zeros(count)
    columns = {"ax": lift * np.sin(alpha), "ay": zero, "p": zero, "q": zero, "r": zero, "alpha": alpha, "V": speed}
    columns["thrust"] = zero
    errors = []
    for _ in range(60):
        columns["az"] = -lift * np.cos(alpha) + 0.3 * rng.standard_normal(count)
        data = FlightData("f", STEP_S, STEP_S * np.arange(count), columns, (), {"reference": "centre of gravity"})
        errors.append(equation_error(data, BODY, ["CL_0", "CL_alpha"])["CL"].values - [0.2, 4.0])
    design = sm.add_constant(alpha)
    bound = np.sqrt(np.diag(sm.WLS(zero, design, weights=qs**2).fit().normalized_cov_params)) * 0.3
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all(rms < 1.2 * bound)
    unweighted = np.linalg.pinv(design) / qs * 0.3
    assert np.all(np.sqrt(np.sum(unweighted**2, axis=1)) > 1.2 * bound)


def test_columns_asked_for_again_follow_the_timing_and_the_jumps():
    force, moment = ([parse_term(name) for name in names] for names in (["CY_p", "CY_da"], ["Cl_0", "Cl_p", "Cl_da"]))
    values = {"Cl_0": 0.0, "Cl_p": -0.45, "Cl_da": 0.15}
    again = Equations(rolling(-0.45, 0.15), BODY, [*force, *moment])
    before = [again.matrix(terms) for terms in (force, moment)]
    again.take_timing(True)
    again.take_jumps(values, moment)
    fresh = Equations(rolling(-0.45, 0.15), BODY, [*force, *moment], command_first=True)
    fresh.take_jumps(values, moment)
    for terms, old, moved in ((force, before[0], "CY_da"), (moment, before[1], "Cl_p")):
        found, place = again.matrix(terms), [term.name for term in terms].index(moved)
        np.testing.assert_allclose(found, fresh.matrix(terms), rtol=0.0, atol=1e-12)
        assert np.abs(found - old).max(axis=0).argmax() == place
