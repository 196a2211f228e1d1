"""Whether a file can be written: better known before a flight or a job than behind it."""

from __future__ import annotations

import os
from pathlib import Path


def unwritable(path: Path) -> str | None:
    """Why nothing can be written to `path`, as the end of a sentence about it; None where it can.

    Only the attempt shows for sure (a read-only disk, a folder that root may write to in name alone), so it is made,
    and leaves nothing behind.
    """
    if path.is_dir():
        return "is a folder"
    if not path.parent.is_dir():
        return "is in no existing folder"
    there = os.path.lexists(path)
    if there and not path.is_file():
        # A pipe or a device, which opening may wait for.
        return None if os.access(path, os.W_OK) else "is not to be written"
    try:
        with path.open("ab"):
            pass
    except OSError as error:
        return f"is not to be written ({error.strerror})"
    if not there:
        path.unlink()
    return None
