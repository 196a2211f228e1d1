"""The free runs by which learners of corrections are judged beside this project, against the product's simulation."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from discrepancy_cases import Case, baseline_model, fly_case, the_vehicle

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from corrected_flight import AXES, REGRESSORS, free_runs, judged_gap, residual_coefficients

from sim_vehicle.effects import parse_effect
from sim_vehicle.vehicle.packed_model import flatten
from sysid.compatibility.reconstruction import smoothed_states
from sysid.problem.free_run import Fixed, free_run, windows
from sysid.signals.preparation import prepare
from sysid.signals.record import OUTPUTS, STATES

CASE = Case((), 20_000, 0.0)


@pytest.fixture(scope="module")
def flown():
    """Vehicle, baseline, ten seconds of a flight, and where its sensors are."""
    vehicle = the_vehicle()
    prepared = prepare(fly_case(CASE, vehicle)[0], vehicle)
    return vehicle, baseline_model(CASE), prepared.stretches[0].record.window(0, 500), prepared.layout


def starts_of(record, layout):
    states = smoothed_states(record, layout, {})
    path, parts = np.stack([states[name] for name in STATES], axis=1), windows(record)
    begins = np.cumsum([0, *(part.length for part in parts[:-1])])
    return parts, [path[begin] for begin in begins]


def terms(**values):
    """A correction made of products: `Cm_alpha_q=2.0` adds 2 alpha q to Cm."""

    def correction(x):
        out = np.zeros((x.shape[0], len(AXES)))
        for name, value in values.items():
            axis, *factors = name.split("_")
            out[:, AXES.index(axis)] += value * np.prod([x[:, REGRESSORS.index(f)] for f in factors], axis=0)
        return out

    return correction


def compared(flown, baseline, model, correction):
    """Free runs of the baseline with a correction, the product's of a model that has it, and the product's without."""
    vehicle, _, record, layout = flown
    parts, starts = starts_of(record, layout)
    before, after = (Fixed(flatten(vehicle, one), {}) for one in (baseline, model))
    corrected = free_runs(parts, starts, before, correction)
    usual, plain = ([free_run(*run, one) for run in zip(parts, starts, strict=True)] for one in (after, before))
    return np.concatenate(corrected), np.concatenate(usual), np.concatenate(plain)


def test_without_a_correction_it_is_the_products_simulation(flown):
    corrected, usual, _ = compared(flown, flown[1], flown[1], None)
    measured = [
        OUTPUTS.index(name) for name in ("airspeed", "alpha", "beta", "p", "q", "r", "phi", "theta", "ax", "az")
    ]
    np.testing.assert_allclose(corrected[:, measured], usual[:, measured], atol=1e-9)


def test_terms_of_a_correction_act_as_coefficients_of_the_model_do(flown):
    added = {"CL_alpha_de": 1.5, "CD_beta2": 0.8, "CY_p": 0.2, "Cl_r": 0.1, "Cm_alpha_q": -30.0, "Cn_da_dr": 0.3}
    # Without induced drag: in the model that feels the added lift too.
    baseline = model = flown[1].with_coefficient("CD_k", 0.0)
    for name, value in added.items():
        model = model.with_coefficient(name, model.values().get(name, 0.0) + value)
    correction = terms(**{name.replace("beta2", "beta_beta"): value for name, value in added.items()})
    corrected, usual, plain = compared(flown, baseline, model, correction)
    moved = np.abs(usual - plain).max(axis=0)
    told = moved > 1e-6
    assert {OUTPUTS[j] for j in np.nonzero(told)[0]} >= {"airspeed", "alpha", "beta", "p", "q", "r", "ax", "ay", "az"}
    assert np.all(np.abs(corrected - usual).max(axis=0)[told] < 1e-6 * moved[told])


@pytest.mark.parametrize(
    ("effect", "correction"),
    [
        ("thrust_line_offset:z_T=0.02", lambda x, vehicle, cd0: (0.02 / vehicle.geometry.c) * x[:, 9]),
        ("reynolds_drag:n=0.5", lambda x, vehicle, cd0: cd0 * (x[:, 2] ** -0.5 - 1.0)),
    ],
)
def test_thrust_and_speed_are_regressors_as_the_effects_know_them(flown, effect, correction):
    vehicle, baseline, _, _ = flown
    axis = AXES.index("Cm" if effect.startswith("thrust") else "CD")

    def acting(x):
        out = np.zeros((x.shape[0], len(AXES)))
        out[:, axis] = correction(x, vehicle, baseline.values()["CD_0"])
        return out

    corrected, usual, plain = compared(flown, baseline, baseline.with_effect(*parse_effect(effect)), acting)
    moved = np.abs(usual - plain)[:, OUTPUTS.index("airspeed")].max()
    assert moved > 1e-3
    assert np.abs(corrected - usual)[:, OUTPUTS.index("airspeed")].max() < 1e-5 * moved


def test_biases_of_the_sensors_cost_a_model_nothing(flown):
    vehicle, baseline, record, layout = flown
    fixed = Fixed(flatten(vehicle, baseline), {})
    biased = record.z.copy()
    for name, bias in (("p", 0.02), ("q", -0.03), ("az", 0.3), ("alpha", 0.01)):
        biased[:, OUTPUTS.index(name)] += bias
    before = judged_gap([record], layout, fixed)
    after = judged_gap([replace(record, z=biased)], layout, fixed)
    assert after == pytest.approx(before, rel=0.02)


def test_what_diverges_has_an_infinite_gap(flown):
    vehicle, baseline, record, layout = flown
    push = np.array(
        [[0.0, -0.6, 0.0, 0.0, 0.0, 0.0]]
    )  # drag that pushes: airspeed grows without bound in half a second
    found = judged_gap([record], layout, Fixed(flatten(vehicle, baseline), {}), lambda x: np.tile(push, (len(x), 1)))
    assert found["V"] == found["q"] == np.inf


def test_learners_are_given_what_a_wrong_coefficient_leaves_in_its_own_axis(flown):
    vehicle, baseline, _, _ = flown
    prepared = [prepare(fly_case(CASE, vehicle)[0], vehicle)]
    value = baseline.values()["Cm_alpha"]
    rest = [
        residual_coefficients(prepared, vehicle, Fixed(flatten(vehicle, model), {}))
        for model in (baseline, baseline.with_coefficient("Cm_alpha", value - 0.2))
    ]
    (x, before), (same, after) = rest
    assert x.shape == (len(before), len(REGRESSORS))
    np.testing.assert_array_equal(x, same)
    moved = after - before
    slope = np.polyfit(x[:, REGRESSORS.index("alpha")], moved[:, AXES.index("Cm")], 1)[0]
    assert slope == pytest.approx(0.2, rel=0.02)
    others = [place for place, axis in enumerate(AXES) if axis != "Cm"]
    assert np.abs(moved[:, others]).max() < 1e-9
