"""The sentence of a result: the right words for each verdict, and numbers worked out by hand."""

from __future__ import annotations

import math
import re
from typing import Any

import pytest

from sim_vehicle.effects import EFFECTS
from sysid.discrepancy.summary import sentence, shrinking
from sysid.discrepancy.wording import chance_text, digits, effect_phrase, moved_words

# Alpha goes from 5.1 to 1.1 times its floor, q from 2 to 1: of alpha's part above the floor, sqrt(5.1^2 - 1) = 5.001,
# sqrt(1.1^2 - 1) = 0.4583 is left, so 91 % is closed.
GAP = {
    "given": {"alpha": 0.060, "q": 0.10},
    "before": {"alpha": 0.051, "q": 0.04},
    "after": {"alpha": 0.011, "q": 0.02},
    "noise_floor": {"alpha": 0.010, "q": 0.02},
}
STALL = {
    "name": "stall", "probability": 0.98, "parameters": {"alpha_stall": {"value": 0.24435, "std": 0.0013}},
    "alternatives": [], "separating_manoeuvre": "slow deceleration into the stall",
}  # fmt: skip
LAG = {
    "name": "actuator_lag", "probability": 0.99, "parameters": {"tau": {"value": 0.04021, "std": 0.0011}},
    "alternatives": [{"name": "actuator_delay", "probability": 0.31}, {"name": "vane_lag", "probability": 0.05}],
    "separating_manoeuvre": "two amplitudes with content from 3 to 6 Hz",
}  # fmt: skip


def result(verdict: str, *effects: dict[str, Any], gap: Any = None, **more: Any) -> dict[str, Any]:
    gaps = {"estimation": {"given": {"q": 1.0}, "before": {"q": 1.0}, "after": {"q": 1.0}, "noise_floor": {"q": 1.0}}}
    if gap is not False:
        gaps["validation"] = gap or GAP
    return {"verdict": verdict, "flights": ["a"], "where": [], "effects": list(effects), "gap": gaps, **more}


def test_one_effect_and_how_much_of_the_gap_it_closes() -> None:
    assert sentence(result("missing_effect", STALL)) == (
        "Above 14.0° the wing stalls: adding it closes 91 % of the gap of alpha on the flight not used (from 5.1 to "
        "1.1 times the noise floor); the rest is noise."
    )


def test_what_is_left_is_told() -> None:
    gap = {**GAP, "after": {"alpha": 0.011, "q": 0.034}}
    assert sentence(result("missing_effect", STALL, gap=gap)).endswith(
        "; most is left of q, 1.7 times the noise floor."
    )


def test_more_than_one_flight_and_the_flights_used_where_there_is_no_other() -> None:
    series = {"validation": [{}, {}]}
    assert "on the flights not used" in sentence(result("missing_effect", STALL, series=series))
    alone = result("missing_effect", STALL, gap=False)
    alone["gap"]["estimation"] = GAP
    assert "91 % of the gap of alpha on the flight used" in sentence(alone)


def test_effects_that_the_flight_cannot_tell_apart_stand_together_with_the_manoeuvre() -> None:
    found = sentence(result("missing_effect", {**LAG, "probability": 0.62}))
    assert found == (
        "The servos lag by 40 ms (probability 62 %), or it is delay of the commands (31 %) or lag of the flow vanes "
        "(5 %): this flight cannot distinguish them. What would: two amplitudes with content from 3 to 6 Hz. Adding "
        "the first closes 91 % of the gap of alpha on the flight not used (from 5.1 to 1.1 times the noise floor); "
        "the rest is noise."
    )


def test_several_effects() -> None:
    found = sentence(result("missing_effect", STALL, LAG))
    assert found.startswith(
        "Two effects are missing: above 14.0° the wing stalls; the servos lag by 40 ms. Adding them closes 91 % of"
    )
    assert found.endswith(
        "Instead of lag of the servos it may be delay of the commands (31 %) or lag of the flow vanes (5 %); what "
        "would distinguish them: two amplitudes with content from 3 to 6 Hz."
    )


def test_an_effect_that_shrinks_no_gap_is_said_to_show_in_the_likelihood_alone() -> None:
    gap = {**GAP, "before": GAP["after"]}
    found = sentence(result("missing_effect", STALL, gap=gap))
    assert "no gap on the flight not used shrinks by it" in found
    assert "closes" not in found


def test_a_simulation_that_was_lost_has_no_percentage() -> None:
    gap = {**GAP, "before": {"q": 0.04}}
    found = sentence(result("missing_effect", STALL, gap=gap))
    assert "without it the simulation of alpha on the flight not used is lost" in found
    assert "%" not in found


def test_wrong_coefficients() -> None:
    """Q goes from 5 to 2 times its floor when they are fitted again: 1 - sqrt(3 / 24) is 65 %."""
    gap = {**GAP, "given": {"alpha": 0.011, "q": 0.10}, "before": {"alpha": 0.011, "q": 0.04}}
    assert sentence(result("parameter_error", gap=gap)) == (
        "No effect is missing, but coefficients of the model are wrong: fitting them again closes 65 % of the gap of q "
        "on the flight not used (from 5.0 to 2.0 times the noise floor); most is left of q, 2.0 times the noise floor."
    )


def test_nothing() -> None:
    gap = {**GAP, "given": {"alpha": 0.0108, "q": 0.0204}}
    found = sentence(result("none", gap=gap))
    assert found.startswith("Nothing is missing: ")
    assert found.endswith("the largest gap on the flight not used, that of alpha, is 1.1 times the noise floor.")


def test_unexplained_names_axis_and_variable() -> None:
    where = [{"axis": "Cm", "variable": "qhat", "share": 0.83, "p_value": 1e-9, "intervals": []}]
    assert sentence(result("unexplained", where=where)) == (
        "The model and the flight disagree, and no effect of the catalogue explains it: most in the pitching moment "
        "(Cm) over pitch rate, which goes with 83 % of it; fitted again, the largest gap on the flight not used, that "
        "of alpha, is 5.1 times the noise floor."
    )
    assert "most in" not in sentence(result("unexplained"))


def test_outputs_are_ordered_by_how_much_of_their_gap_goes() -> None:
    assert shrinking(GAP, "before", "after") == ["alpha", "q"]
    assert shrinking(GAP, "given", "before") == ["q", "alpha"]


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_every_effect_has_words_and_shows_each_of_its_estimates(name: str) -> None:
    """Values whose leading digits are those of no other in any unit: they must be found again in the phrase."""
    fitted = [parameter for parameter in EFFECTS[name].parameters if parameter.fitted]
    shown = {"rad": 180.0 / math.pi, "rad/s": 180.0 / math.pi}
    values = {p.name: (0.123 * (i + 1)) / shown.get(p.unit, 1.0) for i, p in enumerate(fitted)}
    words = effect_phrase({"name": name, "parameters": {key: {"value": v, "std": None} for key, v in values.items()}})
    found = "".join(re.findall(r"[0-9]", words.replace(".", "")))
    for i, parameter in enumerate(fitted):
        if name == "configuration_step" and parameter.name.startswith("d"):
            continue
        assert str(123 * (i + 1)) in found, words
    assert "{" not in words


def test_an_effect_of_which_a_part_was_estimated_is_told_by_its_title() -> None:
    effect = {"name": "ground_effect", "parameters": {"lift_gain": {"value": 0.2, "std": 0.01}}}
    assert effect_phrase(effect) == "ground effect (lift_gain = 0.20)"


@pytest.mark.parametrize(
    ("value", "std", "wanted"),
    [
        (14.0002, 0.07, "14.0"),
        (40.21, 1.1, "40"),
        (-5.0123, 0.02, "-5.01"),
        (1234.5, None, "1230"),
        (0.02, 0.5, "0"),
        (0.0, None, "0"),
        (3.2e-9, None, "3.2e-09"),
        (0.00123, 1e-7, "0.00123"),
    ],
)
def test_numbers_have_the_digits_that_their_errors_allow(value: float, std: float | None, wanted: str) -> None:
    assert digits(value, std) == wanted


@pytest.mark.parametrize(
    ("p_value", "told"), [(0.034, "chance 3.4e-02"), (2e-300, "chance 2.0e-300"), (0.0, "chance below 1e-300")]
)
def test_no_chance_is_zero(p_value: float, told: str) -> None:
    assert chance_text(p_value) == told


def test_how_far_the_parameters_move_is_told_in_their_standard_errors() -> None:
    assert moved_words(48.0, 12, 3e-6) == (  # sqrt(48 / 12)
        "fitted again, the model's 12 parameters move by 2.0 standard errors on average"
        " (chi-squared 48, chance 3.0e-06)"
    )
    assert "move by 0.0 standard errors" in moved_words(0.0, 0, 1.0)
