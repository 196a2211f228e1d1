"""Causes of a change from equations of all axes, made up of regressors, noise and a changed aircraft."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sysid.live.recursive.causes import CAUSES, AxisEquations, Cause, CauseFound, KnownAxis, Lengths, likeliest
from sysid.live.recursive.change_detection import Change
from sysid.live.wording import change_sentence, change_text

BODY = Lengths(1.3, 0.25)
BEFORE = {
    "CL_0": 0.3, "CL_alpha": 4.6, "CL_q": 6.0, "CL_de": 0.4, "CD_0": 0.04, "CD_alpha": 0.3,
    "Cm_0": 0.02, "Cm_alpha": -0.7, "Cm_q": -11.0, "Cm_de": -1.1,
    "CY_0": 0.0, "CY_beta": -0.4, "CY_dr": 0.15, "Cl_0": 0.0, "Cl_beta": -0.04, "Cl_p": -0.45, "Cl_r": 0.1,
    "Cl_da": -0.2, "Cl_dr": 0.01, "Cn_0": 0.0, "Cn_beta": 0.08, "Cn_p": -0.03, "Cn_r": -0.12, "Cn_da": 0.01,
    "Cn_dr": -0.09,
}  # fmt: skip
SIZES = {"alpha": 0.05, "q": 0.006, "de": 0.05, "beta": 0.05, "p": 0.05, "r": 0.03, "da": 0.06, "dr": 0.06}
NOISE = {"CL": 0.02, "CD": 0.005, "CY": 0.01, "Cl": 0.001, "Cm": 0.004, "Cn": 0.001}


def equations(after: dict[str, float], seed: int = 0) -> list[AxisEquations]:
    """60 samples of every axis of an aircraft that has become `after`."""
    generator = np.random.default_rng(seed)
    moved = {name: size * generator.standard_normal(60) for name, size in SIZES.items()}
    found = []
    for axis, noise in NOISE.items():
        names = [name for name in BEFORE if name.startswith(f"{axis}_")]
        X = np.column_stack([moved.get(name.partition("_")[2], np.ones(60)) for name in names])
        y = X @ np.array([after[name] for name in names]) + noise * generator.standard_normal(60)
        known = KnownAxis(names, np.array([BEFORE[name] for name in names]), noise**2, 0.0)
        found.append(AxisEquations(known, X, y))
    return found


def scaled(names: tuple[str, ...], factor: float) -> dict[str, float]:
    return {name: value * factor if name in names else value for name, value in BEFORE.items()}


# By hand: an arm of 15 mm (6 % of a chord of 0.25 m), half a fin, an aileron that stands at 8 deg, everything carried
# by 0.8 of the mass.
CASES = {
    "ELEVATOR": (scaled(("CL_de", "Cm_de"), 0.5), 50.0),
    "AILERONS": (scaled(("Cl_da", "Cn_da"), 0.4), 40.0),
    "RUDDER": (scaled(("CY_dr", "Cl_dr", "Cn_dr"), 0.3), 30.0),
    "FIN": (scaled(("CY_beta", "CY_dr", "Cl_dr", "Cn_beta", "Cn_r", "Cn_dr"), 0.5), 50.0),
    "MASS": (scaled(("CL_0", "CL_alpha", "CL_q", "CL_de", "CY_beta", "CY_dr"), 1.25), 80.0),
    "CG": (
        {
            **BEFORE, "Cm_alpha": -0.7 + 4.6 * 0.015 / 0.25, "Cm_0": 0.02 + 0.3 * 0.015 / 0.25,
            "Cm_q": -11.0 + 6.0 * 0.015 / 0.25, "Cm_de": -1.1 + 0.4 * 0.015 / 0.25,
            "Cn_beta": 0.08 + 0.4 * 0.015 / 1.3, "Cn_dr": -0.09 - 0.15 * 0.015 / 1.3,
        },
        6.0,
    ),
    # An airspeed that reads 1.2 of true: dynamic pressure 1.44, and rates by the airspeed 1 / 1.2.
    "AIRSPEED": (
        {n: value / (1.2 if n.partition("_")[2] in ("p", "q", "r") else 1.44) for n, value in BEFORE.items()}, 120.0
    ),
    "ONE AILERON OFF": (
        {**scaled(("Cl_da", "Cn_da"), 0.5), "Cl_0": -0.1 * np.radians(8.0), "Cn_0": 0.005 * np.radians(8.0)}, 8.0
    ),
    "ELEVATOR STUCK": (
        {**scaled(("CL_de", "Cm_de"), 0.0), "Cm_0": 0.02 - 1.1 * np.radians(3.0), "CL_0": 0.3 + 0.4 * np.radians(3.0)},
        3.0,
    ),
    "DRAG": ({**BEFORE, "CD_0": 0.06}, 0.02),
    "FLAPS": ({**BEFORE, "CL_0": 0.5, "CD_0": 0.07, "Cm_0": 0.0}, 0.2),
}  # fmt: skip


@pytest.mark.parametrize("short", CASES)
def test_the_cause_comes_first_with_its_size_within_the_bar(short: str) -> None:
    after, size = CASES[short]
    first, second = likeliest(equations(after), BODY)[:2]
    assert first.cause.short == short
    assert first.probability > 0.5 > second.probability
    assert abs(first.size - size) < 2.5 * first.std
    assert first.std < max(0.2 * size, 0.5)


def test_bars_are_those_of_many_flights() -> None:
    after, size = CASES["CG"]
    found = [likeliest(equations(after, seed), BODY)[0] for seed in range(60)]
    assert all(one.cause.short == "CG" for one in found)
    z = np.array([(one.size - size) / one.std for one in found])
    # The samples here are independent; bars are for such as follow one another.
    assert np.std(z) < 1.0
    assert abs(np.mean(z)) < 0.3


def test_probabilities_are_of_all_causes() -> None:
    found = likeliest(equations(BEFORE), BODY)
    assert sum(one.probability for one in found) == pytest.approx(1.0)
    assert likeliest([], BODY) == []


@pytest.mark.parametrize("cause", CAUSES, ids=lambda one: one.short)
def test_every_cause_fits_one_text_of_mavlink_and_has_its_words(cause: Cause) -> None:
    found = CauseFound(cause, 0.9, -103.4567, 12.345)
    change = Change(1234.5, "Cm", "Cm_de", 1.59, 0.82, 0.05, (found,))
    assert change_text(change).startswith(cause.short)
    assert change_text(change).endswith("since 1234.5s")
    assert len(change_text(change)) <= 50
    assert change_sentence(change).startswith(
        f"{cause.name}: -103 {cause.unit} ± 12 since 1234.5 s (Cm_de 1.59 -> 0.82)"
    )


def test_without_a_likely_cause_the_motion_alone_is_named() -> None:
    change = Change(24.2, "Cn", "Cn_beta", 0.08, 0.05, 0.01)
    assert change_text(change) == "YAW CHANGED since 24.2s"
    assert change_sentence(change) == "something has changed in yaw since 24.2 s (Cn_beta 0.08 -> 0.05)"
    doubtful = [CauseFound(one, 0.2, 50.0, 5.0) for one in CAUSES[:3]]
    told = change_sentence(replace(change, causes=tuple(doubtful)))
    assert told.endswith(": perhaps the elevator, the ailerons or the rudder")


def test_a_surface_that_does_more_than_before_is_no_cause() -> None:
    after = scaled(("CL_de", "Cm_de"), 1.25)
    assert "ELEVATOR" not in [one.cause.short for one in likeliest(equations(after), BODY)]
