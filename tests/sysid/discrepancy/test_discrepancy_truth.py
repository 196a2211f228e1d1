"""What a flight can tell of a hidden effect: closed forms, and what was computed elsewhere for the same aircraft."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from discrepancy_cases import (
    Case,
    baseline_model,
    plan_for,
    structure,
    the_vehicle,
    true_model,
    with_effects,
)
from discrepancy_truth import Whitener, separations, smallest_stds, tell
from effect_responses import whole_response
from flight_bounds import LONGITUDINAL_OUTPUTS, Experiment, Slopes, slopes
from made_up import MADE_UP, MadeUp, MadeUpPlant
from separating_flights import plan_named
from smaller_catalogue import catalogue_without

from sim_vehicle.effects import EFFECTS
from sim_vehicle.flight.flight_log import FlownFlight
from sim_vehicle.flight.flight_loop import fly
from sim_vehicle.flight.plant import Plant
from sim_vehicle.flight.sensor_suite import SensorSuite
from sim_vehicle.manoeuvres.plan import plan_of
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "campaign"))

from discrepancy_scores import HIDDEN_TO_ALL, IN_A_SET, SEPARABLE, calibration_error, score

pytestmark = pytest.mark.whole_flight

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
    both = tell(Case((("vane_lag", 1.0), ("polar_offset", 1.0)), 0, 0.0))
    assert both["polar_offset"].detect > 50.0
    lag = both["vane_lag"]
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


def test_made_up_physics_changes_a_flight_and_nothing_else_does() -> None:
    vehicle, plan = the_vehicle(), plan_for("multisine", held_out=False).fitted(3.0)
    model = true_model(Case((), 0, 0.0))
    nothing = MadeUp("nothing", lambda flow: (0.0,) * 6)

    def flown_by(plant: Plant) -> FlownFlight:
        suite = SensorSuite(vehicle, noise="none", generator=0)
        return fly(plant, plan, suite=suite, generator=np.random.default_rng(0))

    # The same steps: the surfaces' lag is averaged over each.
    plain = flown_by(Plant(vehicle, model, max_step=0.005)).truth
    same = flown_by(MadeUpPlant(vehicle, model, nothing)).truth
    for name in ("V", "alpha", "q", "r"):
        assert np.max(np.abs(same[name] - plain[name])) < 1e-4 * np.ptp(plain[name])
    yaw = flown_by(MadeUpPlant(vehicle, model, MADE_UP["one_sided_rudder"]))
    there, mass, geometry = yaw.truth, vehicle.mass, vehicle.geometry
    moment = mass.Izz * there["r_dot"] + (mass.Iyy - mass.Ixx) * there["p"] * there["q"]
    Cn = moment / (0.5 * there["rho"] * there["V"] ** 2 * geometry.S * geometry.b)
    added = -0.05 * np.maximum(there["dr"], 0.0)
    assert np.ptp(added) > 0.001
    assert np.allclose(Cn - there["Cn"], added, atol=1e-9)


def test_an_effect_taken_off_the_list_is_back_afterwards() -> None:
    before = list(EFFECTS)
    with catalogue_without(["stall", "vane_lag"]):
        assert list(EFFECTS) == [name for name in before if name not in ("stall", "vane_lag")]
    assert list(EFFECTS) == before


def line(hidden: dict[str, dict[str, float]], named: list[tuple[str, float]], verdict: str) -> dict[str, Any]:
    """A case's line with one set of names."""
    entries = [{"name": name, "probability": p} for name, p in named]
    first = [{**entries[0], "alternatives": entries[1:], "parameters": {"scale": {"value": 0.07, "std": 0.01}},
              "separating_manoeuvre": "weigh it"}] if entries else []  # fmt: skip
    shares = dict.fromkeys(hidden, 1.0)
    gap = {"validation": {"after": {"V": 2.2, "q": 0.9}}}
    return {"hidden": hidden, "shares": shares, "gust": 0.0, "named": first, "verdict": verdict, "failure": None,
            "gap": gap, "true_gap": {"V": 2.0, "q": 1.0}, "seconds": 1.0}  # fmt: skip


def test_a_case_is_scored_by_what_the_flight_tells() -> None:
    told = {"detect": 40.0, "separate": {"mass_error": 1.0, "reynolds_drag": 30.0}, "bounds": {"scale": 0.008}}
    hidden = {"thrust_scale": {"scale": 0.05}}
    tied = score(line(hidden, [("mass_error", 0.6), ("thrust_scale", 0.4)], "missing_effect"), told)
    assert (tied.kind, tied.right, tied.holds, tied.wrong_confident) == (IN_A_SET, False, True, ())
    assert tied.true_set == ("thrust_scale", "mass_error")
    assert tied.named == ((0.6, False), (0.4, True))
    right = score(line(hidden, [("thrust_scale", 0.97)], "missing_effect"), {**told, "separate": {"mass_error": 9.0}})
    assert (right.kind, right.right) == (SEPARABLE, True)
    assert right.away["scale"] == pytest.approx(2.0)
    assert right.spread["scale"] == pytest.approx(1.25)
    assert right.gap == pytest.approx(np.sqrt((1.1**2 + 0.9**2) / 2.0))
    mute = score(line(hidden, [("stall", 0.99)], "missing_effect"), {**told, "detect": 2.0})
    assert (mute.kind, mute.silent, mute.wrong_confident) == (HIDDEN_TO_ALL, False, ("stall",))
    quiet = score(line(hidden, [], "parameter_error"), {**told, "detect": 2.0})
    assert quiet.silent


def test_the_calibration_error_is_the_mean_distance_of_statement_and_share() -> None:
    stated = [(0.95, True)] * 3 + [(0.95, False)] + [(0.25, False)] * 4
    error, rows = calibration_error(stated)
    assert error == pytest.approx(0.5 * 0.2 + 0.5 * 0.25)
    assert [(count, right) for count, _, right in rows] == [(4, 0.0), (4, 0.75)]


def test_words_of_a_manoeuvre_become_a_plan_unless_it_is_one_on_the_ground() -> None:
    assert plan_named("elevator sweep from 2 to 6 Hz") == "2 to 6 Hz"
    assert plan_named("power-off glide and throttle steps; weigh the aircraft") == "throttle step"
    assert plan_named("bench protractor") == plan_named("bifilar swing test") == ""
    assert sum(bool(plan_named(effect.separated_by)) for effect in EFFECTS.values()) > 0.65 * len(EFFECTS)
