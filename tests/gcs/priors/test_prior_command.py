"""`gcs prior`: other programs' derivatives and an aircraft's sizes as a model, against values worked by hand."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from derivative_files import AEROSANDBOX, AVL, XFLR5

from gcs.cli import main
from sim_vehicle.model.model_file import Model, read_model
from sim_vehicle.vehicle.vehicle_file import VEHICLES
from sysid.numerics.gaussian import known_from

# About body axes at 30 deg, of Clb = -0.1, Cnb = 0.04, Clp = -0.5, Clr = 0.1, Cnp = -0.02, Cnr = -0.2, CYp = -0.02,
# CYr = 0.2 about stability axes, with cosine 0.8660254 and sine 0.5.
LATERAL = {
    "CY_beta": -0.3, "Cl_beta": -0.1066025, "Cn_beta": -0.0153590,
    "CY_p": -0.1173205, "CY_r": 0.1632051,
    "Cl_p": -0.4596410, "Cl_r": -0.0499038, "Cn_p": -0.1699038, "Cn_r": -0.2403590,
}  # fmt: skip
LONGITUDINAL = {"CL_alpha": 4.5, "CL_q": 8.0, "Cm_alpha": -0.9, "Cm_q": -12.0}
SYMMETRIC = {"CY_0": 0.0, "Cl_0": 0.0, "Cn_0": 0.0}


def prior(folder: Path, text: str, source: str, *more: str) -> Model:
    """The model that the command writes of a file with that text."""
    file, place = folder / "mine.txt", folder / "prior.json"
    file.write_text(text, encoding="utf-8")
    assert main(["prior", str(file), "--from", source, "-o", str(place), *more]) == 0
    return read_model(place)


def refused(folder: Path, text: str, source: str, capsys: pytest.CaptureFixture[str]) -> str:
    """What the command says of a file that it does not take."""
    file, place = folder / "mine.txt", folder / "prior.json"
    file.write_text(text, encoding="utf-8")
    assert main(["prior", str(file), "--from", source, "-o", str(place)]) == 1
    assert not place.exists()
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"gcs prior: {file}: ")
    return line


def test_avl_in_body_axes_and_per_radian(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = prior(tmp_path, AVL, "avl")
    degree = math.pi / 180.0
    assert model.values() == pytest.approx({
        **LONGITUDINAL, **LATERAL, **SYMMETRIC,
        # 2.5 - 4.5 (30 deg) - 8 (0.01) - 0.006 (2), and the same of the moment
        "CL_0": 2.5 - 4.5 * 0.5235988 - 0.08 - 0.012, "Cm_0": -0.5 + 0.9 * 0.5235988 + 0.12 + 0.03,
        "CL_de": 0.006 / degree, "Cm_de": -0.015 / degree,
        "CY_da": 0.0001 / degree, "CY_dr": 0.003 / degree,
        "Cl_da": (-0.004 * 0.8660254 - 0.0003 * 0.5) / degree, "Cn_da": (-0.002 + 0.0003 * 0.8660254) / degree,
        "Cl_dr": (0.0002 * 0.8660254 + 0.0015 * 0.5) / degree, "Cn_dr": (0.0001 - 0.0015 * 0.8660254) / degree,
        # A of 4.8, e of 0.9
        "CD_k": 1.0 / (math.pi * 0.9 * 4.8),
    }, rel=1e-5, abs=1e-7)  # fmt: skip
    said = capsys.readouterr().err
    assert "left out: flap: no control is named so; taken are elevator, aileron, rudder" in said
    assert "a positive rudder is trailing edge to the left" in said


def test_xflr5_in_body_axes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = prior(tmp_path, XFLR5, "xflr5")
    assert model.values() == pytest.approx({**LONGITUDINAL, **LATERAL, **SYMMETRIC}, rel=1e-5, abs=1e-7)
    assert "left out: what the surfaces do" in capsys.readouterr().err


def test_aerosandbox_has_body_axes(tmp_path: Path) -> None:
    model = prior(tmp_path, json.dumps(AEROSANDBOX), "aerosandbox")
    lateral = {
        "CY_beta": -0.3, "Cl_beta": -0.1, "Cn_beta": 0.04, "CY_p": -0.02, "CY_r": 0.2, "Cl_p": -0.5, "Cl_r": 0.1,
        "Cn_p": -0.02, "Cn_r": -0.2,
    }  # fmt: skip
    assert model.values() == pytest.approx({**LONGITUDINAL, **lateral, **SYMMETRIC})


def test_doubts_are_shares_above_a_least_one_and_count_as_knowledge(tmp_path: Path) -> None:
    usual, doubted = prior(tmp_path, AVL, "avl"), prior(tmp_path, AVL, "avl", "--doubt", "0.5")
    assert usual.coefficients["CL_alpha"].std == pytest.approx(math.hypot(0.45, 0.2))
    assert usual.coefficients["Cm_q"].std == pytest.approx(math.hypot(3.6, 1.5))
    assert doubted.coefficients["CL_alpha"].std == pytest.approx(math.hypot(2.25, 0.2))
    assert all(one.std for one in usual.coefficients.values())
    known, warning = known_from(usual)
    assert known is not None
    assert (warning, set(known.names)) == ("", set(usual.coefficients))


def test_a_control_that_the_vehicle_file_counts_the_other_way(tmp_path: Path) -> None:
    one, other = prior(tmp_path, AVL, "avl").values(), prior(tmp_path, AVL, "avl", "--reverse", "aileron").values()
    assert {name for name in one if one[name] != other[name]} == {"CY_da", "Cl_da", "Cn_da"}
    assert other["Cl_da"] == -one["Cl_da"]


@pytest.mark.parametrize(
    ("source", "old", "new", "words"),
    [
        ("avl", "Cmd03 =  -0.015", "Cmd03 =   0.015", "Cm_de is 0.859437 per rad, and must be negative: a positive"),
        ("avl", "Cld02 =  -0.004000  ", "Cld02 =   0.004000  ", "a positive aileron is the right one's trailing edge"),
        ("avl", "Cnd04 =  -0.001500", "Cnd04 =   0.001500", "turn the control's sign there"),
        ("avl", "Clp =  -0.500000", "Clp =   0.500000", "Cl_p is "),
        ("avl", "Standard axis orientation,  X fwd", "Geometric axis orientation,  X aft", "standard axes"),
        ("avl", "Stability-axis derivatives", "Geometry-axis derivatives", "OPER, X, ST"),
        ("avl", "Cmq = -12.000000", "Cmq = **********", "holds no number for Cmq"),
        ("avl", "Cnd02 =   0.000300", "Cnd02 =        NaN", "holds no number for Cnd02"),
        ("avl", "  Alpha =  30.00000", "", "holds no number for Alpha"),
        ("avl", "rudder       d04", "elevator     d04", "several controls of one name"),
        ("xflr5", "Alpha=", "", 'has no "Alpha="'),
        ("xflr5", "Cnr=        -0.2", "Cnr=        nan", "holds no number for Cnr"),
        ("xflr5", "CLa=         4.5", "CLa=        -4.5", "CL_alpha is -4.5, and positive below the stall"),
        ("xflr5", "Longitudinal derivatives", "", 'has no "Longitudinal derivatives"'),
        ("aerosandbox", "-12", "null", "holds no number for Cmq"),
        ("aerosandbox", "-12", "[-12, -13]", "holds no number for Cmq"),
        ("aerosandbox", "-12", "1e999", "holds no number for Cmq"),
        ("aerosandbox", "-12", "-12x", "is no JSON object"),
    ],
)  # fmt: skip
def test_what_contradicts_or_lacks_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], source: str, old: str, new: str, words: str
) -> None:
    text = {"avl": AVL, "xflr5": XFLR5, "aerosandbox": json.dumps(AEROSANDBOX)}[source]
    assert old in text
    assert words in refused(tmp_path, text.replace(old, new), source, capsys)


def test_several_analyses_of_xflr5_are_not_chosen_from(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "holds 2 analyses; keep that" in refused(tmp_path, XFLR5 + XFLR5, "xflr5", capsys)


@pytest.mark.parametrize("source", ["avl", "xflr5", "aerosandbox"])
def test_files_of_other_kinds_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], source: str) -> None:
    refused(tmp_path, "", source, capsys)
    refused(tmp_path, "[" * 100_000, source, capsys)
    refused(tmp_path, "\x00\x89PNG\n", source, capsys)
    for missing in (tmp_path, tmp_path / "nowhere"):
        assert main(["prior", str(missing), "--from", source, "-o", str(tmp_path / "p.json")]) == 1
        assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--doubt", "0"), "--doubt 0: give a share from 0.01 to 2"),
        (("--doubt", "nan"), "--doubt nan: give a share"),
        (("-o", "mine.toml"), "is there already and is no model file"),
    ],
)
def test_wrong_use_is_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    more: tuple[str, ...],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.toml").write_text('name = "mine"\n')
    Path("mine.st").write_text(AVL)
    assert main(["prior", "mine.st", "--from", "avl", "-o", "prior.json", *more]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
    assert not Path("prior.json").exists()


def test_sizes_give_a_whole_aircraft(tmp_path: Path) -> None:
    # A = 1.27^2 / 0.3097 = 5.208: a slope of 4.5395, and 4 / (A + 2) = 0.55495 of downwash.
    tail = "tail_area = 0.0774\ntail_arm = 0.66\nfin_area = 0.035\nfin_arm = 0.7"
    text = (VEHICLES / "ultrastick25e.toml").read_text(encoding="utf-8").replace("c = 0.25\n", f"c = 0.25\n{tail}\n")
    values = prior(tmp_path, text, "geometry").values()
    a_t, a_f = 0.9 * 4.18879 * 0.0774 / 0.3097, 0.9 * 3.76991 * 0.035 / 0.3097
    expected = {
        "CL_alpha": 4.5395 + a_t * 0.44505, "CL_q": 2.0 * a_t * 2.64, "Cm_q": -2.2 * a_t * 2.64**2,
        "CL_de": 0.5 * a_t, "Cm_de": -0.5 * a_t * 2.64, "Cl_p": -math.pi * 5.208 / (4.0 * 9.208),
        "CY_beta": -a_f, "CY_r": 2.0 * a_f * 0.551181, "Cn_beta": a_f * 0.551181 - 0.03,
        "Cn_r": -2.0 * a_f * 0.551181**2, "CY_dr": 0.5 * a_f, "Cn_dr": -0.5 * a_f * 0.551181,
        # 0.75^1.5 - 0.19^1.5 = 0.5667, by 4/3 A / (A + 4) and 0.4
        "Cl_da": -4.0 / 3.0 * 5.208 / 9.208 * 0.4 * 0.5667, "CD_k": 1.0 / (0.8 * math.pi * 5.208),
    }  # fmt: skip
    assert {name: values[name] for name in expected} == pytest.approx(expected, rel=1e-3)
    assert len(values) == 26  # of the linear model all but CL_0 and Cm_0


def test_without_tail_and_fin_what_they_give_is_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = tmp_path / "prior.json"
    assert main(["prior", "aerosonde", "--from", "geometry", "-o", str(place)]) == 0
    assert not {"Cm_q", "Cm_de", "CY_beta", "Cn_r"} & set(read_model(place).coefficients)
    said = capsys.readouterr().err
    assert "Cm_de: give tail_area and tail_arm under [geometry]" in said
    assert "give fin_area and fin_arm" in said


def test_a_published_aircraft_lies_within_its_doubts(tmp_path: Path) -> None:
    place = tmp_path / "prior.json"
    assert main(["prior", "aerosonde", "--from", "geometry", "--reverse", "aileron", "-o", str(place)]) == 0
    truth, found = read_model("aerosonde").values(), read_model(place).coefficients
    assert len(found) == 15
    # Its drag polar has terms by alpha where this one has CD_k.
    off = [
        abs((one.value or 0.0) - truth.get(name, 0.0)) / (one.std or 0.0)
        for name, one in found.items()
        if name != "CD_k"
    ]
    assert max(off) < 2.0
    assert sum(share < 1.0 for share in off) >= 8


def test_doubts_about_the_vehicle_file_are_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (VEHICLES / "ultrastick25e.toml").read_text(encoding="utf-8")
    prior(tmp_path, text.replace("c = 0.25\n", "c = 0.25\ntail_area = 0.08\ntail_arm = 66\n"), "geometry")
    assert "warning: geometry.tail_arm: 66 m on a span of 1.27 m is hardly possible" in capsys.readouterr().err
    prior(tmp_path, text, "geometry", "--quiet")
    assert capsys.readouterr().err == ""
