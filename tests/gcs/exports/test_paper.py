"""Figures, data and tables for a paper, of results that the package makes itself."""

from __future__ import annotations

import csv
import json
import re
from io import StringIO
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from gcs.cli import main
from gcs.exports.tables import latex_side_by_side
from gcs.report.side_by_side import headings

pytestmark = pytest.mark.whole_flight


def result() -> dict[str, Any]:
    """A small result of an identification with everything that a figure is made of."""
    axes = {
        axis: {"time_s": [0.0, 0.1, 0.2], "measured": [0.1, 0.2, 0.3], "predicted": [0.11, 0.19, 0.3],
               "alpha": [0.01, 0.02, 0.03]}
        for axis in ("CL", "Cm")
    }  # fmt: skip
    residual = {"autocorrelation": [1.0, 0.2, -0.1], "lag_step_s": 0.1, "limit": 0.3, "mean": 0.0, "std": 0.01,
                "histogram": {"low": -0.02, "high": 0.02, "counts": [1, 2]}}  # fmt: skip
    response = {"input": "de", "output": "q", "frequency_hz": [0.1, 1.0], "gain_db": [3.0, 1.0],
                "gain_std_db": [0.1, 0.2], "phase_rad": [0.0, -1.0], "phase_std_rad": [0.01, 0.02],
                "measured": {"frequency_hz": [0.5, 2.0], "gain_db": [2.1, 9.0], "gain_std_db": [0.3, 5.0],
                             "phase_rad": [-0.5 - 6.2831853, 2.0], "phase_std_rad": [0.05, 1.0],
                             "coherence": [0.95, 0.2]}}  # fmt: skip
    simulated = {"flight": "first", "time_s": [0.0, 0.1, 0.2],
                 "inputs": {"de": [0.0, 0.1, 0.0], "da": [0.0] * 3, "dr": [0.0] * 3, "thrust": [2.0, 2.1, 2.0]},
                 "outputs": {"V": {"measured": [15.0, 15.1, 15.2], "model": [15.0, 15.05, None]}}}  # fmt: skip
    model = {
        "schema": "model/1", "name": "mine", "effects": [], "validity": {},
        "coefficients": {"CL_alpha": {"value": 4.5, "std": 0.12}, "Cm_q": {"value": -9.5, "std": 1.5}},
        "correlation": {"names": ["CL_alpha", "Cm_q"], "matrix": [[1.0, 0.3], [0.3, 1.0]]},
    }  # fmt: skip
    mode = {"name": "short_period", "eigenvalue": [-2.0, 8.0], "frequency_hz": {"value": 1.3, "std": 0.02},
            "damping_ratio": {"value": 0.24, "std": 0.01}, "time_constant_s": {"value": 0.5, "std": 0.1}}  # fmt: skip
    return {
        "schema": "identification/1", "flights": ["first"], "model": model, "modes": [mode],
        "frequency_responses": [response],
        "series": {
            "use": "estimation", "simulated": [simulated], "flights": [{"flight": "first", "axes": axes}],
            "residuals": {"CL": residual},
        },
    }  # fmt: skip


def of_few_figures() -> dict[str, Any]:
    """The same without what most figures are made of: drawing them is what takes long."""
    small = result()
    del small["model"]["correlation"], small["series"]["residuals"]["CL"], small["series"]["flights"][0]["axes"]["CL"]
    return small


def test_a_folder_for_a_paper(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, folder = tmp_path / "result.json", tmp_path / "paper"
    file.write_text(json.dumps(result()))
    assert main(["report", str(file), "--paper", str(folder)]) == 0, capsys.readouterr().err
    captions = re.findall(r"^\*\*(.+?)\*\*: (.+)\.$", (folder / "captions.md").read_text(), re.MULTILINE)
    names = [name for name, _ in captions]
    assert names == ["correlation", "history0", "fit0", "residual0", "alpha0", "acf", "histogram", "bode-de"]
    assert all(len(words) > 20 for _, words in captions)
    for name in names:
        picture = ElementTree.parse(folder / f"{name}.svg").getroot()
        # Journals take 180 mm across; letters stay letters.
        assert float(picture.attrib["width"].removesuffix("pt")) <= 7.5 * 72.0
        assert picture.find(".//{http://www.w3.org/2000/svg}text") is not None
        assert (folder / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    fit = list(csv.reader((folder / "fit0.csv").read_text().splitlines()))
    assert ["2 $C_{m}$", "predicted", "0.1", "0.19"] in fit
    band = [row for row in csv.reader((folder / "bode-de.csv").read_text().splitlines()) if row[1] == "band"]
    assert {row[0] for row in band} == {"1 q / de", "2 phase, deg"}
    shown = [row[-2:] for row in csv.reader((folder / "bode-de.csv").read_text().splitlines())]
    # What hangs together with the input, in the turn that the model's phase is in; the rest as coherence alone.
    assert ["0.5", "2.1"] in shown
    assert ["2.0", "9.0"] not in shown
    assert any(x == "0.5" and abs(float(y) + np.degrees(0.5)) < 0.1 for x, y in shown if x == "0.5")
    assert ["2.0", "0.2"] in shown
    history = [row[1:] for row in csv.reader((folder / "history0.csv").read_text().splitlines())]
    assert ["model", "0.1", "15.05"] in history
    assert min(float(row[3]) for row in band if row[0] == "1 q / de") == pytest.approx(1.0 - 1.96 * 0.2)
    picture_values = list(csv.reader((folder / "correlation.csv").read_text().splitlines()))
    assert ["1", "picture", "1.0", "0.0", "0.3"] in picture_values
    assert "stems,0.1,0.2" in (folder / "acf.csv").read_text()
    assert "bars,-0.01," in (folder / "histogram.csv").read_text()
    assert r"$C_{L_{\alpha}}$ & $4.50 \pm 0.12$ & $4.26 \ldots 4.74$ \\" in (folder / "coefficients.tex").read_text()
    assert (
        r"short period & $1.300 \pm 0.020$ & $0.240 \pm 0.010$ & $0.50 \pm 0.10$ \\"
        in (folder / "modes.tex").read_text()
    )


def test_methods_stand_side_by_side(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, other = of_few_figures(), {**of_few_figures(), "method": "ee"}
    first["method"] = "oe"
    del first["frequency_responses"]
    other["model"] = {**other["model"], "coefficients": {
        "CL_alpha": {"value": 4.4, "std": 0.2}, "Cm_q": {"value": None, "refused": "no pitching"},
        "CD_0": {"value": 0.05, "std": 0.001}}}  # fmt: skip
    files = [tmp_path / f"{name}.json" for name in ("oe", "ee")]
    for file, one in zip(files, (first, other), strict=True):
        file.write_text(json.dumps(one))
    page, folder = tmp_path / "a.html", tmp_path / "paper"
    told = ["report", str(files[0]), "--beside", str(files[1]), "-o", str(page), "--paper", str(folder)]
    assert main(told) == 0, capsys.readouterr().err
    tables = pd.read_html(StringIO(page.read_text()), match="output error")
    (table,) = [one for one in tables if "equation error" in one.columns]
    assert table.set_index("coefficient").loc["CL_alpha"].tolist() == ["4.50 ± 0.12", "4.40 ± 0.2"]
    rows = list(csv.reader((folder / "methods.csv").read_text().splitlines()))
    assert rows[0] == ["name", "output error", "output error, std", "equation error", "equation error, std"]
    assert ["Cm_q", "-9.5", "1.5", "", ""] in rows
    assert ["CD_0", "", "", "0.05", "0.001"] in rows
    latex = (folder / "methods.tex").read_text()
    assert r"$C_{D_{0}}$ & -- & $0.0500 \pm 0.0010$ \\" in latex
    assert r"\begin{tabular}{lrr}" in latex
    odd = latex_side_by_side(["50%_rough & gusty"], [{}])
    assert r"50\%\_rough \& gusty" in odd
    assert headings([first, first]) == ["1: output error", "2: output error"]
    files[1].write_text(json.dumps({"schema": "discrepancy/1"}))
    assert main(told[:-2]) == 1
    assert "only results of gcs identify stand beside one another" in capsys.readouterr().err


def test_what_cannot_be_written_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "result.json"
    file.write_text(json.dumps(result()))
    assert main(["report", str(file)]) == 2
    assert "give -o REPORT.html, --paper FOLDER, or both" in capsys.readouterr().err
    small = of_few_figures()  # of them the history is drawn before what is lacking
    for key in ("predicted", "gain_std_db", "frequency_hz"):
        lacking = json.loads(json.dumps(small).replace(f'"{key}"', '"other"'))
        file.write_text(json.dumps(lacking))
        assert main(["report", str(file), "--paper", str(tmp_path / "half")]) == 1
        assert "does not hold what its schema says" in capsys.readouterr().err
        assert [path.name for path in tmp_path.iterdir()] == ["result.json"]
    file.write_text(json.dumps(result()))
    (tmp_path / "there").mkdir()
    file.write_text(json.dumps(result()))
    assert main(["report", str(file), "--paper", str(tmp_path / "there")]) == 1
    assert "exists already" in capsys.readouterr().err
