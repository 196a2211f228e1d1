"""Files that are written whole or not at all."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

from gcs.errors import SettingsError


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file, a text in UTF-8, beside its place and put it there; what stood there before stays until then.

    Raises SettingsError in one line that names the file where it cannot be written, as on a full disk.
    """
    raw = content.encode() if isinstance(content, str) else content
    path = path.resolve() if path.is_symlink() else path  # a link stays one
    beside = path.with_name(f".{path.name}.{uuid4().hex[:8]}")
    try:
        if path.exists() and not path.is_file():  # a device or a pipe
            path.write_bytes(raw)
            return
        try:
            beside.write_bytes(raw)
            os.replace(beside, path)
        finally:
            with suppress(FileNotFoundError):
                beside.unlink()
    except OSError as error:
        raise SettingsError(f"{path} could not be written: {error.strerror}; give another place for it") from None
