"""The example of docs/howto/design.md: its commands run as they stand, and its flight keeps what was promised."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from own_bars import own_bar

from gcs.cli import build_parser
from gcs.cli import main as gcs
from sim_vehicle.cli.main import main as sim_vehicle

PAGE = Path(__file__).resolve().parents[2] / "docs" / "howto" / "design.md"
PROGRAMS = {"gcs": gcs, "sim-vehicle": sim_vehicle}


def test_the_flight_of_the_example_keeps_what_the_design_promised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    commands = re.findall(r"^((?:gcs|sim-vehicle) .+)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(commands) == 6
    example, others = commands[:3], commands[3:]
    for command in example:
        program, *arguments = shlex.split(command)
        assert PROGRAMS[program](arguments) == 0, command
    for command in others:
        assert build_parser().parse_args(shlex.split(command)[1:]).command == "design"
    promised = {entry["name"]: entry for entry in json.loads(Path("plan.json").read_text())["design"]["coefficients"]}
    found = json.loads(Path("result.json").read_text())["model"]["coefficients"]
    assert len(promised) == 28
    ratios = {name: own_bar(found[name]) / entry["std"] for name, entry in promised.items()}
    for name, ratio in ratios.items():
        assert 0.9 < ratio < (1.4 if name in ("CL_0", "Cm_0") else 1.1), name
    misses = [(found[name]["value"] - entry["value"]) / entry["std"] for name, entry in promised.items()]
    assert np.sqrt(np.mean(np.square(misses))) < 2.0
    assert Path("plan.csv").read_text().count("\n") == 1002
    assert "SRV_Channels:set_output_pwm_chan_timeout" in Path("plan.lua").read_text()
