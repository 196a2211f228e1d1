"""The vehicle file that live identification goes by: looked at again when a flight begins, kept where it became bad."""

from __future__ import annotations

import hashlib
from pathlib import Path

from gcs.errors import GcsError
from gcs.live.signals import SignalStream
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle
from sysid.errors import SysidError
from sysid.live.identifier import LiveIdentifier


class WatchedVehicle:
    """A vehicle file that its user may edit between flights.

    vehicle: what counts; None while the file has been bad since the process began. notes: what its user is to know
    while this flight lasts; the first line alone says what happened, the others what is doubtful in a new file.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self.vehicle: Vehicle | None = None
        self.notes: tuple[str, ...] = ()
        # What the files held that were read last, and those that count; empty where that is not known.
        self._seen: tuple[str, ...] = ()
        self._used: tuple[str, ...] = ()
        self._bad = False
        if self.look():
            self.notes = ()

    def look(self) -> bool:
        """Look at the file again: whether another vehicle counts from now on. A new look may have changed `notes`."""
        # A bad file may be corrected by what is beside it, such as the bench points that it names.
        if self.vehicle is not None and not self._bad and _content(self._name, self.vehicle) == self._seen:
            return False
        given = Path(self._name)
        before = _digest(given)
        try:
            vehicle = load_vehicle(self._name)
            # What the flight would stumble over is stumbled over here, where there is another to go on with.
            SignalStream(vehicle)
            LiveIdentifier(vehicle)
        except (GcsError, SysidError, SimVehicleError) as error:
            self._bad = True
            self._refuse(str(error))
            return False
        self._bad = False
        # A file with other calibration tables has other points beside it.
        self._seen = _content(self._name, vehicle)
        if self.vehicle is not None and self._seen == self._used:
            self.notes = ()  # corrected by putting back what was there
            return False
        if _digest(given) != before:
            self._seen = ()  # saved while it was read: the next look finds what is in it now
        self._used = self._seen
        self.vehicle = vehicle
        doubts = (f"{vehicle.path.name}: {doubt}" for doubt in vehicle.warnings)
        self.notes = (f"{vehicle.path.name} has changed: coefficients begin anew with it ({vehicle.name})", *doubts)
        return True

    def _refuse(self, why: str) -> None:
        meanwhile = "waits until it is corrected"
        if self.vehicle is not None:
            meanwhile = f"goes on with what was read before ({self.vehicle.name})"
        self.notes = (f"the vehicle file cannot be used ({why}); live identification {meanwhile}",)

    def end_flight(self) -> None:
        """A change was news for the flight that began with it; a bad file is news until it is corrected."""
        if not self._bad:
            self.notes = ()


def _content(name: str, vehicle: Vehicle) -> tuple[str, ...]:
    """What the file and the calibration points beside it hold: an editor's new stamp on the old text is no change."""
    given = Path(name)
    points = (entry.points for entry in vehicle.calibration.values())
    paths = [given if given.exists() else vehicle.path, *(path for path in points if isinstance(path, Path))]
    return tuple(map(_digest, paths))


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        return f"{path}: {error.strerror}"
