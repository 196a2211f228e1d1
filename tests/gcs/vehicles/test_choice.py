"""Which aircraft flew: two aeroplanes with the usual system id 1, distinguished by their boards."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from gcs.catalogue.flight_table import Flight
from gcs.catalogue.store import Catalogue
from gcs.vehicles.choice import VehicleChoice
from gcs.vehicles.document import Answers, with_answers
from gcs.vehicles.shelf import VehicleShelf


@pytest.fixture
def catalogue(tmp_path: Path) -> Iterator[Catalogue]:
    with closing(Catalogue(tmp_path / "c.sqlite")) as opened:
        yield opened


@pytest.fixture
def choice(catalogue: Catalogue, tmp_path: Path) -> VehicleChoice:
    shelf = VehicleShelf(tmp_path / "vehicles")
    for name in ("Thor", "Loki"):
        numbers = {"mass_kg": 1.0, "span_m": 1.2, "area_m2": 0.24, "chord_m": 0.2}
        shelf.add(with_answers("", Answers(name, numbers)))
    return VehicleChoice(shelf, catalogue)


def flight(catalogue: Catalogue, number: int, board: str | None, source: str = "live", vehicle: str = "") -> Flight:
    """The flight of that number, an hour after the one before, of system 1."""
    start = number * 3600 * 10**9
    made = Flight(f"f{number}", "f.mcap", "f", source, "complete", 1, start, start + 1, 9, 9, board=board)
    catalogue.put_flight(made)
    if vehicle:
        catalogue.change_notes(made.id, vehicle=vehicle)
    return made


def test_boards_decide_where_both_aeroplanes_have_the_same_system_id(
    catalogue: Catalogue, choice: VehicleChoice
) -> None:
    flight(catalogue, 1, "aaaa", vehicle="thor")
    flight(catalogue, 2, "bbbb", vehicle="loki")
    found = choice.of(flight(catalogue, 3, "aaaa"))
    assert (found.vehicle.id, found.why) == ("thor", "as for flight f1, which had the same autopilot board")
    assert choice.of(flight(catalogue, 4, "bbbb")).vehicle.id == "loki"
    # A log from the board's own card too, though it came by another way.
    assert choice.of(flight(catalogue, 5, "aaaa", source="upload")).vehicle.id == "thor"
    assert choice.for_flight("live", 1, board="aaaa").vehicle.id == "thor"


def test_a_board_that_is_new_is_none_of_those_that_are_known(catalogue: Catalogue, choice: VehicleChoice) -> None:
    flight(catalogue, 1, None, vehicle="thor")
    flight(catalogue, 2, "bbbb", vehicle="loki")
    found = choice.of(flight(catalogue, 3, "cccc"))  # not loki's; it may be thor's, which did not say
    assert (found.vehicle.id, found.why) == ("thor", "as for flight f1, whose vehicle had the same system id")
    assert choice.of(flight(catalogue, 4, None)).vehicle.id == "loki"  # nothing says more than the system id


def test_a_person_has_the_last_word_and_later_choices_say_nothing_of_earlier_flights(
    catalogue: Catalogue, choice: VehicleChoice
) -> None:
    flight(catalogue, 2, "aaaa", vehicle="loki")
    found = choice.of(flight(catalogue, 3, "aaaa", vehicle="thor"))
    assert (found.vehicle.id, found.by_hand) == ("thor", True)
    assert choice.of(flight(catalogue, 1, "aaaa")).why == "the one that was chosen last, for flight f3"
