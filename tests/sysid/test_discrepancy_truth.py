"""What a flight can tell of a hidden effect: closed forms, and what was computed elsewhere for the same aircraft."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from discrepancy_cases import Case, baseline_model, structure, true_model, with_effects
from discrepancy_truth import Whitener, separations, smallest_stds, tell
from effect_responses import whole_response
from flight_bounds import LONGITUDINAL_OUTPUTS, Experiment, Slopes, slopes

from sim_vehicle.effects import EFFECTS
from sim_vehicle.fly import fly
from sim_vehicle.model import read_model
from sim_vehicle.plan import plan_of
from sim_vehicle.plant import Plant
from sim_vehicle.sensors import SensorSuite
from sim_vehicle.vehicle import load_vehicle

# Sigma by which an effect stands out of an 18 s elevator multisine of 2 deg peak in calm air, all 17 nominal parameters
# fitted again: computed with another simulator, linearised, for the same aircraft. Those that rest on slow changes of
# the airspeed are left out: they depend on the lowest harmonics, which are not the same there.
ELSEWHERE = {
    "pitch_damping": ({"Cm_q": -5.0}, 1370.0),
    "lift_pitch_rate": ({"CL_q": 4.0}, 370.0),
    "vane_lag": ({"tau": 0.04}, 136.0),
    "pitot_lag": ({"tau": 0.15}, 291.0),
    "accelerometer_misalignment": ({"pitch": np.radians(1.0)}, 37.0),
    "actuator_lag": ({"tau": 0.04}, 3280.0),
}
NOMINAL = ("accel_bias_x", "accel_bias_z", "gyro_bias_q", "alpha_scale", "theta_scale")
LONGITUDINAL = ("CL", "CD", "Cm")


def test_a_separation_is_the_distance_from_what_others_span() -> None:
    axes = np.eye(6)
    hidden = 3.0 * axes[0] + 4.0 * axes[1] + 12.0 * axes[2] + 84.0 * axes[3]
    imitators = {
        "one": [axes[:, 1:2], axes[:, 2:3]],
        "two": [5.0 * axes[:, [0, 3]] + axes[:, [3, 0]]],
        "blind": [axes[:, 0:1]],
        "alias": [hidden[:, None]],
    }
    detect, separate = separations(hidden, imitators, 7.0 * axes[:, 0:1])
    assert detect == pytest.approx(np.sqrt(4.0**2 + 12.0**2 + 84.0**2))
    assert separate["one"] == pytest.approx(np.hypot(4.0, 84.0))
    assert separate["two"] == pytest.approx(np.hypot(4.0, 12.0))
    assert separate["blind"] == pytest.approx(detect)
    assert separate["alias"] == pytest.approx(0.0, abs=1e-9)


def test_the_bound_of_a_slope_beside_an_unknown_level_is_the_regression_s() -> None:
    x = np.array([0.0, 1.0, 2.0, 5.0, 9.0])
    found = smallest_stds({"slope": x}, np.ones((5, 1)))
    assert found["slope"] == pytest.approx(1.0 / np.sqrt(np.sum((x - x.mean()) ** 2)))


@cache
def flight_of(effect: str) -> tuple[Experiment, Slopes]:
    """The elevator multisine flown with a coefficient effect, or without any where `effect` is empty."""
    vehicle, model = load_vehicle("iitb-mav"), read_model("iitb-mav")
    if effect:
        model = with_effects(model, {effect: ELSEWHERE[effect][0]})
    suite = SensorSuite(vehicle, noise="none", generator=0)
    flown = fly(Plant(vehicle, model), plan_of(["elevator-multisine"]), suite=suite, generator=np.random.default_rng(0))
    experiment = Experiment(flown, vehicle, model, LONGITUDINAL_OUTPUTS, lateral=False)
    return experiment, slopes(experiment)


@pytest.mark.parametrize("name", ELSEWHERE)
def test_an_effect_stands_out_as_another_computation_says(name: str) -> None:
    values, sigma = ELSEWHERE[name]
    experiment, base = flight_of(name if EFFECTS[name].is_coefficient else "")
    unknown = [
        i
        for i, term in enumerate(base.names)
        if term not in values and (term in NOMINAL or term.startswith("start ") or term.split("_")[0] in LONGITUDINAL)
    ]
    assert len(unknown) == 17
    whitener = Whitener(experiment, base, 0.0)
    nuisances = whitener.rows(base.values[:, :, unknown], np.zeros((0, 17)))
    answer = whitener.rows(whole_response(experiment, name, values)[:, :, None], np.zeros((0, 1)))
    detect, _ = separations(answer[:, 0], {}, nuisances)
    assert 0.5 < detect / sigma < 2.0


def test_aliases_stand_out_of_nothing_and_a_lag_of_anything() -> None:
    gain = tell(Case((("elevator_gain", 1.0),), 0, 0.0))["elevator_gain"]
    assert gain.detect < 0.1
    lag = tell(Case((("vane_lag", 1.0),), 0, 0.0))["vane_lag"]
    assert lag.detect > 50.0
    assert min(lag.separate.values()) > 5.0
    assert 0.0 < lag.bounds["tau"] < 0.001


def test_the_baseline_lacks_what_is_hidden_and_is_off_by_a_tenth_at_most() -> None:
    case = Case((("weathercock", 1.0),), 3, 0.1)
    assert true_model(case).values()["Cn_beta"] == pytest.approx(0.25)
    baseline = baseline_model(case).values()
    assert "Cn_beta" not in baseline
    true = structure(case).values()
    shares = [baseline[name] / true[name] - 1.0 for name in true]
    assert max(map(abs, shares)) <= 0.1
    assert np.std(shares) > 0.03
    assert baseline_model(Case((("actuator_lag", 1.0),), 3, 0.1)).effects == ()
