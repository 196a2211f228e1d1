"""A hidden effect is named, added, and closes the gap on a flight nothing was fitted to.

The effect is flown with other seeds; the baseline model handed in is wrong by up to 10 % in every
coefficient.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from discrepancy_flights import over_floor, run_discrepancy


def test_a_hidden_effect_is_named_and_closes_the_gap(tmp_path: Path) -> None:
    hidden = -5.0
    found = run_discrepancy(tmp_path, 11, 0.1, "--effect", f"pitch_damping:Cm_q={hidden}")
    assert found["verdict"] == "missing_effect", found["reasons"]
    assert [one["name"] for one in found["effects"]] == ["pitch_damping"], found["reasons"]
    first = found["effects"][0]
    assert first["probability"] > 0.9
    estimate = first["parameters"]["Cm_q"]
    # Five per cent, not a few standard errors: the bench calibration's own error is on top of the statistical one.
    assert estimate["value"] == pytest.approx(hidden, rel=0.05)
    assert 0.0 < estimate["statistical_std"] < 0.05 * abs(hidden)
    # All forces go with the air's density, and moments with the inertia: 2 % and 5 % of each are in the bars.
    assert estimate["std"] > math.hypot(0.02, 0.05) * 0.98 * abs(hidden)
    found_model = found["model"]["coefficients"]
    assert estimate == {**found_model["Cm_q"], "unit": "1"}
    assert found_model["CL_alpha"]["std"] > 0.98 * 0.02 * found_model["CL_alpha"]["value"]
    gap = found["gap"]["validation"]
    assert over_floor(gap, "after") < 1.3
    assert over_floor(gap, "before") > 1.3 * over_floor(gap, "after")
    assert over_floor(gap, "given") > 1.3 * over_floor(gap, "after")
    assert found["where"], "the disagreement has a place"
    written = json.loads((tmp_path / "new.json").read_text(encoding="utf-8"))
    assert written == found["model"]


def test_a_hidden_effect_is_named_in_turbulence(tmp_path: Path) -> None:
    hidden = ("--effect", "lift_alpha_elevator:CL_alpha_de=1.5")
    gusts = ("--effect", "turbulence:sigma=0.25,length=30", "--wind", "1,-1,0")
    found = run_discrepancy(tmp_path, 41, 0.1, *hidden, *gusts, fit_s=20.0, validate=False)
    assert found["verdict"] == "missing_effect", found["reasons"]
    assert [one["name"] for one in found["effects"]] == ["lift_alpha_elevator"], found["reasons"]
    estimate = found["effects"][0]["parameters"]["CL_alpha_de"]
    assert abs(estimate["value"] - 1.5) < 4.0 * estimate["std"]
    assert 0.0 < estimate["statistical_std"] < 0.15
    assert over_floor(found["gap"]["estimation"], "after") < 1.3


def test_what_gusts_of_a_wrong_model_hold_is_given_back_to_the_effect(tmp_path: Path) -> None:
    """An airspeed that disagrees with the motion passes for gusts twice as strong; with its own it is told."""
    hidden = ("--effect", "density_error:scale=0.12")
    gusts = ("--effect", "turbulence:sigma=0.15,length=20", "--wind", "0.5,1,0")
    found = run_discrepancy(tmp_path, 43, 0.1, *hidden, *gusts, fit_s=20.0, validate=False)
    assert found["verdict"] == "missing_effect", found["reasons"]
    # Whether the air or the sensor is to blame no flight tells without another airspeed.
    (named,) = found["effects"]
    assert {"density_error", "airspeed_error"} >= {named["name"]}, found["reasons"]
    told = [named["name"], *(one["name"] for one in named["alternatives"])]
    if named["name"] == "density_error":
        estimate = named["parameters"]["scale"]
        assert abs(estimate["value"] - 0.12) < 4.0 * estimate["std"]
    assert "density_error" in told
