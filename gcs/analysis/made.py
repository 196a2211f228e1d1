"""What repeats a result: time, versions, settings, and the files that went in."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from gcs.version import VERSION

_LIBRARIES = ("numpy", "scipy", "numba", "pymavlink")


def made(settings: Mapping[str, Any], files: Sequence[Path]) -> dict[str, Any]:
    """The block `made` of a result. settings: by name, those of None left out. files: all that were read."""
    return {
        "utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": {
            "gcs": VERSION,
            "python": platform.python_version(),
            **{name: metadata.version(name) for name in _LIBRARIES},
        },
        "settings": {name: value for name, value in settings.items() if value is not None},
        "files": [{"name": path.name, "sha256": _digest(path)} for path in dict.fromkeys(files)],
    }


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
