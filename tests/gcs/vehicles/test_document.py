"""A form put into a vehicle file and read out of it: what it does not ask stays, remarks too."""

import math
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from gcs.vehicles.document import Answers, ControlAnswer, ServoAnswer, answers_of, with_answers, with_points_inside
from gcs.vehicles.shelf import read_text
from sim_vehicle.errors import VehicleFileError
from sim_vehicle.vehicle.vehicle_file import VEHICLES, load_vehicle

PLANE = Answers(
    "Bixler 2",
    {"mass_kg": 1.05, "span_m": 1.5, "area_m2": 0.26, "chord_m": 0.18, "speed_mps": 13.0},
    {"elevator": ControlAnswer((ServoAnswer(2, (1100.0, 1500.0, 1900.0), (-20.0, 0.0, 22.5)),))},
    {"alpha_vane": (0.15, -0.4, 0.0)},
)


def test_a_form_alone_makes_a_vehicle_file() -> None:
    text = with_answers("", PLANE)
    vehicle = read_text(text)
    assert (vehicle.name, vehicle.mass.mass, vehicle.geometry.b) == ("Bixler 2", 1.05, 1.5)
    assert vehicle.mass.estimated  # nothing was said of its moments of inertia
    elevator = vehicle.controls["elevator"]
    assert float(elevator.deflection_from_pwm(1900.0)) == pytest.approx(math.radians(22.5), abs=1e-6)
    assert vehicle.sensors["alpha_vane"].position == (0.15, -0.4, 0.0)
    assert answers_of(text) == PLANE


def test_of_area_span_and_chord_two_are_enough() -> None:
    every = {"span_m": 1.6, "area_m2": 0.4, "chord_m": 0.25}
    for name, line in (("span_m", "b = 1.6"), ("area_m2", "S = 0.4"), ("chord_m", "c = 0.25")):
        two = {key: value for key, value in every.items() if key != name}
        assert line in with_answers("", Answers("x", {"mass_kg": 2.0, **two}))


def test_what_a_form_does_not_ask_and_the_remarks_stay() -> None:
    path = VEHICLES / "iitb-mav.toml"
    before = path.read_text()
    given = with_points_inside(before, load_vehicle(path))
    answers = answers_of(given)
    heavier = replace(answers, numbers={**answers.numbers, "mass_kg": 1.1})
    after = with_answers(given, heavier)
    old, new = tomllib.loads(given), tomllib.loads(after)
    assert new["mass"].pop("mass") == 1.1
    assert old["mass"].pop("mass") == 1.0
    assert new == old
    assert "# chosen: radii of gyration" in after  # a remark of its author
    assert with_answers(given, answers) == given  # the same answers change nothing


def test_what_is_taken_out_of_the_form_is_taken_out_of_the_file() -> None:
    text = with_answers(with_answers("", PLANE), replace(PLANE, controls={}, places={}))
    data = tomllib.loads(text)
    assert "controls" not in data
    assert not data.get("sensors", {}).get("alpha_vane", {}).get("position")
    assert read_text(text).controls == {}


def test_servos_that_work_together_survive_the_form() -> None:
    elevons = {
        "elevator": ControlAnswer(
            (ServoAnswer(1, (1000.0, 2000.0), (-25.0, 25.0), 0.5), ServoAnswer(2, (1000.0, 2000.0), (25.0, -25.0), 0.5))
        ),
        "throttle": ControlAnswer((ServoAnswer(3, (1000.0, 2000.0), (0.0, 100.0)),)),
    }
    text = with_answers("", replace(PLANE, controls=elevons))
    assert answers_of(text).controls == elevons
    vehicle = read_text(text)
    assert float(vehicle.controls["elevator"].deflection_from_pwm(2000.0, 1000.0)) == pytest.approx(math.radians(25))
    assert vehicle.controls["throttle"].limits == (0.0, 1.0)


def test_bench_tables_beside_a_file_come_into_it(tmp_path: Path) -> None:
    path = VEHICLES / "iitb-mav.toml"
    text = with_points_inside(path.read_text(), load_vehicle(path))
    assert ".csv" not in text
    there = (VEHICLES / "iitb-mav-alpha.csv").read_text().splitlines()[1:]
    points = tomllib.loads(text)["calibration"]["alpha"]["points"]
    assert sorted(points) == sorted([float(x) for x in line.split(",")[:2]] for line in there)
    assert read_text(text).calibration["alpha"].form == "linear"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mass = [", "is not a TOML file"),
        ("x = " + "[" * 5000, "vehicle file: is not a"),
        ("[mass]\nmass = 1.0\n", "geometry is missing"),
        (
            '[mass]\nmass=1\n[geometry]\nS=0.2\nb=1\nc=0.2\n[calibration.alpha]\nsource="adc0"\nform="linear"\n'
            'unit="deg"\npoints="/etc/passwd"\n',
            "calibration.alpha.points names a file; give the points themselves",
        ),
    ],
)
def test_a_text_that_is_no_vehicle_file_is_one_line(text: str, words: str) -> None:
    with pytest.raises(VehicleFileError, match=words) as caught:
        read_text(text)
    assert "\n" not in str(caught.value)


def test_a_guessed_travel_stays_marked_until_another_is_written() -> None:
    guessed = replace(PLANE.controls["elevator"], guessed_to=0.3)
    text = with_answers("", replace(PLANE, controls={"elevator": guessed}))
    assert read_text(text).controls["elevator"].gain_std == 0.3
    shown = answers_of(text)
    assert with_answers(text, replace(shown, numbers={**shown.numbers, "mass_kg": 1.2})).count("gain_std = 0.3 #") == 1
    measured = ControlAnswer((ServoAnswer(2, (1100.0, 1500.0, 1900.0), (-18.0, 0.0, 21.0)),))
    vehicle = read_text(with_answers(text, replace(shown, controls={"elevator": measured})))
    assert vehicle.controls["elevator"].gain_std == 0.0
    assert not any("travel" in line for line in vehicle.warnings)
