"""What an FMU's file holds; FMPy flies it in tests/interop."""

from __future__ import annotations

import shutil
import zipfile
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from gcs.cli import main
from gcs.errors import ExportError
from gcs.exports import fmu
from gcs.exports.exported import Exported
from sim_vehicle.effects import parse_effect
from sim_vehicle.model.model_file import Coefficient, read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle


def test_it_says_every_variable_with_unit_start_and_error(tmp_path: Path) -> None:
    model = read_model("iitb-mav")
    entries = {**model.coefficients, "CL_alpha": Coefficient(2.5, 0.05), "CY_p": Coefficient(None, refused="no roll")}
    notes = fmu.write(Exported(replace(model, coefficients=entries), load_vehicle("iitb-mav")), tmp_path / "a.fmu")
    assert "refused, taken as 0: CY_p" in notes
    with zipfile.ZipFile(tmp_path / "a.fmu") as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
        held = set(archive.namelist())
        assert b"CL_alpha" in archive.read("documentation/index.html")
    assert {"sources/aircraft.c", "sources/model.h"} < held
    variables = {one.get("name"): one for one in root.iter("ScalarVariable")}
    assert "CY_p" not in variables
    lift = variables["CL_alpha"]
    assert "standard error 0.05" in lift.get("description", "")
    real = lift.find("Real")
    assert real is not None
    assert real.get("start") == "2.5"
    units = {one.get("name") for one in root.iter("Unit")}
    assert {one.get("unit") for one in root.iter("Real")} - {None} <= units


def test_without_a_compiler_it_holds_the_sources_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    notes = fmu.write(Exported(read_model("iitb-mav"), load_vehicle("iitb-mav")), tmp_path / "a.fmu")
    assert any("there is no C compiler here" in note for note in notes)
    with zipfile.ZipFile(tmp_path / "a.fmu") as archive:
        assert not [name for name in archive.namelist() if name.startswith("binaries/")]


def test_what_it_cannot_hold_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name, values = parse_effect("servo_deadband:width=0.01")
    model, vehicle = read_model("iitb-mav"), load_vehicle("iitb-mav")
    with pytest.raises(ExportError, match="an FMU does not hold the effect servo_deadband"):
        fmu.write(Exported(model.with_effect(name, values), vehicle), tmp_path / "a.fmu")
    with pytest.raises(ExportError, match="nothing gives thrust by the throttle"):
        fmu.write(Exported(model, replace(vehicle, propulsion=None)), tmp_path / "a.fmu")
    place = tmp_path / "none" / "a.fmu"
    assert main(["export-model", "iitb-mav", "--vehicle", "iitb-mav", "--to", "fmu", "-o", str(place)]) == 2
    assert "could not be written: No such file or directory" in capsys.readouterr().err
