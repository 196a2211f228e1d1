"""Two flights of the simulator and the discrepancy job over them by the command line.

The flights have the sensor errors of Table II, quantised pulses and the bench calibration's own errors.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from processes import run

from sim_vehicle.model.model_file import Model, read_model

FIT = "multisine"
JUDGE = "elevator-3211,aileron-doublet,rudder-doublet"


def fly(path: Path, manoeuvres: str, seed: int, *more: str) -> None:
    done = run("sim-vehicle", "fly", "--manoeuvre", manoeuvres, "--seed", seed, "--record", path, *more)
    assert done.returncode == 0, done.stderr


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
    judged = ["--validate", judge] if validate else []
    done = run("gcs", "discrepancy", fit, "--vehicle", "iitb-mav", "--model", model, *judged, "--json",
               "--write-model", repaired)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert model.read_bytes() == before
    fly(folder / "again.mcap", "cruise", seed, "--duration", "2", "--model", str(repaired))
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def over_floor(gap: dict[str, dict[str, float]], stage: str) -> float:
    """Root mean square over the outputs of gap / noise floor."""
    ratios = [gap[stage][name] / floor for name, floor in gap["noise_floor"].items() if floor > 0.0]
    return float(np.sqrt(np.mean(np.square(ratios))))
