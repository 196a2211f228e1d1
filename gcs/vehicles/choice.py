"""Which aircraft a flight was flown with: what a person says, else what was said of the same vehicle before."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gcs.catalogue.aircraft_rule import STATION
from gcs.catalogue.flight_table import Flight
from gcs.catalogue.store import Catalogue
from gcs.errors import CatalogueError, VehicleError
from gcs.vehicles.shelf import Shelved, VehicleShelf
from sim_vehicle.errors import SimVehicleError

# Of a flight that is going on: nothing is later.
_NOW_NS = 2**63 - 1


@dataclass(frozen=True)
class Chosen:
    """An aircraft of the shelf, and why it is the flight's, as the end of a sentence."""

    vehicle: Shelved
    why: str
    by_hand: bool = False


class VehicleChoice:
    """Chooses among the aircraft of a station."""

    def __init__(self, shelf: VehicleShelf, catalogue: Catalogue) -> None:
        self._shelf, self._catalogue = shelf, catalogue

    @property
    def shelf(self) -> VehicleShelf:
        """The aircraft that there are."""
        return self._shelf

    def of(self, flight: Flight) -> Chosen:
        """The aircraft of a flight of the catalogue, as `for_flight` has it."""
        return self.for_flight(flight.id, flight.system, flight.source, flight.start_ns, flight.board)

    def for_flight(
        self,
        flight_id: str,
        system: int | None,
        source: str = "live",
        start_ns: int = _NOW_NS,
        board: str | None = None,
    ) -> Chosen:
        """The aircraft of a flight, which the catalogue need not know yet. board: as of `Flight`.

        Raises VehicleError, in words, where none is known, and VehicleFileError of a bad file.

        By hand; else as for the last flight before it with the same autopilot board for which somebody chose; else as
        for the last one of the same system id, among those that came by a link or among uploads (a friend's log says
        nothing of what flies here), unless it had another board; else the file that the service was started with; else
        the only aircraft there is; else the one that was chosen last.
        """
        if named := self._catalogue.notes(flight_id).vehicle:
            return Chosen(self._shelf.get(named), "chosen by hand", by_hand=True)
        if board is not None:
            before = self._known(self._catalogue.vehicle_of_board(board, start_ns))
            if before is not None:
                return Chosen(before[0], f"as for flight {before[1]}, which had the same autopilot board")
        if system is not None:
            before = self._known(self._catalogue.vehicle_before(system, source, start_ns, board))
            if before is not None:
                return Chosen(before[0], f"as for flight {before[1]}, whose vehicle had the same system id")
        if self._shelf.has_station:
            return Chosen(self._shelf.get(STATION), "the one that this service was started with")
        there = self._shelf.all()
        if len(there) == 1:
            return Chosen(there[0], "the only one that there is")
        last = self._known(self._catalogue.vehicle_chosen_last())
        if last is not None:
            return Chosen(last[0], f"the one that was chosen last, for flight {last[1]}")
        if not there:
            raise VehicleError(
                "no aircraft is known: describe it on the page under Aircraft (or POST /api/vehicles), or start the"
                " service with --vehicle FILE"
            )
        names = ", ".join(one.id for one in there)
        raise VehicleError(f"which aircraft flew this? Choose one on the flight's page, or name it: {names}")

    def file_of(self, flight: Flight) -> Path | None:
        """The vehicle file of a flight; None where nobody knows its aircraft."""
        try:
            return self.of(flight).vehicle.vehicle.path
        except (CatalogueError, VehicleError, SimVehicleError):
            return None

    def require_listed(self, name: str) -> None:
        """CatalogueError unless the aircraft is one of the list."""
        if not self._shelf.is_listed(name):
            names = ", ".join(one.id for one in self._shelf.all()) or "none yet"
            raise CatalogueError(f"there is no aircraft {name!r}; this station knows: {names}")

    def _known(self, found: tuple[str, str] | None) -> tuple[Shelved, str] | None:
        """The aircraft of a choice, unless it was deleted since."""
        if found is None:
            return None
        try:
            return (self._shelf.get(found[0]), found[1]) if self._shelf.is_listed(found[0]) else None
        except (CatalogueError, SimVehicleError):
            return None
