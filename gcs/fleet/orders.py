"""Which flights a batch works on: recordings and logs in folders, by patterns or addresses, and their aircraft."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from gcs.errors import SettingsError, in_words
from gcs.recording.container import LOG_ENDINGS
from gcs.version import VERSION

# The vehicle file of all flights in its folder.
OF_FOLDER = "vehicle.toml"
# Tables and texts are flights where a pattern names them: in a folder they are bench points, what a batch has written,
# and what programs have to say.
_TABLES = (".csv", ".tsv", ".txt", ".log", ".parquet", ".mat", ".npz")
_FLIGHTS = (".mcap", *(one for one in LOG_ENDINGS if one not in _TABLES))


@dataclass(frozen=True)
class Order:
    """One job: of a flight, or of a campaign, whose flights are estimated together.

    source: the flight's file or address, or the campaign's folder; flights: the files; vehicle: the vehicle file's, or
    a built-in name; aircraft: what it is counted under. stamp: of the files as they were, so that another file under
    the same name is another job.
    """

    source: str
    flights: tuple[str, ...]
    vehicle: str
    aircraft: str
    options: Mapping[str, Any]
    stamp: str

    @property
    def name(self) -> str:
        """Of the flight, or of the campaign's folder."""
        place = PurePosixPath(self.source)
        return place.stem if self.source in self.flights else place.name

    @property
    def key(self) -> str:
        """Names the job's result: of flight or campaign the name, and a digest of all that the result depends on."""
        digest = hashlib.sha256(json.dumps([VERSION, asdict(self)], sort_keys=True).encode()).hexdigest()[:12]
        return f"{self.name[:100]}-{digest}"


def orders(
    sources: Sequence[str], vehicle: str | None, options: Mapping[str, Any], campaigns: bool = False
) -> list[Order]:
    """A job for each flight that folders, patterns and addresses name, each flight once; with `campaigns` for each
    folder and vehicle in it, whose flights are estimated together.

    vehicle: of flights in whose folder there is no vehicle.toml. A folder's flights, and those of folders in it, are
    counted under the name of the folder that they lie in where it has a vehicle.toml, else under the vehicle's.
    Raises SettingsError where nothing is found, or a flight has no vehicle.
    """
    found: dict[str, tuple[str, str, str | None]] = {}
    for source in sources:
        every = _expanded(source)
        if not every:
            raise SettingsError(f"{source}: no recording or log there ({', '.join(_FLIGHTS)})")
        for place, stamp in every:
            own = _own_vehicle(place, source)
            if own is None and vehicle is None:
                raise SettingsError(f"{place}: no vehicle; give --vehicle, or put {OF_FOLDER} into its folder")
            found[place] = (str(own or vehicle), stamp, own)
    names = _names({craft for craft, _, _ in found.values()})
    grouped: dict[tuple[str, str], list[str]] = {}
    for place, (craft, _, _) in found.items():
        grouped.setdefault((_folder_of(place) if campaigns else place, craft), []).append(place)
    return [
        Order(
            source, tuple(places), craft, names[craft], dict(options),
            " ".join([*(found[place][1] for place in places), _stamp_of(craft)]),
        )
        for (source, craft), places in grouped.items()
    ]  # fmt: skip


def _folder_of(place: str) -> str:
    return place.rpartition("/")[0] if "://" in place else str(Path(place).parent)


def _names(vehicles: Collection[str]) -> dict[str, str]:
    """What aircraft are called: their folder, or their file; with as much of the path as two of them differ by."""
    parts = {}
    for one in vehicles:
        path = PurePosixPath(one)
        parts[one] = list(path.parts[:-1]) if path.name == OF_FOLDER else [path.stem]
    depth = 1
    while True:
        names = {one: "/".join(own[-depth:]) for one, own in parts.items()}
        if len(set(names.values())) == len(names) or depth > max(map(len, parts.values())):
            return names
        depth += 1


def _expanded(source: str) -> list[tuple[str, str]]:
    """Places and stamps of the flights that a source names."""
    if "://" in source:
        return _at_address(source)
    path = Path(source)
    if path.is_dir():
        every = [one for one in path.rglob("*") if _is_flight(one.name)]
    elif path.is_file():
        every = [path]
    else:
        every = list(Path(path.anchor or ".").glob(str(path.relative_to(path.anchor))))
    return [(str(one.absolute()), _stamp_of(one)) for one in sorted(every) if one.is_file()]


def _at_address(source: str) -> list[tuple[str, str]]:
    try:
        import fsspec  # type: ignore[import-untyped]
    except ImportError:
        raise SettingsError(f"{source}: addresses need fsspec: install the extra 'fleet'") from None
    try:
        files, root = fsspec.core.url_to_fs(source)
        pattern = any(mark in root for mark in "*?[")
        names = files.glob(root) if pattern else files.find(root)
        return [
            (files.unstrip_protocol(name), str(files.ukey(name))) for name in sorted(names)
            if pattern or _is_flight(name) or name == root
        ]  # fmt: skip
    except Exception as error:  # every store's library has its own
        raise SettingsError(f"{source}: {in_words(error)}") from None


def _is_flight(name: str) -> bool:
    return name.lower().endswith(_FLIGHTS)


def _own_vehicle(place: str, source: str) -> str | None:
    """The vehicle file of the nearest folder above a flight that has one, up to the source."""
    if "://" in place:
        return None
    top, above = Path(source).absolute(), Path(place).parents
    folders = [one for one in above if one.is_relative_to(top)] if top.is_dir() else above[:1]
    return next((str(one / OF_FOLDER) for one in folders if (one / OF_FOLDER).is_file()), None)


def _stamp_of(path: Path | str) -> str:
    """Size and time of a file; the text itself of what is none, as the name of a built-in vehicle."""
    try:
        status = Path(path).stat()
    except OSError:
        return str(path)
    return f"{status.st_size} {status.st_mtime_ns}"
