"""Backups of the catalogue, once a day, of which the last few are kept."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from gcs.catalogue.store import Catalogue

_PERIOD_S = 86_400.0
_KEPT = 3
# Recordings come first: so many times its size must stay free on the disk beside a backup.
_ROOM = 20


def backups_in(folder: Path) -> list[Path]:
    """The backups in a folder, newest first."""
    return sorted(folder.glob("catalogue-*.sqlite"), reverse=True)


class Backups:
    """Makes them. `clock` gives UTC in ns."""

    def __init__(self, folder: Path, catalogue: Catalogue, clock: Callable[[], int]) -> None:
        self._folder, self._catalogue, self._clock = folder, catalogue, clock

    def make_if_due(self) -> None:
        """Make one if the newest is a day old and the disk has room. Raises CatalogueFileError, OSError."""
        now = datetime.fromtimestamp(self._clock() / 1e9, UTC)
        there = backups_in(self._folder)
        if there and 0.0 <= now.timestamp() - there[0].stat().st_mtime < _PERIOD_S:
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        if shutil.disk_usage(self._folder).free < _ROOM * self._catalogue.size_bytes:
            return
        self._catalogue.back_up(self._folder / f"catalogue-{now:%Y%m%dT%H%M%SZ}.sqlite")
        for old in backups_in(self._folder)[_KEPT:]:
            old.unlink(missing_ok=True)
