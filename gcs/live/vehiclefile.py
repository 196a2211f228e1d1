"""The vehicle file that live identification goes by: looked at again when a flight begins, kept where it became bad."""

from __future__ import annotations

import hashlib
from pathlib import Path

from gcs.errors import GcsError
from gcs.live.signals import SignalStream
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.vehicle import Vehicle, load_vehicle
from sysid.errors import SysidError
from sysid.live.identifier import LiveIdentifier


class WatchedVehicle:
    """A vehicle file that its user may edit between flights. Raises what `load_vehicle` raises when it is bad at first.

    vehicle: what counts. notes: what its user is to know while this flight lasts; the first line alone tells what
    happened, the others what is doubtful in a new file.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self.vehicle = load_vehicle(name)
        self._seen = self._used = _content(name, self.vehicle)
        self.notes: tuple[str, ...] = ()

    def look(self) -> bool:
        """Look at the file again: whether another vehicle counts from now on. A new look may have changed `notes`."""
        seen = _content(self._name, self.vehicle)
        if seen == self._seen:
            return False
        try:
            vehicle = load_vehicle(self._name)
            # What the flight would stumble over is stumbled over here, where there is another to go on with.
            SignalStream(vehicle)
            LiveIdentifier(vehicle)
        except (GcsError, SysidError, SimVehicleError) as error:
            self._seen = seen
            self.notes = (
                f"the vehicle file cannot be used ({error}); "
                f"live identification goes on with what was read before ({self.vehicle.name})",
            )
            return False
        # A file with other calibration tables has other points beside it.
        self._seen = _content(self._name, vehicle)
        if self._seen == self._used:
            self.notes = ()  # mended by putting back what was there
            return False
        self._used = self._seen
        self.vehicle = vehicle
        doubts = (f"{vehicle.path.name}: {doubt}" for doubt in vehicle.warnings)
        self.notes = (f"{vehicle.path.name} has changed: coefficients begin anew with it ({vehicle.name})", *doubts)
        return True

    def end_flight(self) -> None:
        """A change was news for the flight that began with it; a bad file is news until it is mended."""
        if self._seen == self._used:
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
