"""A plan of the next flight: what it promises, against a flight of it that goes through files and another seed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gcs.analysis.postflight import identify
from gcs.design.planned import planned
from sim_vehicle.cli.main import main as fly
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle


@pytest.mark.whole_flight
def test_a_plan_promises_what_the_estimator_with_priors_then_gives(tmp_path: Path) -> None:
    vehicle, model = load_vehicle("iitb-mav").path, tmp_path / "model.json"
    model.write_text(json.dumps(read_model("iitb-mav").to_json()))
    asked = {"manoeuvres": ["multisine"], "gusts": 0.3}
    bounds = {
        one["name"]: one["std"] for one in planned(vehicle, model, asked, lambda share, text: None)["coefficients"]
    }
    made = planned(vehicle, model, {**asked, "method": "map"}, lambda share, text: None)
    promised = {one["name"]: one["std"] for one in made["coefficients"]}
    assert made["method"] == "map"
    plan, flight = tmp_path / "plan.json", tmp_path / "flight.mcap"
    plan.write_text(made["files"]["plan.json"])
    arguments = ["--plan", str(plan), "--effect", "turbulence:sigma=0.3", "--seed", "11", "--record", str(flight)]
    assert fly(["fly", "--vehicle", "iitb-mav", *arguments]) == 0
    given = identify([flight], vehicle, method="map")["model"]["coefficients"]
    ratios = [given[name]["std"] / std for name, std in promised.items() if given.get(name, {}).get("std")]
    assert len(ratios) > 15
    assert 0.7 < sorted(ratios)[len(ratios) // 2] < 1.5
    assert sum(0.3 < ratio < 3.0 for ratio in ratios) >= 0.9 * len(ratios)
    # The bounds, which know the sensors, promise more of what a scale factor of a sensor moves.
    assert promised["CL_alpha"] > bounds["CL_alpha"]
