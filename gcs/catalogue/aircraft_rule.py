"""Which jobs are of an aircraft, as a condition of SQL."""

from __future__ import annotations

#: Jobs `j` with an aircraft in any version, by the values of `of_aircraft`; jobs do not name the service's own.
OF_AIRCRAFT = (
    "(substr(json_extract(j.request, '$.vehicle'), 1, ?) = ?"
    " OR (? AND ifnull(json_extract(j.request, '$.vehicle'), 'station') = 'station'))"
)


#: The id of the file that the service was given as --vehicle.
STATION = "station"


def of_aircraft(vehicle: str) -> tuple[object, ...]:
    """Values of the condition for the aircraft of that id."""
    return len(vehicle) + 1, f"{vehicle}@", vehicle == STATION
