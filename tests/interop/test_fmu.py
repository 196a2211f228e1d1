"""Exported FMUs in FMPy: its validation, its compiler, and the flight that it flies against the simulator's."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_flights import EFFECTS, SECONDS, SHARE, STATES, STEP, Array, commands, craft, flown_here, shares
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu

from gcs.exports import fmu
from gcs.exports.exported import Exported
from sim_vehicle.effects import parse_effect
from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.vehicle_file import Vehicle

INPUTS = ("de", "da", "dr", "throttle")


def slave(path: Path, folder: Path) -> tuple[FMU2Slave, dict[str, int]]:
    """The FMU before its initialisation, and its value references."""
    described = read_model_description(str(path))
    assert described.coSimulation is not None
    one = FMU2Slave(
        guid=described.guid, unzipDirectory=extract(str(path), str(folder)), instanceName="flight",
        modelIdentifier=described.coSimulation.modelIdentifier,
    )  # fmt: skip
    one.instantiate()
    one.setupExperiment(startTime=0.0)
    return one, {variable.name: variable.valueReference for variable in described.modelVariables}


def flown_there(path: Path, folder: Path, trim: Array) -> Array:
    """(N, 10) STATES of the FMU, from its own trimmed start."""
    one, places = slave(path, folder)
    inputs, shown = [places[name] for name in INPUTS], [places["down" if n == "altitude" else n] for n in STATES]
    one.enterInitializationMode()
    one.exitInitializationMode()
    rows = [one.getReal(shown)]
    for step, held in enumerate(commands(trim, (np.arange(round(SECONDS / STEP)) + 0.5) * STEP)):
        one.setReal(inputs, [float(value) for value in held])
        one.doStep(currentCommunicationPoint=step * STEP, communicationStepSize=STEP)
        rows.append(one.getReal(shown))
    one.terminate()
    one.freeInstance()
    flown = np.array(rows)
    flown[:, -1] *= -1.0
    return flown


def flown_both(folder: Path, vehicle: Vehicle, model: Model) -> dict[str, float]:
    here, _, trim = flown_here(vehicle, model)
    path = folder / "aircraft.fmu"
    fmu.write(Exported(model, vehicle), path)
    # Both begin at the height at which they were trimmed.
    there = flown_there(path, folder / "open", trim)
    there[:, -1] += here[0, -1] - there[0, -1]
    return shares(here, there)


@pytest.mark.parametrize("name", ["iitb-mav", "ultrastick25e", "aerosonde"])
def test_the_fmu_flies_what_the_simulator_flies(name: str, tmp_path: Path) -> None:
    """The second and third have propellers by CT and CQ, the second alphadot and a motor that lags too."""
    off = flown_both(tmp_path, *craft(name))
    assert max(off.values()) < SHARE, off


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_goes_along(effect: str, tmp_path: Path) -> None:
    vehicle, model = craft("iitb-mav")
    name, values = parse_effect(effect)
    off = flown_both(tmp_path, vehicle, model.with_effect(name, values))
    assert max(off.values()) < SHARE, off


def test_it_is_valid_and_compiles_elsewhere_and_keeps_its_state(tmp_path: Path) -> None:
    vehicle, model = craft("ultrastick25e")
    path, bare = tmp_path / "aircraft.fmu", tmp_path / "sources.fmu"
    fmu.write(Exported(model, vehicle), path)
    assert validate_fmu(str(path)) == []
    # Without the library of this machine: FMPy's own compilation.
    with zipfile.ZipFile(path) as whole, zipfile.ZipFile(bare, "w") as less:
        for entry in whole.namelist():
            if not entry.startswith("binaries/"):
                less.writestr(entry, whole.read(entry))
    there = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}  # its cmake
    subprocess.run([sys.executable, "-m", "fmpy", "compile", str(bare)], check=True, env=there, timeout=300)
    asked: dict[str, Any] = {"stop_time": 2.0, "output_interval": 0.02, "output": ["V", "theta", "down"]}
    flown = [simulate_fmu(str(one), **asked) for one in (path, bare)]
    for name in asked["output"]:
        assert np.allclose(flown[0][name], flown[1][name], rtol=1e-9)
    # Trimmed, nothing moves; started faster, it climbs.
    assert np.ptp(flown[0]["theta"]) < 1e-3
    faster = simulate_fmu(str(path), start_values={"start.u": 1.2 * vehicle.flight.airspeed}, **asked)
    assert faster["down"][-1] < flown[0]["down"][-1] - 1.0
    one, places = slave(path, tmp_path / "open")
    one.enterInitializationMode()
    one.exitInitializationMode()
    kept = one.serializeFMUState(one.getFMUState())
    one.setReal([places["de"]], [-0.1])
    one.doStep(0.0, 0.5)
    first = one.getReal([places["theta"]])
    one.setFMUState(one.deSerializeFMUstate(kept))
    one.setReal([places["de"]], [-0.1])
    one.doStep(0.0, 0.5)
    assert one.getReal([places["theta"]]) == first
    one.freeInstance()
