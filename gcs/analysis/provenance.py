"""What repeats a result: time, versions, settings, and the files that went in."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from gcs.version import VERSION

_LIBRARIES = ("numpy", "scipy", "numba", "pymavlink")
_DIGITS = 12


def made(settings: Mapping[str, Any], files: Sequence[Path]) -> dict[str, Any]:
    """The block `made` of a result. settings: by name, those of None left out. files: all that were read."""
    return {
        "utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": {
            "gcs": VERSION,
            "analysis": code_digest(),
            "python": platform.python_version(),
            **{name: metadata.version(name) for name in _LIBRARIES},
        },
        "settings": {name: value for name, value in settings.items() if value is not None},
        "files": [{"name": path.name, "sha256": _digest(path)} for path in dict.fromkeys(files)],
    }


@cache
def code_digest(root: Path = Path(__file__).parents[2]) -> str:
    """The first digits of a SHA-256 of the code that analyses, so that a result says which settings it rests on."""
    digest = hashlib.sha256()
    for path in sorted(path for package in ("sim_vehicle", "sysid") for path in (root / package).rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:_DIGITS]


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
