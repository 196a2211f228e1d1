"""Uploads on their way into the catalogue: read in a process of their own, then given an id that nobody else has."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gcs.catalogue.flight_table import Flight
from gcs.catalogue.intake import flight_stamp, numbered_ids
from gcs.catalogue.store import Catalogue
from gcs.errors import ImportFileError
from gcs.jobs.limits import memory_limit
from gcs.jobs.one_shot_process import AskedOnce
from gcs.jobs.places import Places
from gcs.settings import Settings

_MAX_NAME = 200
_MAPPING = "columns.toml"
# The largest upload takes minutes; what takes longer never ends.
_LONGEST_S = 1800.0
# So many are received, wait for their turn or are read at a time; each may keep a thread that others need.
_MOST_PLACES, _MOST_OF_ONE = 8, 3
# What file systems say that have one name for each file (FAT, some network shares).
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.ENOSYS)


class Uploads:
    """Turns uploaded files into flights, one at a time. `worker` is the command that reads one.

    longest_s, memory_bytes: what reading one may take; memory as `memory_limit` has it unless said otherwise.
    """

    def __init__(
        self,
        settings: Settings,
        catalogue: Catalogue,
        worker: Sequence[str] = (sys.executable, "-m", "gcs.jobs.intakeworker"),
        longest_s: float = _LONGEST_S,
        memory_bytes: int | None = None,
    ) -> None:
        self._settings = settings
        self._catalogue = catalogue
        self._memory_bytes = memory_bytes or memory_limit()
        self._reader = AskedOnce(worker, longest_s)
        # Held for an upload from its first byte until it is a flight.
        self.places = Places(_MOST_PLACES, _MOST_OF_ONE, "files are being taken in")

    def take_in(self, upload: Path, original_name: str, columns: str = "") -> Flight:
        """Make an uploaded file a flight of the catalogue. The original name is shown, never used as a path.

        columns: TOML that says what the columns of a table are (docs/howto/tables.md).
        Further files are made beside `upload`. Raises ImportFileError when it is no recording, ServiceError when the
        service is being stopped, CatalogueFileError; no flight is left behind then.
        """
        shown = original_name.replace("\\", "/").rpartition("/")[2][:_MAX_NAME] or "upload.mcap"
        converted = upload.with_name("converted.mcap")
        entry = Flight(**self._read(upload, converted, shown, columns))
        if entry.messages == 0:
            raise ImportFileError(f"{shown} holds no MAVLink message; nothing to take in")
        return self._list(entry, converted)

    def close(self) -> None:
        """End what is being read; nothing more is taken in."""
        self._reader.close()

    def _read(self, upload: Path, converted: Path, shown: str, columns: str) -> dict[str, Any]:
        """Write the recording to `converted`; its entry in the catalogue, as JSON."""
        mapping = upload.with_name(_MAPPING)
        if columns.strip():
            mapping.write_text(columns, encoding="utf-8")
        order = {
            "columns": mapping if columns.strip() else None,
            "source": upload,
            "target": converted,
            "ending": Path(shown).suffix,
            "name": shown,
            "memory_bytes": self._memory_bytes,
        }
        try:
            answered = self._reader.ask(order, upload.parent, shown, ImportFileError)
        except ImportFileError as error:
            words = str(error).replace(str(upload), shown).replace(str(mapping), _MAPPING)
            raise ImportFileError(words) from error
        return dict(answered["flight"])

    def _list(self, entry: Flight, converted: Path) -> Flight:
        """Give the flight an id, which is taken in the catalogue first, and the recording its place."""
        folder = self._settings.flights
        for flight_id in numbered_ids(f"{flight_stamp(entry.start_ns)}-{entry.system or 0}"):
            path = folder / f"{flight_id}.mcap"
            reserved = replace(entry, id=flight_id, file=path.name)
            if path.exists() or not self._catalogue.add_flight(reserved):
                continue
            try:
                _place(converted, path)
                break
            except FileExistsError:
                self._catalogue.remove_flight(flight_id)
            except OSError as error:
                self._catalogue.remove_flight(flight_id)
                raise ImportFileError(f"{entry.name} cannot be kept: {error.strerror}; is the disk full?") from error
        flight = replace(reserved, state="complete")
        self._catalogue.put_flight(flight)
        return flight


def _place(source: Path, target: Path) -> None:
    """Move a file to a name that nothing has: not over a recording that was begun meanwhile. FileExistsError else."""
    try:
        os.link(source, target)
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        target.open("xb").close()
        try:
            os.replace(source, target)
        except OSError:
            target.unlink(missing_ok=True)
            raise
    else:
        source.unlink()
