"""A hidden effect is named, added, and closes the gap on a flight nothing was fitted to; none is named where none is.


The effect is flown in another process, with other seeds, the sensor errors of Table II, quantised pulses and the bench
calibration's own errors; the baseline model handed in is wrong by up to 10 % in every coefficient.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim_vehicle.model import Model, read_model

FIT = "multisine"
JUDGE = "elevator-3211,aileron-doublet,rudder-doublet"


def fly(path: Path, manoeuvres: str, seed: int, *more: str) -> None:
    command = [sys.executable, "-m", "sim_vehicle", "fly", "--manoeuvre", manoeuvres, "--seed", str(seed)]
    subprocess.run([*command, "--record", str(path), *more], check=True, capture_output=True, timeout=120)


def baseline(seed: int, share: float) -> Model:
    """The built-in model with every coefficient off by up to `share`."""
    model = read_model("iitb-mav")
    generator = np.random.default_rng(seed)
    for name, value in model.values().items():
        model = model.with_coefficient(name, value * (1.0 + share * generator.uniform(-1.0, 1.0)))
    return model


def run_discrepancy(folder: Path, seed: int, share: float, *effect: str) -> dict[str, Any]:
    """Fly twice, compare with a baseline by the command line, fly the model it writes."""
    fit, judge, model, repaired = (folder / name for name in ("fit.mcap", "judge.mcap", "base.json", "new.json"))
    fly(fit, FIT, seed, "--set", "manoeuvre.amplitude=0.025", *effect)
    fly(judge, JUDGE, seed + 1, *effect)
    baseline(seed, share).write(model)
    before = model.read_bytes()
    command = [sys.executable, "-m", "gcs", "discrepancy", str(fit), "--vehicle", "iitb-mav", "--model", str(model)]
    command += ["--validate", str(judge), "--json", "--write-model", str(repaired)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=280, check=False)
    assert done.returncode == 0, done.stderr
    assert model.read_bytes() == before
    fly(folder / "again.mcap", "cruise", seed, "--duration", "2", "--model", str(repaired))
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def over_floor(gap: dict[str, dict[str, float]], stage: str) -> float:
    """Root mean square over the outputs of gap / noise floor."""
    ratios = [gap[stage][name] / floor for name, floor in gap["noise_floor"].items() if floor > 0.0]
    return float(np.sqrt(np.mean(np.square(ratios))))


@pytest.mark.parametrize(
    ("effect", "parameter", "hidden", "seed"),
    [
        ("pitch_damping", "Cm_q", -5.0, 11),
        ("actuator_lag", "tau", 0.04, 12),
        ("thrust_line_offset", "z_T", 0.02, 13),
    ],
)
def test_a_hidden_effect_is_named_and_closes_the_gap(
    tmp_path: Path, effect: str, parameter: str, hidden: float, seed: int
) -> None:
    found = run_discrepancy(tmp_path, seed, 0.1, "--effect", f"{effect}:{parameter}={hidden}")
    assert found["verdict"] == "missing_effect", found["reasons"]
    first = found["effects"][0]
    assert first["name"] == effect
    assert first["probability"] > 0.9
    estimate = first["parameters"][parameter]
    # Five per cent, not a few standard errors: the bench calibration's own error is on top of the statistical one.
    assert estimate["value"] == pytest.approx(hidden, rel=0.05)
    assert 0.0 < estimate["std"] < 0.05 * abs(hidden)
    gap = found["gap"]["validation"]
    assert over_floor(gap, "after") < 1.3
    assert over_floor(gap, "before") > 1.3 * over_floor(gap, "after")
    assert over_floor(gap, "given") > 1.3 * over_floor(gap, "after")
    assert found["where"], "the disagreement has a place"
    written = json.loads((tmp_path / "new.json").read_text(encoding="utf-8"))
    assert written == found["model"]


def test_where_nothing_is_missing_nothing_is_named(tmp_path: Path) -> None:
    found = run_discrepancy(tmp_path, 14, 0.0)
    assert found["verdict"] == "none", found["reasons"]
    assert found["effects"] == []
    assert over_floor(found["gap"]["validation"], "given") < 1.3


def test_wrong_coefficients_are_no_missing_effect(tmp_path: Path) -> None:
    found = run_discrepancy(tmp_path, 15, 0.1)
    assert found["verdict"] == "parameter_error", found["reasons"]
    assert found["effects"] == []
    assert over_floor(found["gap"]["validation"], "after") < 1.3


def test_turbulence_is_no_missing_effect(tmp_path: Path) -> None:
    found = run_discrepancy(tmp_path, 22, 0.0, "--effect", "turbulence:sigma=0.3")
    assert found["verdict"] in ("none", "parameter_error"), found["reasons"]
    assert found["effects"] == []
    assert 0.15 < found["turbulence"] < 0.6


def test_what_no_effect_of_the_catalogue_is_stays_unexplained(tmp_path: Path) -> None:
    """A pitch gyro that lags: the kinematics take it for turbulence, but the floor of sensors and gusts does not."""
    found = run_discrepancy(tmp_path, 23, 0.0, "--set", "sensors.q.lag=0.05")
    assert found["verdict"] == "unexplained", found["reasons"]
    assert found["effects"] == []
