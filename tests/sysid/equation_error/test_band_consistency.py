"""Closed loops and gusts bias a regression; the same coefficient in several bands of frequency shows it."""

import numpy as np
import pytest
from held_response import BODY, DENSITY, SPEED, STEP_S, multisine, rolling

from sysid.equation_error.band_consistency import band_estimates, refusal, warning, widened
from sysid.equation_error.time_domain import equation_error, settled_equations
from sysid.numerics.gaussian import Gaussian
from sysid.signals.flight import FlightData

NAMES = ["Cl_0", "Cl_p", "Cl_da"]
TRUE = {"Cl_p": -0.45, "Cl_da": 0.15}


def levelled(seed, count=6000, gust=2.0, excitation=0.0):
    """Roll in gusts (white acceleration through 0.3 s) while a loop holds the wings level with aileron: plain Euler
    steps at a tenth of the sample interval."""
    rng = np.random.default_rng(seed)
    command = multisine(rng, count, 0.2, 2.5, excitation)
    moment = 0.5 * DENSITY * SPEED**2 * BODY.S * BODY.b / BODY.Ixx
    fine = STEP_S / 10.0
    p = phi = push = 0.0
    rate, aileron = np.zeros(count), np.zeros(count)
    for k in range(count):
        rate[k] = p
        aileron[k] = command[k] - 0.5 * phi - 0.05 * p
        for kick in rng.standard_normal(10):
            push += fine * -push / 0.3 + gust * kick * np.sqrt(fine)
            turn = moment * (TRUE["Cl_p"] * p * BODY.b / (2.0 * SPEED) + TRUE["Cl_da"] * aileron[k]) + push
            p, phi = p + fine * turn, phi + fine * p
    zero = np.zeros(count)
    columns = {"ax": zero, "ay": zero, "az": np.full(count, -9.8), "p": rate, "q": zero, "r": zero, "alpha": zero}
    columns |= {"V": np.full(count, SPEED), "thrust": zero, "da": aileron}
    return FlightData("level", STEP_S, STEP_S * np.arange(count), columns, (), {"reference": "centre of gravity"})


def regressed(data):
    """Estimates with statistical errors, the bands, and estimates with what the bands differ by."""
    result = equation_error(data, BODY, NAMES)["Cl"]
    joint = Gaussian(result.names, result.values, result.covariance)
    equations = settled_equations(data, BODY, NAMES)
    bands = band_estimates(equations, joint)
    return joint, bands, widened(joint, equations, bands)


@pytest.mark.parametrize("seed", range(3))
def test_bars_of_an_excited_flight_under_feedback_in_gusts_hold_the_truth(seed):
    joint, bands, wide = regressed(levelled(seed, excitation=0.01))
    told, honest = joint.entries(), wide.entries()
    assert max(abs(told[name][0] - TRUE[name]) / told[name][1] for name in TRUE) > 4.0
    for name in TRUE:
        assert honest[name][0] == told[name][0]
        assert refusal(honest[name][0], bands[name]) is None
        assert abs(honest[name][0] - TRUE[name]) < 1.96 * honest[name][1]
    (line,) = warning(bands)
    assert "closed loop" in line


@pytest.mark.parametrize("seed", range(3))
def test_what_feedback_alone_excites_is_refused(seed):
    """The regression then tells the inverse of the loop: 0.02 and 0.015 for -0.45 and 0.15, with bars of 8 and 25 %."""
    joint, bands, _ = regressed(levelled(seed))
    told = joint.entries()
    for name in TRUE:
        assert abs(told[name][0] - TRUE[name]) > 20.0 * told[name][1]
        assert "bands of frequency give" in str(refusal(told[name][0], bands[name]))


def test_bands_of_flights_with_open_loop_agree():
    noisy = []
    for seed in range(12):
        data = rolling(-0.45, 0.15, seed, 3000)
        noise = 0.01 * np.random.default_rng(seed).standard_normal(data.time_s.size)
        changed = FlightData(data.name, STEP_S, data.time_s, {**data.columns, "p": data["p"] + noise}, (), data.notes)
        joint, bands, wide = regressed(changed)
        assert set(bands) == set(TRUE)
        noisy.append(bool(warning(bands)))
        if not noisy[-1]:
            assert wide.covariance == pytest.approx(joint.covariance)
    assert sum(noisy) <= 1


def test_short_flights_have_no_bands():
    assert regressed(rolling(-0.45, 0.15, 1, 150))[1] == {}


def test_the_constant_moves_with_a_widened_derivative():
    """With a regressor of mean m, an error d of its coefficient is one of -m d of the constant."""
    data = levelled(1)
    shifted = FlightData(data.name, STEP_S, data.time_s, {**data.columns, "da": data["da"] + 0.2}, (), data.notes)
    joint, bands, wide = regressed(shifted)
    added = wide.covariance - joint.covariance
    i, j = wide.names.index("Cl_0"), wide.names.index("Cl_da")
    mean = float(np.mean(shifted["da"]))
    assert added[j, j] == pytest.approx(bands["Cl_da"].scatter ** 2)
    assert added[i, j] == pytest.approx(-mean * added[j, j], rel=0.02)
