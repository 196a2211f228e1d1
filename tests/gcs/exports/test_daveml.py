"""DAVE-ML, read with libSBML's MathML: the sums, the check cases, the errors and how they hang together."""

from __future__ import annotations

import itertools
from pathlib import Path
from xml.etree import ElementTree

import libsbml
import numpy as np
import pytest

from gcs.cli import main
from gcs.errors import ExportError
from gcs.exports import daveml
from gcs.exports.exported import Exported
from sim_vehicle.effects import parse_effect
from sim_vehicle.model.aerodynamic_terms import AXES
from sim_vehicle.model.model_file import Coefficient, Correlation, Model, read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle

DML = f"{{{daveml.NAMESPACE}}}"
MATH = f"{{{daveml.MATHML}}}"
# Order of the standard: description, calculation, what it is to the model, uncertainty.
ORDER = ("description", "calculation", "isInput", "isOutput", "uncertainty")


def estimated() -> Exported:
    """Terms of all kinds, errors with correlations, one coefficient that was refused with its mean."""
    model = read_model("iitb-mav")
    for name, value in {
        "Cm_q": -5.0,
        "CL_alphadot": 1.2,
        "CL_alpha3": -2.0,
        "Cm_alpha_de": 0.3,
        "CD_CL": 0.02,
        "CD_k": 0.4,
    }.items():
        model = model.with_coefficient(name, value)
    entries = {name: Coefficient(value, 0.03 * abs(value) + 1e-4) for name, value in model.values().items()}
    entries["Cn_da"] = Coefficient(None, refused="the aileron did not move", mean=-0.004, mean_std=0.01)
    names = tuple(entries)
    mixed = np.random.default_rng(3).normal(size=(len(names), 2 * len(names)))
    matrix = np.corrcoef(mixed).round(9)
    rows = tuple(tuple(row) for row in ((matrix + matrix.T) / 2.0).tolist())
    return Exported(Model(model.name, entries, (), {}, Correlation(names, rows)), load_vehicle("iitb-mav"))


def written(model: Exported, folder: Path) -> ElementTree.Element:
    daveml.write(model, folder / "a.dml")
    return ElementTree.parse(folder / "a.dml").getroot()


def totals(root: ElementTree.Element, inputs: dict[str, float]) -> dict[str, float]:
    """What the file's calculations come to, in its own order, by libSBML."""
    document = libsbml.SBMLDocument(3, 1)
    known = document.createModel()
    values = dict(inputs)
    for one in root.iter(f"{DML}variableDef"):
        key = one.get("varID")
        assert key is not None
        formula = one.find(f"{DML}calculation/{MATH}math")
        if formula is not None:
            read = libsbml.readMathMLFromString(ElementTree.tostring(formula, encoding="unicode"))
            assert read is not None
            values[key] = libsbml.SBMLTransforms.evaluateASTNode(read, known)
        elif one.get("initialValue"):
            values[key] = float(one.get("initialValue", ""))
        kept = known.createParameter()
        kept.setId(key)
        kept.setValue(values[key])
        libsbml.SBMLTransforms.mapComponentValues(known)
    return {axis: values[axis] for axis in AXES}


def test_another_reader_of_mathml_comes_to_the_check_cases_and_to_the_model(tmp_path: Path) -> None:
    model = estimated()
    root = written(model, tmp_path)
    ids = {one.get("name"): one.get("varID", "") for one in root.iter(f"{DML}variableDef")}
    shots = root.findall(f"{DML}checkData/{DML}staticShot")
    assert len(shots) >= 3
    moved = 0.0
    for shot in shots:
        given, wanted = (
            {ids[one.findtext(f"{DML}signalName")]: float(one.findtext(f"{DML}signalValue", "")) for one in side}
            for side in (shot.find(f"{DML}checkInputs"), shot.find(f"{DML}checkOutputs"))
            if side is not None
        )
        found = totals(root, given)
        assert found == pytest.approx(wanted, abs=1e-9)
        # By the textbook's sums, written here term by term for two axes.
        flown, size, V = model.model.flown(), model.vehicle.geometry, given["V"]
        rates = {key: given[key] * length / 2.0 / V for key, length in (("q", size.c), ("p", size.b), ("r", size.b))}
        pitch = (
            flown.get("Cm_0", 0.0) + flown["Cm_alpha"] * given["alpha"] + flown["Cm_de"] * given["de"]
            + flown["Cm_alpha_de"] * given["alpha"] * given["de"] + flown.get("Cm_q", 0.0) * rates["q"]
        )  # fmt: skip
        assert found["Cm"] == pytest.approx(pitch, abs=1e-12)
        yaw = sum(
            flown.get(f"Cn_{key}", 0.0) * value
            for key, value in {"0": 1.0, "beta": given["beta"], "p": rates["p"], "r": rates["r"], "da": given["da"],
                               "dr": given["dr"]}.items()
        )  # fmt: skip
        assert found["Cn"] == pytest.approx(yaw, abs=1e-12)
        moved = max(moved, abs(found["Cm"]))
    assert moved > 0.01


def test_the_errors_and_their_correlations_are_those_of_the_model(tmp_path: Path) -> None:
    model = estimated()
    root = written(model, tmp_path)
    laws = {
        one.get("varID", ""): one.find(f"{DML}uncertainty/{DML}normalPDF") for one in root.iter(f"{DML}variableDef")
    }
    known = {name: law for name, law in laws.items() if law is not None}
    assert set(known) == set(model.model.coefficients)
    correlation = model.model.correlation
    assert correlation is not None
    for name, law in known.items():
        entry = model.model.coefficients[name]
        assert float(law.findtext(f"{DML}bounds", "")) == entry.flown_std
        assert law.get("numSigmas") == "1"
    names = list(known)
    for a, b in itertools.combinations(names, 2):
        assert b in [one.get("varID") for one in known[a].findall(f"{DML}correlatesWith")]
        (share,) = (one for one in known[b].findall(f"{DML}correlation") if one.get("varID") == a)
        wanted = correlation.matrix[correlation.names.index(a)][correlation.names.index(b)]
        assert float(share.get("corrCoef", "")) == pytest.approx(wanted, abs=1e-6)
    (refused,) = (one for one in root.iter(f"{DML}variableDef") if one.get("varID") == "Cn_da")
    assert "not identified" in refused.findtext(f"{DML}description", "")


def test_elements_stand_as_the_standard_orders_them_and_names_are_used_once(tmp_path: Path) -> None:
    root = written(estimated(), tmp_path)
    assert [one.tag for one in root if one.tag != f"{DML}variableDef"] == [f"{DML}fileHeader", f"{DML}checkData"]
    keys = [one.get("varID") for one in root.iter(f"{DML}variableDef")]
    names = [one.get("name") for one in root.iter(f"{DML}variableDef")]
    assert len(set(keys)) == len(keys)
    assert len(set(names)) == len(names)
    for one in root.iter(f"{DML}variableDef"):
        places = [ORDER.index(child.tag.removeprefix(DML)) for child in one]
        assert places == sorted(places)
    # What a formula names was defined before it.
    defined: set[str] = set()
    for one in root.iter(f"{DML}variableDef"):
        used = {(name.text or "").strip() for name in one.iter(f"{MATH}ci")}
        assert used <= defined
        defined.add(one.get("varID", ""))


def test_what_it_does_not_hold_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = estimated()
    effect, values = parse_effect("thrust_line_offset:z_T=0.02")
    crooked = Exported(model.model.with_effect(effect, values, {"z_T": 0.002}), model.vehicle)
    with pytest.raises(ExportError, match="DAVE-ML does not hold the effect thrust_line_offset"):
        daveml.write(crooked, tmp_path / "b.dml")
    assert (
        main(["export-model", "iitb-mav", "--vehicle", "iitb-mav", "--to", "daveml", "-o", str(tmp_path / "c.dml")])
        == 0
    )
    said = capsys.readouterr().err
    assert "thrust" in said
    assert "correlations" in said
