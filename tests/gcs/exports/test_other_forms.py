"""Models as tables, matrices and functions of other programs, read back by what is not ours."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import control
import numpy as np
import pytest
from scipy.io import loadmat

from gcs.cli import main
from gcs.errors import ExportError
from gcs.exports import jsbsim, matlab, state_space, tables
from gcs.exports.exported import Exported, model_of
from gcs.exports.samples import drawn
from sim_vehicle.effects import EFFECTS, parse_effect
from sim_vehicle.model.aerodynamic_terms import AXES, parse_term
from sim_vehicle.model.model_file import Coefficient, Correlation, Model, ModelEffect, read_model
from sim_vehicle.vehicle.vehicle_file import load_vehicle


def estimated() -> Exported:
    """A model with errors that hang together, terms of all kinds and an effect."""
    model = read_model("iitb-mav")
    for name, value in {"CL_alpha3": -2.0, "Cm_alpha_de": 0.3, "CD_CL": 0.02, "CD_k": 0.4}.items():
        model = model.with_coefficient(name, value)
    effect, values = parse_effect("thrust_line_offset:z_T=0.02")
    model = model.with_effect(effect, values, {"z_T": 0.002})
    entries = {name: Coefficient(value, 0.03 * abs(value) + 1e-4) for name, value in model.values().items()}
    names = (*entries, "thrust_line_offset.z_T")
    vectors = np.random.default_rng(1).normal(size=(len(names), 3 * len(names)))
    # Neighbours hang together by 0.6.
    vectors[1:] += 0.75 * vectors[:-1]
    matrix = np.corrcoef(vectors).round(6)
    rows = tuple(tuple(row) for row in ((matrix + matrix.T) / 2.0).tolist())
    model = Model(model.name, {**entries, "CY_p": Coefficient(None, refused="no roll")}, model.effects, {},
                  Correlation(names, rows))  # fmt: skip
    return Exported(model, load_vehicle("iitb-mav"))


def without_effects(model: Exported) -> Exported:
    assert model.model.correlation is not None
    bare = Model(model.model.name, model.model.coefficients, (), {}, None)
    return Exported(bare, model.vehicle)


def test_a_spreadsheet_holds_every_estimate_its_error_and_what_it_is(tmp_path: Path) -> None:
    model = estimated()
    notes = tables.write_csv(model, tmp_path / "a.csv")
    rows = {row["name"]: row for row in csv.DictReader((tmp_path / "a.csv").read_text().splitlines())}
    assert set(rows) == {*model.model.values(), "thrust_line_offset.z_T"}
    for name, row in rows.items():
        entry = model.estimates[name]
        assert (float(row["value"]), float(row["std"])) == (entry.value, entry.std)
        assert float(row["low95"]) < float(row["value"]) < float(row["high95"])
        assert row["meaning"]
    assert (rows["thrust_line_offset.z_T"]["unit"], rows["Cl_p"]["meaning"]) == (
        "m",
        "roll damping: rolling moment by roll rate",
    )
    read = list(csv.reader((tmp_path / "a-correlation.csv").read_text().splitlines()))
    assert model.model.correlation is not None
    np.testing.assert_array_equal(np.array(read)[1:, 1:].astype(float), model.model.correlation.matrix)
    assert notes == ["refused, taken as 0: CY_p"]
    with pytest.raises(ExportError, match="exists already"):
        tables.write_csv(model, tmp_path / "a.csv")


def test_a_table_of_a_paper_has_the_digits_that_the_errors_warrant(tmp_path: Path) -> None:
    tables.write_latex(estimated(), tmp_path / "a.tex")
    text = (tmp_path / "a.tex").read_text()
    assert all(text.count(one) == 1 for one in (r"\toprule", r"\midrule", r"\bottomrule", r"\begin{tabular}{lrr}"))
    body = text.split(r"\midrule")[1].split(r"\bottomrule")[0].strip().splitlines()
    assert len(body) == len(estimated().estimates)
    for row in body:
        assert row.endswith(r" \\")
        assert row.count("&") == 2
        assert row.count("$") % 2 == 0
        assert row.count("{") == row.count("}")
    assert r"$C_{L_{\alpha^3}}$ & $-2.000 \pm 0.060$" in text
    assert r"$C_{m_{\alpha \delta_e}}$" in text
    assert r"\texttt{thrust\_line\_offset.z\_T} & $0.0200 \pm 0.0020$" in text


def matlab_values(text: str, arguments: dict[str, Any]) -> dict[str, Any]:
    """What the six lines of a function of MATLAB give, element by element."""
    known: dict[str, Any] = dict(arguments)
    for axis, expression in re.findall(r"^(C\w) = (.*);$", text, re.MULTILINE):
        known[axis] = eval(expression.replace(".*", "*"), {}, known)
    return {axis: known[axis] for axis in AXES}


def test_the_function_for_matlab_gives_the_model_s_coefficients(tmp_path: Path) -> None:
    model = without_effects(estimated())
    matlab.write(model, tmp_path / "my model.mat")
    text = (tmp_path / "my_model_coefficients.m").read_text()
    names = re.search(r"my_model_coefficients\((.*)\)", text)
    assert names is not None
    random = np.random.default_rng(2)
    given = {name: random.uniform(-0.5, 0.5, 1000) for name in names[1].split(", ")}
    found = matlab_values(text, given)
    places = {"p": "phat", "q": "qhat", "r": "rhat", "alphadot": "alphadothat"}
    truth = {axis: np.zeros(1000) for axis in AXES}
    for axis in AXES:
        for name, value in model.model.values().items():
            term = parse_term(name)
            if term.axis == axis:
                factors = [truth["CL"] if one == "CL" else given[places.get(one, one)] for one in term.factors]
                truth[axis] = truth[axis] + value * np.prod(factors, axis=0)
        np.testing.assert_allclose(found[axis], truth[axis], rtol=1e-9, atol=1e-12, err_msg=axis)


def test_the_mat_file_holds_values_errors_and_matrices(tmp_path: Path) -> None:
    model = estimated()
    bare = Exported(Model(model.model.name, model.model.coefficients, (), {}, model.model.correlation), model.vehicle)
    with pytest.raises(ExportError, match="a function of MATLAB does not hold the effect thrust_line_offset"):
        matlab.write(model, tmp_path / "a.mat")
    matlab.write(without_effects(bare), tmp_path / "b.mat")
    read = loadmat(tmp_path / "b.mat", squeeze_me=True, struct_as_record=False)
    assert read["coefficients"].CL_alpha == model.model.values()["CL_alpha"]
    assert read["std"].CL_alpha == model.estimates["CL_alpha"].std
    assert list(read["linear"].states) == ["V", "alpha", "q", "theta", "beta", "p", "r", "phi"]
    assert read["linear"].A.shape == (8, 8)


def test_python_control_has_the_modes_that_the_file_says(tmp_path: Path) -> None:
    state_space.write(estimated(), tmp_path / "a.json")
    read = json.loads((tmp_path / "a.json").read_text())
    system = control.ss(*(np.array(read[name]) for name in "ABCD"))
    poles = system.poles()
    for mode in read["modes"]:
        wanted = complex(*mode["eigenvalue"])
        assert np.abs(poles - wanted).min() < 1e-9 * max(abs(wanted), 1.0)
    assert len(read["modes"]) >= 4


def wind_axes_motion(model: Exported, air: float) -> control.NonlinearIOSystem:
    """The motion in V, alpha, beta (Stevens & Lewis, Aircraft Control and Simulation, table 2.5-1), written anew."""
    vehicle, values = model.vehicle, model.model.values()
    m, Ix, Iy, Iz, Ixz = (getattr(vehicle.mass, name) for name in ("mass", "Ixx", "Iyy", "Izz", "Ixz"))
    S, b, c, g = vehicle.geometry.S, vehicle.geometry.b, vehicle.geometry.c, vehicle.environment.gravity
    assert vehicle.propulsion is not None
    x_T, _, z_T = vehicle.propulsion.line
    most, lower = vehicle.propulsion.max_thrust or 0.0, model.model.effect("thrust_line_offset") or {"z_T": 0.0}

    def rates(t: float, x: np.ndarray, u: np.ndarray, params: dict[str, Any]) -> np.ndarray:
        V, alpha, q, theta, beta, p, r, phi = x
        regressors = {"alpha": alpha, "beta": beta, "p": p * b / 2 / V, "q": q * c / 2 / V, "r": r * b / 2 / V,
                      "de": u[0], "da": u[1], "dr": u[2]}  # fmt: skip
        C = dict.fromkeys(AXES, 0.0)
        for axis in AXES:
            for name, value in values.items():
                term = parse_term(name)
                if term.axis == axis:
                    C[axis] += value * np.prod([{**regressors, "CL": C["CL"]}[one] for one in term.factors])
        qS, T = 0.5 * air * V**2 * S, most * u[3]
        ca, sa, cb, sb, tb = np.cos(alpha), np.sin(alpha), np.cos(beta), np.sin(beta), np.tan(beta)
        X = T + qS * (C["CL"] * sa - C["CD"] * ca) - m * g * np.sin(theta)
        Y = qS * C["CY"] + m * g * np.cos(theta) * np.sin(phi)
        Z = -qS * (C["CL"] * ca + C["CD"] * sa) + m * g * np.cos(theta) * np.cos(phi)
        L, M, N = qS * b * C["Cl"], qS * c * C["Cm"] + (z_T + lower["z_T"]) * T, qS * b * C["Cn"]
        gamma = Ix * Iz - Ixz**2
        return np.array([
            (X * ca * cb + Y * sb + Z * sa * cb) / m,
            q - (p * ca + r * sa) * tb + (Z * ca - X * sa) / (m * V * cb),
            (M + (Iz - Ix) * p * r - Ixz * (p**2 - r**2)) / Iy,
            q * np.cos(phi) - r * np.sin(phi),
            p * sa - r * ca + (Y * cb - X * ca * sb - Z * sa * sb) / (m * V),
            (Ixz * (Ix - Iy + Iz) * p * q - (Iz * (Iz - Iy) + Ixz**2) * q * r + Iz * L + Ixz * N) / gamma,
            (((Ix - Iy) * Ix + Ixz**2) * p * q - Ixz * (Ix - Iy + Iz) * q * r + Ixz * L + Ix * N) / gamma,
            p + np.tan(theta) * (q * np.sin(phi) + r * np.cos(phi)),
        ])  # fmt: skip

    assert x_T == 0.1  # a thrust along x has no arm there
    return control.NonlinearIOSystem(rates, None, inputs=4, states=8, outputs=8)


def test_python_control_linearises_the_same_motion(tmp_path: Path) -> None:
    """Equations written here, its differences, at the trim that the file gives."""
    found = estimated()
    vehicle = replace(found.vehicle, environment=replace(found.vehicle.environment, air_density=1.2),
                      mass=replace(found.vehicle.mass, Ixz=0.004))  # fmt: skip
    model = Exported(found.model, vehicle)
    state_space.write(model, tmp_path / "a.json")
    read = json.loads((tmp_path / "a.json").read_text())
    states = [read["trim"][name] for name in read["states"]]
    inputs = [read["trim"][name] for name in read["inputs"]]
    motion = wind_axes_motion(model, 1.2)
    assert np.abs(motion.dynamics(0.0, states, inputs)).max() < 1e-6
    linear = control.linearize(motion, states, inputs, eps=1e-6)
    for name, theirs in (("A", linear.A), ("B", linear.B)):
        np.testing.assert_allclose(np.array(read[name]), theirs, rtol=1e-4, atol=1e-4 * np.abs(theirs).max())


def test_models_are_drawn_with_their_correlations(tmp_path: Path) -> None:
    model = estimated()
    assert model.model.correlation is not None
    many = drawn(model, 4000, seed=3)
    values = np.array([[one.estimates[name].value for name in model.model.correlation.names] for one in many])
    stds = np.array([model.estimates[name].std for name in model.model.correlation.names])
    np.testing.assert_allclose(values.std(axis=0), stds, rtol=0.06)
    np.testing.assert_allclose(np.corrcoef(values.T), model.model.correlation.matrix, atol=0.08)
    again = drawn(model, 2, seed=3)
    assert again[1].estimates["Cl_p"].value == drawn(model, 2, seed=3)[1].estimates["Cl_p"].value
    with pytest.raises(ExportError, match="no models can be drawn"):
        drawn(without_effects(model), 3)


def test_the_command_writes_what_is_asked_and_says_what_it_leaves_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = estimated()
    result = tmp_path / "result.json"
    result.write_text(json.dumps({"schema": "identification/1", "model": model.model.to_json()}))
    assert model_of(str(result)).values() == model.model.values()
    command = ["export-model", str(result), "--vehicle", "iitb-mav", "--to"]
    assert main([*command, "jsbsim", "-o", str(tmp_path / "sim"), "--samples", "2"]) == 0
    said = capsys.readouterr()
    assert said.out.split() == [str(tmp_path / one) for one in ("sim", "sim-0001", "sim-0002")]
    assert "refused, taken as 0: CY_p" in said.err
    assert (tmp_path / "sim-0002" / "aircraft" / "iitb-mav" / "iitb-mav.xml").exists()
    assert main([*command, "csv", "-o", str(tmp_path / "sim")]) == 1
    assert capsys.readouterr().err.strip() == f"gcs export-model: {tmp_path / 'sim'}: exists already; give another name"


def test_names_of_any_origin_stay_remarks(tmp_path: Path) -> None:
    model = without_effects(estimated())
    named = Exported(replace(model.model, name="mine\nsystem('calc')\x01"), model.vehicle)
    matlab.write(named, tmp_path / "a.mat")
    lines = (tmp_path / "a_coefficients.m").read_text().splitlines()
    assert lines[1] == f"% {named.title}."
    assert lines[1].startswith("% mine system('calc') , identified")
    jsbsim.write(named, tmp_path / "sim")
    assert ElementTree.parse(tmp_path / "sim" / "aircraft" / "iitb-mav" / "iitb-mav.xml").getroot().tag == "fdm_config"


def test_a_state_space_says_which_effects_it_does_not_hold(tmp_path: Path) -> None:
    model = without_effects(estimated())
    for text in ("actuator_lag:tau=0.2", "motor_lag:tau=0.3", "servo_deadband:width=0.01"):
        effect, values = parse_effect(text)
        with_it = Exported(model.model.with_effect(effect, values), model.vehicle)
        notes = state_space.write(with_it, tmp_path / f"{effect.name}.json")
        assert f"{effect.name} is no part of eight states" in notes


@pytest.mark.parametrize("name", sorted(jsbsim.EFFECTS_HELD))
def test_an_effect_of_unknown_size_is_named(name: str, tmp_path: Path) -> None:
    model = without_effects(estimated())
    parameter = EFFECTS[name].parameters[0].name
    unknown = ModelEffect(name, {parameter: Coefficient(None, refused="not excited")})
    refused = Exported(replace(model.model, effects=(unknown,)), model.vehicle)
    for write in (jsbsim.write, state_space.write):
        with pytest.raises(ExportError, match=f"the effect {name} has no value for {parameter}"):
            write(refused, tmp_path / "out")


def test_what_has_no_error_stays_as_it_is_and_nothing_is_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = estimated()
    effect, _ = parse_effect("thrust_scale:scale=0.1")
    fixed = Exported(model.model.with_effect(effect, {"scale": 0.9}), model.vehicle)
    assert {one.model.effect("thrust_scale")["scale"] for one in drawn(fixed, 5)} == {0.9}  # type: ignore[index]
    (tmp_path / "a-correlation.csv").write_text("mine")
    with pytest.raises(ExportError, match=r"a-correlation\.csv: exists already"):
        tables.write_csv(model, tmp_path / "a.csv")
    assert not (tmp_path / "a.csv").exists()
    result = tmp_path / "result.json"
    result.write_text(json.dumps(model.model.to_json()))
    (tmp_path / "b-0002.csv").write_text("mine")
    command = ["export-model", str(result), "--vehicle", "iitb-mav", "--to", "csv", "-o", str(tmp_path / "b.csv")]
    assert main([*command, "--samples", "3"]) == 1
    assert "b-0002.csv: exists already" in capsys.readouterr().err
    assert not (tmp_path / "b.csv").exists()
    assert main([*command, "--samples", "-3"]) == 2


def test_what_the_vehicle_file_lacks_is_said(tmp_path: Path) -> None:
    model = without_effects(estimated())
    controls = {name: replace(one, servos=()) for name, one in model.vehicle.controls.items()}
    bare = replace(model.vehicle, propulsion=None, controls=controls)
    notes = jsbsim.write(Exported(model.model, bare), tmp_path / "glider")
    assert "no thrust: the vehicle file has no [propulsion]" in notes
    assert "travel of elevator, aileron, rudder is not given: 0.5 rad assumed" in notes
    effect, values = parse_effect("propwash_elevator:k=0.3")
    with pytest.raises(ExportError, match="which the effect propwash_elevator is of"):
        jsbsim.write(Exported(model.model.with_effect(effect, values), bare), tmp_path / "a")
    assert model.vehicle.propulsion is not None
    idle = replace(model.vehicle, propulsion=replace(model.vehicle.propulsion, max_thrust=None))
    with pytest.raises(ExportError, match="nothing gives thrust by the throttle"):
        jsbsim.write(Exported(model.model, idle), tmp_path / "a")


def test_what_is_refused_is_there_by_its_mean_and_marked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    model = estimated().model
    told = model.coefficients["Cm_0"]
    refused = Coefficient(None, refused="says nothing", mean=told.value, mean_std=told.std)
    bare = replace(model, coefficients={**model.coefficients, "Cm_0": refused}, effects=(), correlation=None)
    whole = replace(model, effects=(), correlation=None)
    monkeypatch.chdir(tmp_path)
    for name, one in (("whole", whole), ("bare", bare)):
        one.write(f"{name}.json")
        for form in ("csv", "mat", "latex", "statespace", "jsbsim", "gazebo"):
            place = f"{name}-{form}"
            assert main(["export-model", f"{name}.json", "--vehicle", "iitb-mav", "--to", form, "-o", place]) == 0
    said = capsys.readouterr().err
    assert "not identified, there by the mean of a refused estimate: Cm_0" in said
    assert "Cm_0" not in "".join(line for line in said.splitlines() if line.startswith("left out"))
    mark = "not identified, there by the mean of a refused estimate: Cm_0"
    rows = {row["name"]: row for row in csv.DictReader(Path("bare-csv").read_text().splitlines())}
    assert float(rows["Cm_0"]["value"]) == told.value
    assert rows["Cm_0"]["meaning"] == "not identified: says nothing"
    spaces = [json.loads(Path(f"{name}-statespace").read_text()) for name in ("whole", "bare")]
    np.testing.assert_array_equal(spaces[0]["A"], spaces[1]["A"])
    assert spaces[1]["not_identified"] == ["Cm_0"]
    functions = [next(Path().glob(f"{name}_mat_coefficients.m")).read_text() for name in ("whole", "bare")]
    assert mark in functions[1]
    assert functions[0].splitlines()[3:] != []
    sums = [[line for line in text.splitlines() if line.startswith("Cm =")] for text in functions]
    assert sorted(sums[0][0]) == sorted(sums[1][0])
    assert mark in Path("bare-latex").read_text()
    for folder in ("bare-jsbsim", "bare-gazebo"):
        assert any(mark in one.read_text() for one in Path(folder).rglob("*") if one.is_file())
