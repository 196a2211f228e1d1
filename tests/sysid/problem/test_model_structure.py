"""The default model, usual sizes, and the manoeuvre that would tell a coefficient."""

from __future__ import annotations

import pytest

from sim_vehicle.manoeuvres.shapes import MANOEUVRES
from sim_vehicle.model.aerodynamic_terms import parse_term
from sim_vehicle.model.model_file import read_model
from sysid.problem.model_structure import (
    default_structure,
    helpful_manoeuvre,
    is_longitudinal,
    not_believed,
    usual_size,
)

FULL = default_structure(("de", "da", "dr"))
# Published sets; for each the derivative must be of the order of its usual size.
AEROSONDE = {
    "CL_alpha": 3.45, "CL_q": 0.0, "CL_de": -0.36, "Cm_alpha": -0.38, "Cm_q": -3.6, "Cm_de": -0.5, "CY_beta": -0.98,
    "Cl_beta": -0.12, "Cl_p": -0.26, "Cl_r": 0.14, "Cl_da": 0.08, "Cn_beta": 0.25, "Cn_p": 0.022, "Cn_r": -0.35,
    "Cn_da": 0.06, "Cn_dr": -0.032,
}  # fmt: skip
ZAGI = {"CL_alpha": 3.50, "Cm_alpha": -0.57, "Cm_q": -1.40, "CL_q": 2.89, "Cm_de": -0.33}


def test_the_full_structure_is_the_linear_model_of_the_textbook() -> None:
    assert len(FULL) == len(set(FULL)) == 28
    assert {parse_term(name).name for name in FULL} == set(FULL)
    assert sum(is_longitudinal(name) for name in FULL) == 10


@pytest.mark.parametrize(
    ("surfaces", "gone"),
    [
        ((), {"de", "da", "dr"}),
        (("de",), {"da", "dr"}),
        (("de", "da"), {"dr"}),
        (("da", "dr"), {"de"}),
    ],
)
def test_a_surface_that_is_not_there_takes_its_derivatives_along(surfaces: tuple[str, ...], gone: set[str]) -> None:
    found = default_structure(surfaces)
    assert set(FULL) - set(found) == {name for name in FULL if name.partition("_")[2] in gone}


@pytest.mark.parametrize("table", [AEROSONDE, ZAGI])
def test_published_derivatives_are_of_the_usual_size(table: dict[str, float]) -> None:
    for name, value in table.items():
        assert abs(value) < 5.0 * usual_size(name), name


@pytest.mark.parametrize("name", [*FULL, "Cm_alphadot", "CD_CL", "CL_alpha_de", "CD_beta2", "Cm_throttle", "Cn_p_r"])
def test_every_coefficient_has_a_size_and_a_manoeuvre_that_can_be_flown(name: str) -> None:
    assert 0.0 < usual_size(name) < 20.0
    assert set(helpful_manoeuvre(name).split(",")) <= set(MANOEUVRES)


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("Cm_de", "elevator"), ("Cl_da", "aileron"), ("Cn_dr", "rudder"), ("CL_alpha", "elevator"),
        ("Cn_beta", "rudder"), ("CD_k", "roller-coaster"), ("Cm_throttle", "throttle"), ("CD_de2", "elevator"),
    ],
)  # fmt: skip
def test_the_manoeuvre_moves_what_the_coefficient_multiplies(name: str, wanted: str) -> None:
    assert wanted in helpful_manoeuvre(name)


@pytest.mark.parametrize("vehicle", ["iitb-mav", "aerosonde", "ultrastick25e"])
def test_every_published_derivative_is_believed(vehicle: str) -> None:
    assert not [name for name, value in read_model(vehicle).values().items() if not_believed(name, value) is not None]


@pytest.mark.parametrize(("name", "value"), [("CL_q", -52.5), ("Cm_de", 9.0), ("CD_k", -2.5)])
def test_a_derivative_that_no_aircraft_has_is_not(name: str, value: float) -> None:
    reason = not_believed(name, value)
    assert reason is not None
    assert f"{value:.3g}" in reason
    assert "\n" not in reason


def test_of_a_term_that_nothing_is_known_of_every_size_is_believed() -> None:
    assert not_believed("Cm_alpha3", -300.0) is None
