"""Models drawn with a guessed inertia fly as the flight showed: modes by scipy, from each sample's own file."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs.exports import state_space
from gcs.exports.exported import Exported
from gcs.exports.samples import drawn
from sim_vehicle.model.model_file import Coefficient, Correlation, Model, read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle

COUNT = 200
GUESS = 0.5


def guessed() -> Exported:
    """A model whose pitching moments a flight knows to 1 %, of an aircraft whose Iyy is known to a half."""
    vehicle = load_vehicle("iitb-mav")
    vehicle = replace(vehicle, mass=replace(vehicle.mass, Iyy_std=GUESS * vehicle.mass.Iyy))
    entries = {}
    for name, value in read_model("iitb-mav").values().items():
        flight = 0.01 * abs(value) + 1e-5
        moved = {"Iyy_std": GUESS * value} if name.startswith("Cm") else {}
        entries[name] = Coefficient(
            value, math.hypot(flight, *moved.values()), extra={"systematic": moved, "statistical_std": flight}
        )
    names = tuple(entries)
    stds = np.array([entry.std for entry in entries.values()])
    shared = np.array([entry.extra["systematic"].get("Iyy_std", 0.0) for entry in entries.values()])
    covariance = np.outer(shared, shared)
    np.fill_diagonal(covariance, stds**2)
    matrix = covariance / np.outer(stds, stds)
    np.fill_diagonal(matrix, 1.0)
    rows = tuple(tuple(row) for row in ((matrix + matrix.T) / 2.0).tolist())
    return Exported(Model("guessed", entries, correlation=Correlation(names, rows)), vehicle)


def short_period(model: Exported, path: Path) -> tuple[float, float]:
    """Frequency and its standard error, Hz, as the export says."""
    state_space.write(model, path)
    modes = json.loads(path.read_text())["modes"]
    (found,) = [mode["frequency_hz"] for mode in modes if mode["name"] == "short period"]
    return found["value"], found["std"]


def test_drawn_models_have_the_inertia_that_goes_with_their_moments(tmp_path: Path) -> None:
    model = guessed()
    frequency, std = short_period(model, tmp_path / "mean.json")
    many = drawn(model, COUNT, seed=5)
    inertia = np.array([one.vehicle.mass.Iyy for one in many])
    slope = np.array([one.model.values()["Cm_alpha"] for one in many])
    assert np.std(np.log(inertia)) == pytest.approx(GUESS, rel=0.15)
    assert np.std(slope / inertia) / abs(np.mean(slope / inertia)) < 0.05
    scatter = np.std([short_period(one, tmp_path / f"{i}.json")[0] for i, one in enumerate(many)])
    assert std < 0.02 * frequency
    assert std == pytest.approx(scatter, rel=0.25)
