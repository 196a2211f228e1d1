"""A vehicle file that its user edits between flights, as live identification goes by it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from gcs.live.vehiclefile import WatchedVehicle
from sim_vehicle.vehicle.vehicle_file import VEHICLES, Vehicle, load_vehicle


@pytest.fixture
def craft(tmp_path: Path) -> Path:
    """A vehicle file of one's own, with the bench points that it names beside it."""
    for path in VEHICLES.glob("iitb-mav*"):
        shutil.copy(path, tmp_path)
    return tmp_path / "iitb-mav.toml"


def edit(craft: Path, old: str, new: str) -> None:
    text = craft.read_text(encoding="utf-8")
    assert old in text
    craft.write_text(text.replace(old, new, 1), encoding="utf-8")


def test_a_file_that_says_the_same_as_before_is_no_news(craft: Path) -> None:
    watched = WatchedVehicle(str(craft))
    craft.touch()
    assert not watched.look()
    assert watched.notes == ()


def test_a_changed_file_counts_from_the_next_look_on_with_its_doubts(craft: Path) -> None:
    watched = WatchedVehicle(str(craft))
    mass = watched.vehicle.mass.mass
    edit(craft, f"\nmass = {mass}", f"\nmass = {1000 * mass}")
    assert watched.look()
    assert watched.vehicle.mass.mass == 1000 * mass
    assert watched.notes[0].startswith("iitb-mav.toml has changed: coefficients begin anew with it")
    assert "mass" in watched.notes[1]
    assert not watched.look()
    assert watched.notes
    watched.end_flight()
    assert watched.notes == ()


def test_changed_bench_points_are_another_vehicle(craft: Path) -> None:
    watched = WatchedVehicle(str(craft))
    points = next(entry.points for entry in watched.vehicle.calibration.values() if isinstance(entry.points, Path))
    points.write_text(points.read_text(encoding="utf-8").rstrip("\n") + "\n\n", encoding="utf-8")
    assert watched.look()


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [("[mass]", "[mass", "TOML"), ("\nmass = ", "\nmass = -", "mass"), ('.csv"', '-gone.csv"', "gone.csv")],
)
def test_a_file_that_has_become_bad_leaves_the_old_one_until_it_is_mended(
    craft: Path, old: str, new: str, word: str
) -> None:
    watched = WatchedVehicle(str(craft))
    before = watched.vehicle
    edit(craft, old, new)
    assert not watched.look()
    assert watched.vehicle is before
    (note,) = watched.notes
    assert word in note
    assert "goes on with what was read before" in note
    watched.end_flight()
    assert watched.notes == (note,)
    edit(craft, new, old)
    assert not watched.look()
    assert watched.notes == ()


def test_a_file_that_is_gone_leaves_the_old_one(craft: Path) -> None:
    watched = WatchedVehicle(str(craft))
    craft.rename(craft.with_suffix(".away"))
    assert not watched.look()
    assert "no such vehicle file" in watched.notes[0]


def test_a_file_that_is_bad_from_the_start_is_kept_out_until_it_is_mended(craft: Path) -> None:
    good = craft.read_text(encoding="utf-8")
    craft.write_text("mass = 1", encoding="utf-8")
    watched = WatchedVehicle(str(craft))
    assert watched.vehicle is None
    (note,) = watched.notes
    assert "waits until it is corrected" in note
    assert not watched.look()
    assert watched.notes == (note,)
    craft.write_text(good, encoding="utf-8")
    assert watched.look()
    assert watched.vehicle is not None


def test_bench_points_that_come_after_the_file_that_names_them_mend_it(craft: Path) -> None:
    watched = WatchedVehicle(str(craft))
    points = next(entry.points for entry in watched.vehicle.calibration.values() if isinstance(entry.points, Path))
    edit(craft, points.name, "later.csv")
    assert not watched.look()
    assert "later.csv" in watched.notes[0]
    shutil.copy(points, craft.parent / "later.csv")
    assert watched.look()


def test_what_is_saved_while_the_file_is_read_is_news_at_the_next_look(
    craft: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watched = WatchedVehicle(str(craft))
    assert watched.vehicle is not None
    mass = watched.vehicle.mass.mass
    edit(craft, f"\nmass = {mass}", f"\nmass = {2 * mass}")

    def saved_meanwhile(name: str) -> Vehicle:
        found = load_vehicle(name)
        edit(craft, f"\nmass = {2 * mass}", f"\nmass = {3 * mass}")
        monkeypatch.setattr("gcs.live.vehiclefile.load_vehicle", load_vehicle)
        return found

    monkeypatch.setattr("gcs.live.vehiclefile.load_vehicle", saved_meanwhile)
    assert watched.look()
    assert watched.vehicle.mass.mass == 2 * mass
    assert watched.look()
    assert watched.vehicle.mass.mass == 3 * mass
    assert not watched.look()
