"""The model file: what is written is read again, and what is wrong in it is named."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_vehicle.effects import EFFECTS
from sim_vehicle.errors import ModelFileError
from sim_vehicle.flight.plant import Plant
from sim_vehicle.model.model_file import Coefficient, Model, ModelEffect, model_from_json, read_model
from sim_vehicle.vehicle.packed_model import flatten
from sim_vehicle.vehicle.vehicle_file import load_vehicle

FINITE = st.floats(allow_nan=False, allow_infinity=False)


def test_the_packaged_model_is_table_iv_of_the_paper() -> None:
    values = read_model("iitb-mav").values()
    table = {
        "CL_0": 0.1784, "CL_alpha": 2.453, "CL_de": 0.7405, "CD_0": 0.0871, "CD_k": 0.4,
        "Cm_0": 0.0385, "Cm_alpha": -0.5998, "Cm_de": 1.5894,
    }  # fmt: skip
    assert {name: values[name] for name in table} == table


@given(
    value=FINITE,
    std=st.none() | st.floats(min_value=0.0, allow_nan=False, allow_infinity=False),
    limits=st.tuples(FINITE, FINITE),
    reason=st.text(max_size=30),
    tau=st.floats(min_value=0.001, max_value=0.3),
)
def test_what_is_written_is_read_again(
    value: float, std: float | None, limits: tuple[float, float], reason: str, tau: float
) -> None:
    model = Model(
        "a name",
        {
            "CL_0": Coefficient(value, std, extra={"ci95": [value, value], "systematic": {"mass_1pct": 0.1}}),
            "Cl_r": Coefficient(None, refused=reason),
        },
        (ModelEffect("vane_lag", {"tau": Coefficient(tau, std)}),),
        {"alpha": limits},
    )
    assert model_from_json(json.loads(json.dumps(model.to_json(), allow_nan=False))) == model


def test_a_file_survives_the_disk_to_the_last_bit(tmp_path: Path) -> None:
    model = read_model("iitb-mav").with_coefficient("Cm_q", -5.0 / 3.0, 0.1 / 3.0)
    model.write(tmp_path / "model.json")
    assert read_model(tmp_path / "model.json") == model


def test_a_bare_number_is_a_value_and_an_effect_of_one_coefficient_becomes_that_coefficient() -> None:
    model = model_from_json(
        {
            "schema": "model/1",
            "coefficients": {"CL_0": 1},
            "effects": [{"name": "pitch_damping", "parameters": {"Cm_q": {"value": -5, "std": 0.2}}}],
        }
    )
    assert model.values() == {"CL_0": 1.0, "Cm_q": -5.0}
    assert model.coefficients["Cm_q"].std == 0.2
    assert model.effects == ()


def test_defaults_of_an_effect_are_filled_in() -> None:
    model = model_from_json(
        {"schema": "model/1", "effects": [{"name": "stall", "parameters": {"alpha_stall": {"value": 0.2}}}]}
    )
    assert model.effect("stall") == {"alpha_stall": 0.2, "sharpness": 50.0}
    assert model.effect("vane_lag") is None


def file_with(**changes: Any) -> dict[str, Any]:
    return {"schema": "model/1", "name": "x", "coefficients": {"CL_0": {"value": 0.2}}, **changes}


def one_effect(name: str = "stall", **rest: Any) -> dict[str, Any]:
    return file_with(effects=[{"name": name, **rest}])


@pytest.mark.parametrize(
    ("data", "told"),
    [
        ([], "schema"),
        ({}, "schema"),
        (file_with(schema="model/2"), '"model/1"'),
        (file_with(colour="red"), "'colour'"),
        (file_with(coefficients=[]), "coefficients"),
        (file_with(coefficients={"Cm_elevator": 1.0}), "'Cm_elevator'"),
        (file_with(coefficients={"CL_0": None}), "CL_0"),
        (file_with(coefficients={"CL_0": "0.2"}), "CL_0"),
        (file_with(coefficients={"CL_0": True}), "CL_0"),
        (file_with(coefficients={"CL_0": {}}), "CL_0: value"),
        (file_with(coefficients={"CL_0": {"value": float("nan")}}), "CL_0: value"),
        (file_with(coefficients={"CL_0": {"value": 10**400}}), "CL_0: value"),
        (file_with(coefficients={"CL_0": {"value": 1.0, "std": float("inf")}}), "CL_0: std"),
        (file_with(coefficients={"CL_0": {"value": 1.0, "std": -0.1}}), "CL_0: std"),
        (file_with(effects={}), "effects"),
        (file_with(effects=["stall"]), "effect"),
        (one_effect("stalling"), "'stalling'"),
        (one_effect(), "alpha_stall"),
        (one_effect(parameters=[]), "stall"),
        (one_effect(parameters={"alpha_stal": 0.2}), "alpha_stal"),
        (one_effect(parameters={"alpha_stall": "high"}), "stall.alpha_stall"),
        (one_effect(parameters={"alpha_stall": -0.2}), "alpha_stall"),
        (one_effect(params={"alpha_stall": 0.2}), "'params'"),
        (one_effect("vane_lag", parameters={"tau": 0.0}), "tau"),
        (file_with(effects=[{"name": "asymmetry", "parameters": {"Cl_0": 0.1}}] * 2), "Cl_0"),
        (file_with(effects=[{"name": "vane_lag", "parameters": {"tau": 0.1}}] * 2), "vane_lag"),
        (file_with(validity=[0.0, 1.0]), "validity"),
        (file_with(validity={"alpha": [0.0]}), "validity.alpha"),
        (file_with(validity={"alpha": [0.0, "high"]}), "validity.alpha"),
    ],
)
def test_a_wrong_file_is_named_with_its_key_in_one_line(data: Any, told: str) -> None:
    with pytest.raises(ModelFileError) as caught:
        model_from_json(data, "some.json")
    message = str(caught.value)
    assert message.startswith("some.json: ")
    assert told in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("content", "told"),
    [(b"{", "not JSON"), (b"\xff\xfe", "not a text file"), (None, "cannot read"), (b"[1, 2", ":1:")],
)
def test_a_file_that_cannot_be_read_is_named(tmp_path: Path, content: bytes | None, told: str) -> None:
    path = tmp_path / "broken.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ModelFileError) as caught:
        read_model(path)
    assert str(caught.value).startswith(str(path))
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_model_that_cannot_be_written_says_where(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match="cannot write") as caught:
        read_model("iitb-mav").write(tmp_path / "no folder" / "model.json")
    assert "no folder" in str(caught.value)


def test_a_refused_coefficient_is_named_and_asked_for() -> None:
    packaged = read_model("iitb-mav")
    model = Model("flown", {**packaged.coefficients, "Cl_r": Coefficient(None, refused="too quiet")})
    assert model.refused() == ["Cl_r"]
    with pytest.raises(ModelFileError, match="--set Cl_r=VALUE"):
        Plant(load_vehicle("iitb-mav"), model)
    Plant(load_vehicle("iitb-mav"), model.with_coefficient("Cl_r", 0.1))


def test_a_refused_parameter_of_an_effect_is_named_and_asked_for() -> None:
    data = one_effect("stall", parameters={"alpha_stall": {"refused": "too slow"}})
    model = model_from_json(data)
    assert model.to_json()["effects"][0]["parameters"]["alpha_stall"] == {"refused": "too slow"}
    with pytest.raises(ModelFileError, match="--effect stall:alpha_stall=VALUE") as caught:
        flatten(load_vehicle("iitb-mav"), model)
    assert "\n" not in str(caught.value)
    flatten(load_vehicle("iitb-mav"), model.with_effect(EFFECTS["stall"], {"alpha_stall": 0.2}))


def test_replacing_an_effect_leaves_one_of_its_name() -> None:
    model = read_model("iitb-mav")
    for tau in (0.1, 0.2):
        model = model.with_effect(EFFECTS["vane_lag"], {"tau": tau}, {"tau": 0.01})
    assert [effect.name for effect in model.effects] == ["vane_lag"]
    assert model.effects[0].parameters["tau"] == Coefficient(0.2, 0.01)
    assert read_model("iitb-mav").effects == ()


def test_a_coefficient_of_zero_is_part_of_the_structure() -> None:
    flat = flatten(load_vehicle("iitb-mav"), read_model("iitb-mav").with_coefficient("Cm_q", 0.0))
    assert "Cm_q" in flat.names
    assert "Cn_p" in flat.names
    assert "CL_q" not in flat.names


def test_the_flat_arrays_hold_each_axis_between_its_bounds() -> None:
    flat = flatten(load_vehicle("iitb-mav"), read_model("iitb-mav").with_coefficient("Cm_alpha_de", 2.5))
    axes = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
    for i, axis in enumerate(axes):
        inside = flat.names[flat.T[i] : flat.T[i + 1]]
        assert inside
        assert all(name.startswith(f"{axis}_") for name in inside)
    assert flat.T[-1] == len(flat.names) == flat.C.size
    row = flat.names.index("Cm_alpha_de")
    assert flat.C[row] == 2.5
    np.testing.assert_array_equal(flat.F[row], [0, 6, -1, -1])


@pytest.mark.parametrize("name", ["p_factor", "propeller_gyroscopic"])
def test_an_effect_of_the_propeller_asks_for_what_the_vehicle_file_lacks(name: str) -> None:
    vehicle = load_vehicle("iitb-mav")
    assert vehicle.propulsion is not None
    bare = replace(vehicle, propulsion=replace(vehicle.propulsion, diameter=None, max_rpm=None))
    model = read_model("iitb-mav").with_effect(EFFECTS[name], {EFFECTS[name].parameters[0].name: 0.01})
    flatten(vehicle, model)
    with pytest.raises(ModelFileError, match=r"\[propulsion\]") as caught:
        flatten(bare, model)
    assert "\n" not in str(caught.value)


def correlated(**block: Any) -> dict[str, Any]:
    entries = {"CL_0": {"value": 0.2, "std": 0.1}, "CL_alpha": {"value": 2.0, "std": 0.3}}
    return {"schema": "model/1", "name": "m", "coefficients": entries, "correlation": block}


def test_correlations_of_the_estimates_are_kept() -> None:
    block = {"names": ["CL_alpha", "CL_0"], "matrix": [[1.0, -0.95], [-0.95, 1.0]]}
    model = model_from_json(correlated(**block))
    assert model.to_json()["correlation"] == block
    assert "correlation" not in read_model("iitb-mav").to_json()


@pytest.mark.parametrize(
    ("names", "matrix", "told"),
    [
        (["CL_0", "CL_de"], [[1.0, 0.0], [0.0, 1.0]], "CL_de"),
        (["CL_0", "CL_0"], [[1.0, 0.0], [0.0, 1.0]], "each once"),
        (["CL_0", "CL_alpha"], [[1.0, 0.5]], "2 rows of 2"),
        (["CL_0", "CL_alpha"], [[1.0, 0.5], [0.4, 1.0]], "symmetric"),
        (["CL_0", "CL_alpha"], [[1.0, 1.5], [1.5, 1.0]], "within -1 to 1"),
        (["CL_0", "CL_alpha"], [[0.9, 0.5], [0.5, 1.0]], "1 on its diagonal"),
        (["CL_0", "CL_alpha"], [[1.0, "x"], ["x", 1.0]], "finite number"),
    ],
)
def test_impossible_correlations_are_named(names: list[str], matrix: list[list[Any]], told: str) -> None:
    with pytest.raises(ModelFileError, match=told):
        model_from_json(correlated(names=names, matrix=matrix))


def test_what_is_refused_flies_by_the_mean_of_its_estimate_and_is_never_a_value() -> None:
    told = read_model("iitb-mav")
    entry = told.coefficients["Cm_0"]
    refused = Coefficient(None, refused="the error says nothing", mean=entry.value, mean_std=0.01)
    model = replace(told, coefficients={**told.coefficients, "Cm_0": refused})
    read = model_from_json(json.loads(json.dumps(model.to_json(), allow_nan=False)))
    assert read == model
    assert read.to_json()["coefficients"]["Cm_0"] == {
        "refused": "the error says nothing", "mean": entry.value, "mean_std": 0.01,
    }  # fmt: skip
    assert "Cm_0" not in read.values()
    assert read.not_identified() == read.refused() == ["Cm_0"]
    vehicle = load_vehicle("iitb-mav")
    np.testing.assert_array_equal(flatten(vehicle, read).C, flatten(vehicle, told).C)
    assert Plant(vehicle, read).trim().command[0] == Plant(vehicle, told).trim().command[0]
    nothing = replace(told, coefficients={**told.coefficients, "Cm_0": Coefficient(None, refused="no motion")})
    assert nothing.unknown() == ["Cm_0"]
    with pytest.raises(ModelFileError, match="--set Cm_0=VALUE"):
        flatten(vehicle, nothing)
