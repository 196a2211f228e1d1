"""What a recording says of itself: software, links, vehicle file, and how far the clock of this computer is right."""

from __future__ import annotations

import ctypes
import logging
import mimetypes
import platform
import sys
from collections.abc import Callable, Sequence
from importlib import metadata
from pathlib import Path

import numpy as np
from mcap.records import Attachment

from gcs.errors import GcsError, RecordingError
from gcs.links.url import link_names, parse_url
from gcs.mavlink.dialect import Dialect, definition_files
from gcs.recording.parts import Provenance
from gcs.version import VERSION
from sim_vehicle.errors import SimVehicleError
from sim_vehicle.vehicle.vehicle_file import load_vehicle

_log = logging.getLogger(__name__)

_TIME_ERROR = 5
_TIMEX_BYTES = 512  # struct timex is 208 bytes on 64-bit Linux; all zero asks and sets nothing


def clock_state() -> str:
    """Whether the system keeps this computer's clock by others: "synchronised", "not synchronised" or "unknown"."""
    if sys.platform != "linux":
        return "unknown"
    state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))
    if state < 0:
        return "unknown"
    return "not synchronised" if state == _TIME_ERROR else "synchronised"


def provenance(dialect: Dialect, urls: Sequence[str], vehicle: str | None, dialect_name: str = "") -> Provenance:
    """Metadata and files that go into every recording of a run.

    urls: the links' connection strings. vehicle: vehicle file or name of a built-in one. dialect_name: as the user
    gave it; a file of that name goes in too, with what it includes from beside it (what pymavlink ships is known by its
    version). Raises LinkUrlError, VehicleFileError, RecordingError.
    """
    software = {
        "gcs": VERSION,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "pymavlink": metadata.version("pymavlink"),
        "dialect": dialect.name,
        "log_time": f"UTC by this computer's clock ({clock_state()} at the start)",
    }
    files: list[Path] = []
    if vehicle is not None:
        craft = load_vehicle(vehicle)
        files = [craft.path, *(entry.points for entry in craft.calibration.values() if isinstance(entry.points, Path))]
        software["vehicle"] = craft.path.name
    if dialect_name.lower().endswith(".xml"):
        files += definition_files(Path(dialect_name))
    links = {name: parse_url(url).kind.value for name, url in zip(link_names(urls), urls, strict=True)}
    return Provenance({"recording": software, "links": links}, tuple(map(_attachment, dict.fromkeys(files))))


class FreshProvenance:
    """Provenance made anew for each recording: the vehicle file may have been edited since the service started.

    make: as `provenance`. What cannot be read any more stays as it was read last: the flight is recorded all the same.
    """

    def __init__(self, make: Callable[[], Provenance]) -> None:
        self._make = make
        self._last = make()

    def __call__(self) -> Provenance:
        try:
            self._last = self._make()
        except (GcsError, SimVehicleError) as error:
            _log.warning("%s; the recording keeps what was read before", error)
        return self._last


def _attachment(path: Path) -> Attachment:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from None
    kind = "application/toml" if path.suffix == ".toml" else mimetypes.guess_type(path.name)[0]
    return Attachment(0, 0, path.name, kind or "application/octet-stream", data)
