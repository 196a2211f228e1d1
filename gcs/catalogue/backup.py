"""Backups of the catalogue, once a day, of which the last few are kept."""

from __future__ import annotations

import math
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
        # One of the future was made while this computer's clock was wrong.
        ages = {path: now.timestamp() - path.stat().st_mtime for path in backups_in(self._folder)}
        if any(0.0 <= age < _PERIOD_S for age in ages.values()) or not self._catalogue.flights(1):
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        for left in self._folder.glob("*.unfinished"):
            left.unlink(missing_ok=True)
        if shutil.disk_usage(self._folder).free < _ROOM * self._catalogue.size_bytes:
            return
        self._catalogue.back_up(self._folder / f"catalogue-{now:%Y%m%dT%H%M%SZ}.sqlite")
        for old in sorted(ages, key=lambda path: ages[path] if ages[path] >= 0.0 else math.inf)[_KEPT - 1 :]:
            old.unlink(missing_ok=True)
