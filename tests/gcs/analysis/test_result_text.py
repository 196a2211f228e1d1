"""Results as text: what makes them doubtful stands first, and no chance is zero."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from gcs.analysis import postflight
from gcs.analysis.results import discrepancy_text, identification_text, write_identification
from sim_vehicle.model.model_file import BUILT_IN

GRAMS = "mass.mass: 1000 kg on a span of 1 m is hardly possible: grams?"


def test_an_identification_begins_with_its_warnings() -> None:
    refused = [{"name": f"CL_{i}", "reason": "unlike any aircraft"} for i in range(30)]
    outputs = {"CL": {"tic": 0.1, "r2": 0.9, "residual_mean": 0.0, "residual_std": 0.1, "gaussian_p": 0.0}}
    result = {"flights": ["first"], "model": {"name": "own"}, "refused": refused, "warnings": [GRAMS, "rpm: slow"],
              "validation": {"outputs": outputs, "acceptable": False}}  # fmt: skip
    lines = identification_text(result).splitlines()
    assert lines[:4] == [f"warning: {GRAMS}", "warning: rpm: slow", "", "flights: first"]
    assert sum("warning" in line for line in lines) == 2
    assert any(line.endswith("< 1e-300") for line in lines)


def test_a_discrepancy_begins_with_its_warnings() -> None:
    place = {"axis": "CL", "variable": "alpha", "share": 0.7, "p_value": 0.0}
    effect = {"name": "stall", "probability": 1.0, "parameters": {}}
    lines = discrepancy_text({"verdict": "none", "where": [place], "effects": [effect], "warnings": [GRAMS]}).split(
        "\n"
    )
    assert lines[0] == f"warning: {GRAMS}"
    assert "where: CL over alpha, share 0.7, p < 1e-300" in lines
    assert "effect stall, probability > 0.999" in lines


def test_a_set_says_what_to_do_and_what_was_ruled_out() -> None:
    other = {"name": "mass_error", "probability": 0.5}
    effect = {"name": "thrust_scale", "probability": 0.5, "alternatives": [other], "separating_manoeuvre": "weigh it"}
    gap = {"estimation": {"before": {"V": 2.0}, "after": {"V": 1.0}, "noise_floor": {"V": 1.0}}}
    result = {"verdict": "missing_effect", "effects": [effect], "gap": gap, "ruled_out": ["cg_shift"]}
    lines = discrepancy_text(result).split("\n")
    assert "  would distinguish them: weigh it" in lines
    assert "  ruled out beforehand: cg_shift" in lines
    assert any("--rule-out" in line for line in lines)
    assert any(line.split() == ["output", "before", "after", "noise_floor"] for line in lines)


def test_where_nothing_was_added_there_is_no_gap_after() -> None:
    gap = {"estimation": {"before": {"V": 2.0}, "after": {"V": 2.0}, "noise_floor": {"V": 1.0}}}
    lines = discrepancy_text({"verdict": "unexplained", "effects": [], "gap": gap}).split("\n")
    assert any(line.split() == ["output", "before", "noise_floor"] for line in lines)


def test_what_is_doubtful_in_the_vehicle_file_is_told_with_a_discrepancy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def found(*given: Any, **settings: Any) -> dict[str, Any]:
        return {"verdict": "none", "warnings": ["rpm: slow"]}

    craft = tmp_path / "own.toml"
    text = (BUILT_IN / "iitb-mav.toml").read_text(encoding="utf-8").split("[calibration", 1)[0]
    assert "\nmass = 1.0" in text
    craft.write_text(text.replace("\nmass = 1.0", "\nmass = 1000.0", 1), encoding="utf-8")
    monkeypatch.setattr("sysid.discrepancy.discrepancy", found)
    monkeypatch.setattr(postflight, "read_flights", lambda *given: [])
    result = postflight.discrepancy([], craft, BUILT_IN / "iitb-mav.model.json")
    assert "grams" in result["warnings"][0]
    assert result["warnings"][-1] == "rpm: slow"


@pytest.mark.parametrize(("value", "code", "said"), [
    ({"refused": "it was dark"}, 1, "gcs identify: no coefficient could be identified: it was dark\n"),
    ({"value": 0.1, "std": 0.01}, 0, ""),
])  # fmt: skip
def test_a_result_without_coefficients_is_written_all_the_same(
    value: dict[str, Any], code: int, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    coefficients = {"CL_0": {"refused": "it was dark"}, "CL_alpha": value}
    result = {"flights": ["first"], "model": {"name": "own", "coefficients": coefficients}}
    files = tmp_path / "result.json", tmp_path / "model.json"
    assert write_identification(result, *files, as_json=False, command="identify") == code
    shown = capsys.readouterr()
    assert shown.err == said
    assert "refused it was dark" in shown.out
    assert [json.loads(one.read_text(encoding="utf-8")) for one in files] == [result, result["model"]]
