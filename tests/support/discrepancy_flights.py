"""Two flights of the simulator in other processes and the discrepancy job over them by the command line.

The flights have the sensor errors of Table II, quantised pulses and the bench calibration's own errors.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from patience import PATIENCE_S

from sim_vehicle.model.model_file import Model, read_model

FIT = "multisine"
JUDGE = "elevator-3211,aileron-doublet,rudder-doublet"


def fly(path: Path, manoeuvres: str, seed: int, *more: str) -> None:
    command = [sys.executable, "-m", "sim_vehicle", "fly", "--manoeuvre", manoeuvres, "--seed", str(seed)]
    subprocess.run([*command, "--record", str(path), *more], check=True, capture_output=True, timeout=PATIENCE_S)


def baseline(seed: int, share: float) -> Model:
    """The built-in model with every coefficient off by up to `share`."""
    model = read_model("iitb-mav")
    generator = np.random.default_rng(seed)
    for name, value in model.values().items():
        model = model.with_coefficient(name, value * (1.0 + share * generator.uniform(-1.0, 1.0)))
    return model


def run_discrepancy(
    folder: Path, seed: int, share: float, *effect: str, fit_s: float = 14.0, validate: bool = True
) -> dict[str, Any]:
    """Fly once, for `fit_s` seconds, or twice to validate; compare with a baseline by the command line.

    The model that the command writes is flown as well.
    """
    fit, judge, model, repaired = (folder / name for name in ("fit.mcap", "judge.mcap", "base.json", "new.json"))
    fly(fit, FIT, seed, "--set", "manoeuvre.amplitude=0.025", "--duration", f"{fit_s}", *effect)
    if validate:
        fly(judge, JUDGE, seed + 1, *effect)
    baseline(seed, share).write(model)
    before = model.read_bytes()
    command = [sys.executable, "-m", "gcs", "discrepancy", str(fit), "--vehicle", "iitb-mav", "--model", str(model)]
    command += ["--validate", str(judge)] if validate else []
    command += ["--json", "--write-model", str(repaired)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stderr
    assert model.read_bytes() == before
    fly(folder / "again.mcap", "cruise", seed, "--duration", "2", "--model", str(repaired))
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def over_floor(gap: dict[str, dict[str, float]], stage: str) -> float:
    """Root mean square over the outputs of gap / noise floor."""
    ratios = [gap[stage][name] / floor for name, floor in gap["noise_floor"].items() if floor > 0.0]
    return float(np.sqrt(np.mean(np.square(ratios))))
