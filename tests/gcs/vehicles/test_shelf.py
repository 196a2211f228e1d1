"""Aircraft kept in versions."""

from pathlib import Path

import pytest

from gcs.errors import CatalogueError, VehicleError
from gcs.vehicles.document import Answers, with_answers
from gcs.vehicles.shelf import VehicleShelf
from sim_vehicle.errors import VehicleFileError
from sim_vehicle.vehicle.vehicle_file import load_vehicle


def plane(name: str = "My Plane", mass: float = 1.0) -> str:
    numbers = {"mass_kg": mass, "span_m": 1.2, "area_m2": 0.24, "chord_m": 0.2}
    return with_answers("", Answers(name, numbers))


def test_a_changed_aircraft_keeps_the_version_that_flights_name(tmp_path: Path) -> None:
    shelf = VehicleShelf(tmp_path / "vehicles")
    made = shelf.add(plane())
    assert made.reference == "my-plane@1"
    assert shelf.change("my-plane", plane(mass=1.2)).reference == "my-plane@2"
    assert shelf.change("my-plane", plane(mass=1.2)).version == 2  # nothing has changed
    assert shelf.get("my-plane").vehicle.mass.mass == 1.2
    assert shelf.get("my-plane@1").vehicle.mass.mass == 1.0
    assert load_vehicle(shelf.path("my-plane@1")).mass.mass == 1.0
    assert shelf.versions("my-plane") == [1, 2]
    shelf.remove("my-plane")
    assert shelf.all() == []
    assert shelf.get("my-plane@1").vehicle.mass.mass == 1.0
    with pytest.raises(VehicleError, match="was deleted; POST"):
        shelf.change("my-plane", plane(mass=1.3))
    assert shelf.restore("my-plane").version == 2
    assert shelf.change("my-plane", plane(mass=1.2).replace("\n", "\r\n")).version == 2
    assert [one.id for one in shelf.all()] == ["my-plane"]


def test_names_make_ids_that_are_safe_and_unlike(tmp_path: Path) -> None:
    shelf = VehicleShelf(tmp_path / "vehicles", "iitb-mav")
    ids = [shelf.add(plane(name)).id for name in ("Möwe / 2", "Möwe / 2", "../..", "station", "飛行機", "New")]
    assert ids == ["mowe-2", "mowe-2-2", "aircraft", "station-2", "aircraft-2", "new-2"]
    assert next(one.id for one in shelf.all()) == "station"
    for name in ("../x", "my plane", "a@0", "", "MOWE-2", "x" * 90):
        with pytest.raises(CatalogueError, match="names no aircraft"):
            shelf.path(name)
    with pytest.raises(CatalogueError, match=r"there is no aircraft 'mowe-2@7'; this station knows: station, aircraft"):
        shelf.path("mowe-2@7")


def test_what_is_no_aircraft_leaves_nothing(tmp_path: Path) -> None:
    shelf = VehicleShelf(tmp_path / "vehicles")
    with pytest.raises(VehicleFileError, match="mass is missing"):
        shelf.add("name = 'x'")
    with pytest.raises(VehicleError, match="of more than 100 kB"):
        shelf.add("#" * 100_001)
    shelf.add(plane())
    with pytest.raises(VehicleFileError):
        shelf.change("my-plane", plane(mass=-1.0))
    assert sorted(path.name for path in (tmp_path / "vehicles").rglob("*")) == ["1.toml", "my-plane"]


def test_the_file_of_the_service_is_what_its_user_makes_it(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text(plane("Own"))
    shelf = VehicleShelf(tmp_path / "vehicles", str(path))
    assert shelf.get("station").reference == "station"
    path.write_text(plane("Own", 1.5))
    assert shelf.get("station").vehicle.mass.mass == 1.5
    with pytest.raises(VehicleError, match="edit the file, or go on with a copy"):
        shelf.change("station", plane())
    with pytest.raises(VehicleError):
        shelf.remove("station")


def test_a_link_in_the_folder_is_not_followed(tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "1.toml").write_text(plane())
    (tmp_path / "vehicles").mkdir()
    (tmp_path / "vehicles" / "linked").symlink_to(outside)
    with pytest.raises(CatalogueError, match="there is no aircraft"):
        VehicleShelf(tmp_path / "vehicles").get("linked")
