"""Aerodynamics outside the structure: told where they are, counted in the bars, and not invented where they are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from simulated import fly_mav

from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.model.model_file import Coefficient, Model, read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.compatibility.reconstruction import check_compatibility
from sysid.identify import identify
from sysid.output_error.from_problem import fit
from sysid.output_error.structure_error import _GAIN, _likeliest_variances, _reduced
from sysid.problem.estimation_problem import free_coefficients
from sysid.problem.formulation import make_problem
from sysid.problem.model_structure import default_structure
from sysid.signals.preparation import prepare

pytestmark = pytest.mark.whole_flight

Array = NDArray[np.float64]

CURVED = {"CL_alpha3": -4.0, "Cm_alpha3": -1.2, "Cm_alpha2_de": -4.0, "Cn_alpha_beta": 0.05}
STRUCTURE = default_structure(("de", "da", "dr"))


def nearest(flown, vehicle) -> dict[str, float]:
    """Least-squares coefficients of the structure along the true motion, from the true coefficients of each axis."""
    truth, g = flown.truth, vehicle.geometry
    V = truth["V"][1:]
    along = {name: truth[name][1:] for name in ("alpha", "beta", "CL")}
    along |= {name: truth[name][1:] * length / (2.0 * V) for name, length in (("p", g.b), ("q", g.c), ("r", g.b))}
    along |= {name: flown.command[:-1, j] for j, name in enumerate(("de", "da", "dr"))}
    found: dict[str, float] = {}
    for axis in ("CL", "CD", "CY", "Cl", "Cm", "Cn"):
        names = [name for name in STRUCTURE if parse_term(name).axis == axis]
        X = np.stack([np.prod([np.ones(V.size), *(along[f] for f in parse_term(n).factors)], axis=0) for n in names], 1)
        found |= dict(zip(names, np.linalg.lstsq(X, truth[axis][1:], rcond=None)[0], strict=True))
    return found


def scores(result, truth: dict[str, float]) -> Array:
    """Errors in standard errors."""
    return np.array([(result.value(name) - value) / result.std(name) for name, value in truth.items()])


@pytest.fixture(scope="module")
def curved():
    """A flight of an aircraft with terms outside the structure: signals, flight, vehicle."""
    vehicle, base = load_vehicle("iitb-mav"), read_model("iitb-mav")
    extra = {name: Coefficient(value) for name, value in CURVED.items()}
    signals, flown = fly_mav("multisine", 41, model=Model("curved", {**base.coefficients, **extra}))
    return signals, flown, vehicle


def test_bars_count_what_the_structure_leaves_over(curved) -> None:
    signals, flown, vehicle = curved
    truth = nearest(flown, vehicle)
    prepared = [prepare(signals, vehicle)]
    problem = make_problem(prepared, vehicle, check_compatibility(prepared), ground=True)
    zero = Model("zero", {name: Coefficient(0.0) for name in STRUCTURE})
    start = {name: value for name, value in truth.items() if name in STRUCTURE}
    plain = fit(problem, zero, free_coefficients(STRUCTURE, problem.motion), start=start)
    found = identify([signals], vehicle, method="oe")
    assert found.likeliest is not None
    assert found.likeliest.wider is not None
    assert {"CL", "Cm", "Cn"} <= set(found.likeliest.wider.shown)
    (told,) = [warning for warning in found.warnings if "the structure does not hold" in warning]
    assert "Cn_alpha_beta" in told
    after = scores(found.likeliest.estimate, truth)
    assert np.abs(after).max() < 4.0
    assert np.sqrt(np.mean(after**2)) < 1.5
    # Not by wide bars: those of plain output error, coloured residuals counted, are ten times as wide and hold less.
    before = scores(plain, truth)
    assert np.abs(before).max() > 4.0
    assert np.median([found.likeliest.estimate.std(name) / plain.std(name) for name in truth]) < 0.1
    assert set(found.model.coefficients) == set(STRUCTURE)
    beside = found.model.coefficients["Cm_alpha"].extra
    assert "mass_1pct" in beside["systematic"]
    assert "timing_10ms" in beside["late"]


def test_a_guessed_travel_comes_on_top_of_what_the_structure_leaves_over(curved) -> None:
    signals, _, vehicle = curved
    guessed = {
        name: replace(one, gain_std=0.3 if name == "elevator" else 0.0) for name, one in vehicle.controls.items()
    }
    found = [
        identify([signals], craft, method="oe", systematic=False).model.coefficients
        for craft in (vehicle, replace(vehicle, controls=guessed))
    ]
    for name in ("CL_alpha", "Cm_alpha", "Cm_de", "Cn_dr"):
        sure, unsure = (one[name] for one in found)
        assert unsure.value == pytest.approx(sure.value, rel=1e-6)
        share = unsure.extra["systematic"]["elevator_gain_std"]
        assert unsure.std**2 == pytest.approx(sure.std**2 + share**2, rel=1e-3)
        expected = (
            0.3 * abs(sure.value) if name == "Cm_de" else 0.0
        )  # further terms of the prior move the rest a little
        assert abs(share) == pytest.approx(expected, rel=0.05, abs=0.005 * abs(sure.value))


def test_a_flight_of_the_structure_itself_keeps_its_estimate() -> None:
    vehicle = load_vehicle("iitb-mav")
    signals, _ = fly_mav("multisine", 42)
    found = identify([signals], vehicle, systematic=False, method="oe")
    assert found.likeliest is not None
    assert found.likeliest.wider is None
    assert not [warning for warning in found.warnings if "structure" in warning]


def correlated(generator: np.random.Generator, count: int) -> Array:
    """An information matrix of parts that go together, of widely different size."""
    rows = generator.standard_normal((60, count)) @ np.triu(np.ones((count, count))) * np.geomspace(1.0, 100.0, count)
    return np.asarray(rows.T @ rows)


def test_noise_alone_seldom_looks_like_a_misfit() -> None:
    generator = np.random.default_rng(7)
    owner = np.repeat([0, 1, 2], 5)
    seen = correlated(generator, owner.size)
    root = np.linalg.cholesky(seen)
    gains = [_likeliest_variances(seen, root @ generator.standard_normal(owner.size), owner)[1] for _ in range(100)]
    # The gain of one variance is, in half of all cases, a chi-squared number of one degree.
    assert np.mean(np.array(gains) > 3.84) == pytest.approx(0.025, abs=0.03)
    assert np.max(gains) < _GAIN


def test_the_size_of_a_misfit_is_found() -> None:
    """Parts of standard deviation 0.3 in the second axis of three, none in the others."""
    generator = np.random.default_rng(8)
    owner = np.repeat([0, 1, 2], 5)
    seen = correlated(generator, owner.size)
    root = np.linalg.cholesky(seen)
    found = []
    for _ in range(40):
        parts = np.where(owner == 1, 0.3 * generator.standard_normal(owner.size), 0.0)
        variances, gains = _likeliest_variances(
            seen, seen @ parts + root @ generator.standard_normal(owner.size), owner
        )
        assert gains[1] > _GAIN
        found.append(variances)
    mean = np.mean(found, axis=0)
    assert mean[1] == pytest.approx(0.09, rel=0.25)
    assert max(mean[0], mean[2]) < 0.01 * mean[1]


def test_parts_that_the_others_leave_nothing_of_have_no_evidence() -> None:
    # Two of three parts are one unknown of the others: what is left of them is rounding, up to 1e-6 of 1e10.
    J = np.random.default_rng(4).standard_normal((60, 5)) * [1.0, 1e5, 1e2, 1e5, 1e5]
    J[:, 3], J[:, 4] = J[:, 0] * 1e5, J[:, 1] + 1e-7 * J[:, 3]
    left = np.random.default_rng(5).standard_normal(60)
    seen, pull = _reduced(J.T @ J, J.T @ left, np.array([0, 1]), np.array([2, 3, 4]))
    assert seen[0, 0] > 1e4
    assert np.abs(seen[1:, 1:]).max() < 1e-3
    variances, gains = _likeliest_variances(seen, pull, np.array([0, 1, 1]))
    assert np.isfinite(variances).all()
    assert np.isfinite(gains).all()
    assert abs(gains[1]) < 1.0
