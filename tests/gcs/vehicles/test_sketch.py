"""The drawing of an aircraft, to scale, and the figures that show a wrong unit."""

from xml.etree import ElementTree

import pytest

from gcs.vehicles.document import Answers, with_answers
from gcs.vehicles.figures import figures
from gcs.vehicles.shelf import read_text
from gcs.vehicles.sketch import sketch
from sim_vehicle.vehicle.vehicle_file import load_vehicle

SVG = "{http://www.w3.org/2000/svg}"


def boxes(picture: str, kind: str) -> list[dict[str, float]]:
    root = ElementTree.fromstring(picture)
    found = [one for one in root.iter(f"{SVG}rect") if one.get("class") == kind]
    return [{key: float(one.get(key, 0)) for key in ("x", "y", "width", "height")} for one in found]


def test_wing_and_paper_are_drawn_to_one_scale() -> None:
    vehicle = load_vehicle("iitb-mav")
    picture = sketch(vehicle)
    wing, _ = boxes(picture, "known")
    (paper,) = boxes(picture, "paper")
    scale = wing["width"] / 1.0  # pixels a metre: the span is 1 m
    assert wing["height"] / scale == pytest.approx(0.2, rel=0.01)
    assert paper["width"] / scale == pytest.approx(0.297, rel=0.01)
    assert paper["height"] / scale == pytest.approx(0.210, rel=0.01)
    assert "alpha vane" in picture


def test_a_label_at_the_edge_ends_within_the_picture() -> None:
    """The alpha vane of this aircraft is at the right wing tip."""
    root = ElementTree.fromstring(sketch(load_vehicle("iitb-mav")))
    left, _, width, _ = map(float, root.get("viewBox", "").split())
    texts = {one.text: one for one in root.iter(f"{SVG}text")}
    right, other = texts["alpha vane"], texts["beta vane"]
    assert right.get("text-anchor") == "end"
    assert 0.4 * width < float(right.get("x", "nan")) < left + width
    assert other.get("text-anchor") is None


def test_a_span_in_the_wrong_unit_is_seen_beside_the_paper() -> None:
    small = sketch(
        read_text(with_answers("", Answers("x", {"mass_kg": 0.5, "span_m": 150.0, "area_m2": 30.0, "chord_m": 0.2})))
    )
    (paper,) = boxes(small, "paper")
    assert paper["width"] < 2.0
    large = Answers("x", {"mass_kg": 0.5, "span_m": 0.15, "area_m2": 0.02, "chord_m": 0.13})
    assert "wider than this picture" in sketch(read_text(with_answers("", large)))


def test_a_name_is_text_in_the_picture() -> None:
    numbers = {"mass_kg": 1.0, "span_m": 1.0, "area_m2": 0.2, "chord_m": 0.2}
    picture = sketch(read_text(with_answers("", Answers('<script>"&', numbers))))
    assert "<script" not in picture
    ElementTree.fromstring(picture)


def test_figures_of_an_aircraft_whose_numbers_are_published() -> None:
    # UltraStick 25e, University of Minnesota: 1.943 kg, 1.27 m, 0.31 m^2.
    found = {one.name: one for one in figures(load_vehicle("ultrastick25e"))}
    assert found["wing loading"].value == pytest.approx(1.943 * 9.80665 / 0.3097, rel=0.01)
    assert found["aspect ratio"].value == pytest.approx(1.27**2 / 0.3097, rel=0.01)
    assert all(one.is_usual for one in found.values())


def test_grams_for_kilograms_are_unusual_figures() -> None:
    numbers = {"mass_kg": 50.0, "span_m": 1.2, "area_m2": 0.24, "chord_m": 0.2}
    found = {one.name: one for one in figures(read_text(with_answers("", Answers("x", numbers))))}
    assert not found["wing loading"].is_usual
    assert not found["stalls at about"].is_usual
