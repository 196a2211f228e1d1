"""The catalogue: flights, jobs, results and models in one SQLite file that survives a crash at any moment."""

from __future__ import annotations

from gcs.catalogue.flight_table import FlightTable
from gcs.catalogue.result_table import ResultTable


class Catalogue(FlightTable, ResultTable):
    """Thread-safe access to the catalogue's file. `clock` gives UTC in ns."""

    def check(self) -> None:
        """Read what the list of flights shows, from the disk. Raises CatalogueFileError."""
        self._readers.refresh()
        ids = [flight.id for flight in self.flights()]
        self.notes_of(ids)
        self.outcomes_of(ids)
        self.outlines_of(ids)
