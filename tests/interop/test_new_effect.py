"""An effect that the catalogue lacks is added by one file and its entry: flown, fitted, named and worded.

The packages are copied, since places in the arrays of compiled code are made when they are imported.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILE = '''"""Low-pass filter of the rate gyros."""

from sim_vehicle.effects.base import Effect, Parameter, Remembers, Stage

GYRO_LAG = Effect(
    "gyro_lag",
    "lag of the rate gyros",
    Stage.SENSOR,
    (Parameter("tau", "s", 0.001, 0.3, starts=(0.03,)),),
    "a rate table",
    memory=Remembers.LAG,
    outputs=("p", "q", "r"),
    phrase="the rate gyros lag by {tau:ms}",
)
'''
ENTRY = "        sensor.ATTITUDE_LAG,\n"
JOB = """
import json
from simulated import fly_mav
from sim_vehicle.model.model_file import read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle
from sysid.discrepancy import discrepancy

flight = fly_mav("multisine", 5, duration=10.0, effects=("gyro_lag:tau=0.04",))[0]
print(json.dumps(discrepancy([flight], load_vehicle("iitb-mav"), read_model("iitb-mav"), method="fe")))
"""


@pytest.mark.whole_flight
def test_an_effect_with_memory_is_one_file_and_its_entry(tmp_path: Path) -> None:
    for package in ("sim_vehicle", "sysid"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    folder = tmp_path / "sim_vehicle" / "effects"
    (folder / "gyro_lag.py").write_text(FILE, encoding="utf-8")
    catalogue = (folder / "__init__.py").read_text(encoding="utf-8")
    assert catalogue.count(ENTRY) == 1
    catalogue = catalogue.replace(ENTRY, f"{ENTRY}        gyro_lag.GYRO_LAG,\n")
    catalogue = catalogue.replace("    inertia,\n", "    gyro_lag,\n    inertia,\n", 1)
    (folder / "__init__.py").write_text(catalogue, encoding="utf-8")
    path = os.pathsep.join((str(tmp_path), str(ROOT / "tests" / "support")))
    there = {**os.environ, "PYTHONPATH": path, "XDG_CACHE_HOME": str(tmp_path)}
    told = subprocess.run(
        [sys.executable, "-c", JOB], cwd=tmp_path, env=there, check=True, capture_output=True, text=True, timeout=550
    )
    found = json.loads(told.stdout)
    assert found["verdict"] == "missing_effect", found["reasons"]
    assert [one["name"] for one in found["effects"]] == ["gyro_lag"]
    tau = found["effects"][0]["parameters"]["tau"]
    assert abs(tau["value"] - 0.04) < 4.0 * tau["std"] < 0.01
    assert found["sentence"].startswith(f"The rate gyros lag by {1e3 * tau['value']:.1f} ms")
