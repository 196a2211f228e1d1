"""`gcs design`: the plan it writes is flown as designed; wrong use is told in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gcs.cli import main
from gcs.flights.signals import extract
from gcs.recording.reader import Recording
from sim_vehicle.cli.main import main as fly
from sim_vehicle.manoeuvres.plan import read_plan
from sim_vehicle.manoeuvres.plan_ticks import Schedule
from sim_vehicle.vehicle.vehicle_file import load_vehicle

AIRCRAFT = ["--vehicle", "iitb-mav", "--model", "iitb-mav"]


@pytest.mark.whole_flight
def test_the_plan_is_flown_as_it_was_designed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan, flight = tmp_path / "plan.json", tmp_path / "flight.mcap"
    arguments = [*AIRCRAFT, "--manoeuvre", "rudder-doublet", "--tune", "--limit", "beta=3", "-o", str(plan), "--json"]
    assert main(["design", *arguments]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["schema"] == "design/1"
    told = {entry["name"]: entry for entry in result["coefficients"]}
    refused = {entry["name"] for entry in result["refused"]}
    assert {"Cn_beta", "Cn_dr"} <= set(told)
    assert {"CL_alpha", "Cm_de"} <= refused
    assert told["Cn_beta"]["percent"] == pytest.approx(100.0 * told["Cn_beta"]["std"] / 0.08)
    assert max(np.abs(result["excursions"]["beta"])) < np.radians(3.0)
    written = json.loads(plan.read_text())
    assert written["design"]["coefficients"] == result["coefficients"]
    assert "plan" not in written["design"]
    assert fly(["fly", "--vehicle", "iitb-mav", "--plan", str(plan), "--record", str(flight)]) == 0
    vehicle = load_vehicle("iitb-mav")
    servo = extract(Recording(flight), vehicle).signals["servo4"].values
    asked = Schedule(read_plan(plan), 0.02).increments[:, 2]
    # The bank hold of the simulator's autopilot keeps hold of the aileron alone: the rudder moves as planned.
    assert np.ptp(vehicle.controls["rudder"].deflection_from_pwm(servo)) == pytest.approx(np.ptp(asked), abs=0.004)


def test_a_plan_file_is_predicted_as_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = tmp_path / "plan.json"
    plan.write_text(json.dumps({"schema": "plan/1", "segments": [{"manoeuvre": "elevator-doublet"}]}))
    assert main(["design", *AIRCRAFT, "--plan", str(plan), "--set", "manoeuvre.amplitude=0.02"]) == 0
    text = capsys.readouterr().out
    assert "elevator-doublet: 10 s, 1.15 deg" in text
    assert "refused: Cl_da: the surfaces that would excite it do not move; fly the manoeuvre aileron-multisine" in text
    assert "CL_alpha" in text


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--limit", "gamma=3"], 2, "alpha, beta, bank"),
        (["--limit", "alpha=-3"], 2, "--limit alpha=-3"),
        (["--rate", "1"], 2, "--rate 1"),
        (["--duration", "1"], 2, "--duration 1"),
        (["--gusts", "-1"], 2, "--gusts -1"),
        (["--manoeuvre", "loop"], 2, "no manoeuvre 'loop'"),
        (["--set", "sensors.ax=1"], 2, "vehicle file"),
        (["--set", "manoeuvre.amplitude=1"], 2, "leave out --tune"),
        (["--plan", "none.json"], 1, "none.json: cannot read the plan"),
        (["--plan", "none.json", "--tune"], 2, "not both"),
        (["--compare", "a"], 2, "--compare a"),
        (["-o", "no/such/folder/plan.json"], 2, "no existing folder"),
        (["--set", "flight.airspeed=60"], 1, "airspeed|steady flight"),
    ],
)
def test_wrong_use_is_one_line(arguments: list[str], code: int, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["design", *AIRCRAFT, *arguments]) == code
    error = capsys.readouterr().err
    assert error.count("\n") == 1, error
    assert any(word in error for word in words.split("|")), error


def test_a_model_with_gaps_demands_values(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = tmp_path / "model.json"
    model.write_text(json.dumps({"schema": "model/1", "name": "m", "coefficients": {"CL_q": {"refused": "too quiet"}}}))
    assert main(["design", "--vehicle", "iitb-mav", "--model", str(model)]) == 2
    assert "--set CL_q=VALUE" in capsys.readouterr().err
