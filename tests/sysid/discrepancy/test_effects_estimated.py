"""Effects hidden in a simulated flight, estimated together with the coefficients: other step size, noise, start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import fly_mav

from sim_vehicle.effects import EFFECTS, parse_effect
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.compatibility.reconstruction import check_compatibility
from sysid.discrepancy.candidates import Candidate, candidates, extended, stepping_of
from sysid.discrepancy.innovations.candidate_fits import FittedModel, fit_short, fitted
from sysid.errors import SignalError
from sysid.output_error.estimator import OutputErrorResult
from sysid.output_error.from_problem import fit
from sysid.problem.estimation_problem import Problem, free_coefficients
from sysid.problem.formulation import make_problem
from sysid.problem.free_parameters import effect_parameter
from sysid.signals.preparation import prepare

pytestmark = pytest.mark.whole_flight

# Effect with its values, whether thrust is measured, and the largest standard errors that the flight may leave.
HIDDEN = [
    (
        "configuration_step:dCL=0.1,dCD=0.01,dCm=-0.01,time=7.31",
        True,
        {"dCL": 2e-3, "dCD": 2e-3, "dCm": 1e-3, "time": 0.01},
    ),
    ("mass_drop:fraction=0.08,time=11.4", True, {"fraction": 2e-3, "time": 0.01}),
    ("sensor_time_skew:delay=0.015,group=imu", True, {"delay": 2e-4}),
    ("linkage_nonlinearity:cubic=6", True, {"cubic": 2.0}),
    ("battery_sag:rate=0.004", False, {"rate": 2e-4}),
    ("wind_shear:gradient=0.05", True, {"gradient": 5e-3}),
]


def solved(problem: Problem, model: Model, candidate: Candidate, names: list[str]) -> OutputErrorResult:
    """The fit from that of the candidate's starts which two steps make the likeliest."""
    rough = replace(problem, sub_steps=1)
    costs = [fit(rough, extended(model, candidate, start), names, max_iterations=2).cost for start in candidate.starts]
    start = candidate.starts[costs.index(min(costs))]
    return fit(problem, extended(model, candidate, start), names, candidate.names)


def test_the_likelihood_goes_in_steps_over_a_dead_bands_width_alone() -> None:
    """Fits hold such a parameter, and the search looks at its half steps: both by the same rule."""
    stepping = {name: stepping_of(effect) for name, effect in EFFECTS.items() if stepping_of(effect)}
    assert stepping == {"servo_deadband": {"width": 1e-3}}
    held = {
        (name, one.name) for name, effect in EFFECTS.items() for one in effect.parameters
        if one.fitted and effect_parameter(name, one.name).is_stepping
    }  # fmt: skip
    assert held == {("servo_deadband", "width")}


def test_a_dead_band_is_found_to_the_step_of_the_servo_pulses() -> None:
    """Commands come in steps of 1 us, 0.872 mrad: between two of them nothing tells half of the width."""
    text, step = "servo_deadband:width=0.006", 0.872e-3
    effect, truth = parse_effect(text)
    vehicle, model = load_vehicle("iitb-mav"), read_model("iitb-mav")
    signals, _ = fly_mav("multisine", 12, effects=(text,))
    prepared = [prepare(signals, vehicle)]
    problem = make_problem(prepared, vehicle, check_compatibility(prepared))
    names = free_coefficients(list(model.coefficients), problem.motion)
    (candidate,) = (one for one in candidates(problem, model) if one.effect.name == effect.name)
    np.testing.assert_allclose([start["width"] for start in candidate.starts], 0.5e-3 * np.arange(1, 41))
    found = solved(problem, model, replace(candidate, starts=candidate.starts[3::4]), names)
    assert abs(found.value("servo_deadband.width") - truth["width"]) < 2.0 * step
    assert found.cost < fit(problem, model, names).cost - 1000.0


def test_the_search_leaves_a_wrong_step_of_a_dead_band() -> None:
    """From a third of the width, where the likelihood has a hill of its own; the error bar is that of the steps."""
    effect, truth = parse_effect("servo_deadband:width=0.009")
    vehicle, model = load_vehicle("iitb-mav"), read_model("iitb-mav")
    signals, _ = fly_mav("multisine", 14, effects=("servo_deadband:width=0.009",))
    prepared = [prepare(signals, vehicle)]
    problem = make_problem(prepared, vehicle, check_compatibility(prepared))
    names = free_coefficients(list(model.coefficients), problem.motion)
    (candidate,) = (one for one in candidates(problem, model) if one.effect.name == effect.name)
    base = FittedModel(model, names, (), fitted(problem, model, names, (), {}))
    found = fit_short(problem, base, candidate, {"width": 0.003})
    assert found is not None
    error, std = found.value("servo_deadband.width") - truth["width"], found.std("servo_deadband.width")
    assert std == pytest.approx(0.5e-3)
    assert abs(error) < 3.0 * std
    assert found.cost < base.result.cost - 1000.0


@pytest.mark.parametrize(("text", "measured", "largest"), HIDDEN, ids=[text.partition(":")[0] for text, _, _ in HIDDEN])
def test_a_hidden_effect_is_estimated_within_its_error_bars(
    text: str, measured: bool, largest: dict[str, float]
) -> None:
    effect, truth = parse_effect(text)
    vehicle, model = load_vehicle("iitb-mav"), read_model("iitb-mav")
    signals, _ = fly_mav("multisine", 11, effects=(text,))
    if not measured:
        kept = {name: signal for name, signal in signals.signals.items() if name not in ("thrust", "rpm")}
        signals = replace(signals, signals=kept)
    prepared = [prepare(signals, vehicle)]
    problem = make_problem(prepared, vehicle, check_compatibility(prepared))
    names = free_coefficients(list(model.coefficients), problem.motion)
    found = [one for one in candidates(problem, model) if one.effect.name == effect.name]
    assert len(found) == (4 if effect.name == "sensor_time_skew" else 1)
    (candidate,) = (one for one in found if one.effect.complete({name: truth[name] for name in one.free}) == truth)
    result = solved(problem, model, candidate, names)
    assert result.converged
    for name in candidate.free:
        parameter = candidate.parameter(name)
        assert result.std(parameter) < largest[name], name
        assert abs(result.value(parameter) - truth[name]) < 4.0 * result.std(parameter), name


@pytest.mark.parametrize("recorded", ["altitude", "vd"])
def test_wind_shear_in_gusts_is_estimated_by_filter_error_whatever_tells_the_height(recorded: str) -> None:
    vehicle, model = load_vehicle("iitb-mav"), read_model("iitb-mav")
    effect, _ = parse_effect("wind_shear:gradient=0.06")
    signals, _ = fly_mav("multisine", 15, effects=("wind_shear:gradient=0.06", "turbulence:sigma=0.2,length=20"))
    kept = {name: signal for name, signal in signals.signals.items() if name != "altitude" or recorded == name}
    prepared = [prepare(replace(signals, signals=kept), vehicle)]
    problem = make_problem(prepared, vehicle, check_compatibility(prepared), ground=True)
    names = free_coefficients(list(model.coefficients), problem.motion)
    result = fitted(problem, model.with_effect(effect, {"gradient": 0.0}), names, [(effect.name, "gradient")], {}, 0.2)
    error, std = result.value("wind_shear.gradient") - 0.06, result.std("wind_shear.gradient")
    assert std < 0.015
    assert abs(error) < 3.0 * std


def test_wind_shear_is_no_candidate_and_no_model_where_nothing_tells_the_height() -> None:
    vehicle, model = load_vehicle("iitb-mav"), read_model("iitb-mav")
    signals, _ = fly_mav("multisine", 15)
    unknown = ("altitude", "gps_altitude", "static_pressure", "vn", "ve", "vd")
    kept = {name: signal for name, signal in signals.signals.items() if name not in unknown}
    prepared = [prepare(replace(signals, signals=kept), vehicle)]
    problem = make_problem(prepared, vehicle, check_compatibility(prepared))
    assert "wind_shear" not in [one.effect.name for one in candidates(problem, model)]
    effect, values = parse_effect("wind_shear:gradient=0.06")
    with pytest.raises(SignalError, match="record altitude") as caught:
        fit(problem, model.with_effect(effect, values), ["CL_alpha"])
    assert "\n" not in str(caught.value)
