"""How the page calls a model: by its flight's file and what was found, run by node."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from gcs.text.meanings import meaning
from sysid.problem.model_structure import default_structure
from sysid.signals.record import SURFACES

MODULE = Path(__file__).resolve().parents[2] / "gcs" / "page" / "static" / "model" / "modeltitle.js"
PROGRAM = "import(process.argv[1]).then(m => console.log(m.modelTitle(JSON.parse(process.argv[2]))))"


@pytest.mark.parametrize(
    ("verdict", "effects", "told"),
    [
        (None, [], "calm.tlog, identified"),
        ("none", [], "calm.tlog, questioned: nothing missing"),
        ("parameter_error", [], "calm.tlog, coefficients corrected"),
        ("missing_effect", ["stall", "motor_lag"], "calm.tlog, stall and motor_lag added"),
        ("unexplained", [], "calm.tlog, questioned: unexplained, nothing added"),
    ],
)
def test_a_model_is_called_by_what_was_found(verdict: str | None, effects: list[str], told: str) -> None:
    model = {
        "flight_id": "20261123T061000Z-1",
        "flight_name": "calm.tlog",
        "kind": "discrepancy" if verdict else "identify",
        "name": "mine",
        "verdict": verdict,
        "effects": effects,
        "created_ns": 1_800_000_000_000_000_000,
    }
    command = ["node", "-e", PROGRAM, str(MODULE), json.dumps(model)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True)
    assert done.stdout.strip() == f"{told} 2027-01-15 08:00"


@pytest.mark.parametrize(
    ("alternatives", "told"), [([], "–"), ([{"name": "stall", "probability": 0.1}], "slow deceleration")]
)
def test_a_manoeuvre_separates_an_effect_only_from_another(alternatives: list[dict[str, Any]], told: str) -> None:
    effect = {"alternatives": alternatives, "separating_manoeuvre": "slow deceleration"}
    program = PROGRAM.replace("modelTitle", "separation")
    command = ["node", "-e", program, str(MODULE.with_name("discrepancy.js")), json.dumps(effect)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True)
    assert done.stdout.strip() == told


def test_the_page_says_of_a_coefficient_what_the_report_says() -> None:
    names = [
        *default_structure(SURFACES),
        "CD_CL",
        "Cm_alpha_de",
        "CL_alpha3",
        "CL_alphadot",
        "gyro_bias_p",
        "Cm_",
        "x",
    ]
    program = (
        "import(process.argv[1]).then(m => console.log(JSON.stringify(JSON.parse(process.argv[2]).map(m.meaning))))"
    )
    command = ["node", "-e", program, str(MODULE.with_name("meanings.js")), json.dumps(names)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True)
    assert json.loads(done.stdout) == [meaning(name) for name in names]
