"""The record of one span of a flight."""

from __future__ import annotations

from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.signals.flight import FlightData
from sysid.signals.record import Record, make_records


def make_record(data: FlightData, vehicle: Vehicle, start: int, stop: int) -> Record:
    """The samples start ... stop - 1 of a flight."""
    return make_records(data, vehicle, [(start, stop)])[0]
