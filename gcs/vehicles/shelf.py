"""The aircraft that a station knows: every version of every vehicle file, each a file that never changes."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import threading
import unicodedata
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from gcs.catalogue.aircraft_rule import STATION
from gcs.catalogue.intake import numbered_ids
from gcs.errors import CatalogueError, VehicleError
from gcs.vehicles.document import with_points_inside
from sim_vehicle.errors import SimVehicleError, VehicleFileError
from sim_vehicle.vehicle.vehicle_file import Vehicle, load_vehicle, vehicle_from_text

#: Largest text of a vehicle file, bytes; and how many aircraft and versions of one there may be.
LARGEST = 100_000
_MOST_VEHICLES, _MOST_VERSIONS, _MOST_FOLDERS = 500, 1000, 5000
_REMOVED = "removed"
_LONGEST_ID = 40
_REFERENCE = re.compile(r"([a-z0-9-]{1,60})(?:@([1-9][0-9]{0,5}))?")


@dataclass(frozen=True)
class Shelved:
    """One version of an aircraft.

    reference: id and version, as `my-plane@3`, by which a flight or a job names it for good; of the station's own file
    the id alone, since that is what its user makes it.
    """

    id: str
    version: int
    changed_ns: int
    vehicle: Vehicle

    @cached_property
    def text(self) -> str:
        """Its vehicle file, which needs no file beside it: bench tables stand in it."""
        return with_points_inside(self.vehicle.path.read_text(encoding="utf-8"), self.vehicle)

    @property
    def reference(self) -> str:
        """`id@version`."""
        return self.id if self.id == STATION else f"{self.id}@{self.version}"


class VehicleShelf:
    """The folder of vehicle files, `<id>/<version>.toml`, and the file that the service was started with. Thread-safe.

    station: that file or the name of a built-in vehicle, None where there is none.
    """

    def __init__(self, folder: Path, station: str | None = None) -> None:
        self._folder, self._station = folder, station
        self._lock = threading.RLock()

    @property
    def has_station(self) -> bool:
        """Whether the service was started with an aircraft."""
        return self._station is not None

    def is_listed(self, name: str) -> bool:
        """Whether the aircraft is there and was not removed."""
        return (name == STATION and self.has_station) or name in self.ids()

    def all(self) -> list[Shelved]:
        """The newest version of every aircraft, the station's own first, then by name. Unreadable ones are left out."""
        found = []
        for name in ([STATION] if self._station is not None else []) + self.ids():
            try:
                found.append(self.get(name))
            except (SimVehicleError, CatalogueError):
                continue
        return sorted(found, key=lambda one: (one.id != STATION, one.vehicle.name.casefold(), one.id))

    def get(self, reference: str) -> Shelved:
        """The aircraft `id`, in its newest version, or `id@version`. CatalogueError, VehicleFileError."""
        name, version = _parsed(reference)
        if name == STATION and self._station is not None:
            vehicle = load_vehicle(self._station)
            return Shelved(STATION, 1, vehicle.path.stat().st_mtime_ns, vehicle)
        path = self.path(reference)
        return Shelved(name, version or int(path.stem), path.stat().st_mtime_ns, load_vehicle(path))

    def path(self, reference: str) -> Path:
        """The file of `id` or `id@version`. CatalogueError where there is none."""
        name, version = _parsed(reference)
        if name == STATION and self._station is not None:
            return load_vehicle(self._station).path
        versions = self.versions(name)
        if not versions or (version is not None and version not in versions):
            known = ", ".join(([STATION] if self._station is not None else []) + self.ids()) or "none yet"
            raise CatalogueError(f"there is no aircraft {reference!r}; this station knows: {known}")
        return self._folder / name / f"{version or versions[-1]}.toml"

    def versions(self, name: str) -> list[int]:
        """Numbers of the versions there are, ascending; none of what does not exist."""
        folder = self._folder / name
        if not _REFERENCE.fullmatch(name) or not folder.is_dir() or folder.is_symlink():
            return []
        return sorted(int(file.stem) for file in folder.glob("*.toml") if file.stem.isdigit())

    def add(self, text: str) -> Shelved:
        """A new aircraft, its id made of its name. VehicleFileError if the text is no vehicle file."""
        text = text.replace("\r\n", "\n")  # as it is read back
        vehicle = read_text(text)
        with self._lock:
            taken = {path.name for path in self._folder.iterdir()} if self._folder.is_dir() else set()
            if len(self.ids()) >= _MOST_VEHICLES:
                raise VehicleError(f"there are {_MOST_VEHICLES} aircraft already; delete some")
            if len(taken) >= _MOST_FOLDERS:  # flights name those that were deleted
                raise VehicleError(f"{_MOST_FOLDERS} aircraft were described here, deleted ones too; no more are kept")
            stem = _slug(vehicle.name)
            name = next(name for name in numbered_ids(stem) if name not in {*taken, STATION, "new"})
            return self._write(name, 1, text)

    def change(self, name: str, text: str) -> Shelved:
        """A new version of an aircraft; the newest one where the text is the same. The old ones stay."""
        self._own(name)
        if not self.is_listed(name):
            raise VehicleError(f"{name} was deleted; POST /api/vehicles/{name}/restore takes that back")
        text = text.replace("\r\n", "\n")
        read_text(text)
        with self._lock:
            newest = self.get(name)
            if newest.text == text:
                return newest
            if newest.version >= _MOST_VERSIONS:
                raise VehicleError(f"{name} has {_MOST_VERSIONS} versions; go on with a copy of it")
            return self._write(name, newest.version + 1, text)

    def remove(self, name: str) -> None:
        """Take an aircraft from the list; its versions stay, since flights were identified with them."""
        self._own(name)
        self.path(name)
        (self._folder / name / _REMOVED).touch()

    def restore(self, name: str) -> Shelved:
        """Put an aircraft that was removed into the list again."""
        self._own(name)
        (self._folder / name / _REMOVED).unlink(missing_ok=True)
        return self.get(name)

    def _own(self, name: str) -> None:
        if name == STATION and self._station is not None:
            raise VehicleError(
                "this aircraft is the file that the service was started with: edit the file, or go on with a copy of it"
            )
        if "@" in name or not self.versions(name):
            raise CatalogueError(f"there is no aircraft {name!r}; GET /api/vehicles lists them")

    def ids(self) -> list[str]:
        """Of the aircraft that are described here, but for the station's own file."""
        if not self._folder.is_dir():
            return []
        there = (path for path in self._folder.iterdir() if path.is_dir() and not (path / _REMOVED).exists())
        return sorted(path.name for path in there if self.versions(path.name))

    def _write(self, name: str, version: int, text: str) -> Shelved:
        """Whole or not at all: a version is named by others for good."""
        folder = self._folder / name
        made = not folder.exists()
        folder.mkdir(parents=True, exist_ok=True)
        descriptor, unfinished = tempfile.mkstemp(dir=folder, suffix=".unfinished")
        try:
            with open(descriptor, "w", encoding="utf-8") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            os.replace(unfinished, folder / f"{version}.toml")
        except BaseException:
            Path(unfinished).unlink(missing_ok=True)
            if made:
                shutil.rmtree(folder, ignore_errors=True)
            raise
        return self.get(f"{name}@{version}")


def read_text(text: str) -> Vehicle:
    """The vehicle of a text that names no other file. VehicleFileError, in one line."""
    if len(text.encode()) > LARGEST:
        raise VehicleError(f"a vehicle file of more than {LARGEST // 1000} kB is none; leave some points out")
    try:
        return vehicle_from_text(text, Path("vehicle file"))
    except (ArithmeticError, ValueError) as error:  # numbers beyond all bounds
        raise VehicleFileError(f"vehicle file: a number in it is beyond all bounds ({error})") from error


def _parsed(reference: str) -> tuple[str, int | None]:
    match = _REFERENCE.fullmatch(reference)
    if match is None:
        raise CatalogueError(f"{reference[:80]!r} names no aircraft; GET /api/vehicles lists them")
    return match[1], int(match[2]) if match[2] else None


def _slug(name: str) -> str:
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "-", plain).strip("-")[:_LONGEST_ID].strip("-") or "aircraft"
