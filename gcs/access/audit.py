"""The log of who did what: a line of JSON for each request that changes something, or was refused."""

from __future__ import annotations

import json
import logging
import os
import threading
import time
from collections import deque
from pathlib import Path

from gcs.text.utctext import utc_text

_log = logging.getLogger(__name__)

# Of one file; the one before is kept beside it.
_MOST_BYTES = 5_000_000


class Audit:
    """Appends to `path`, in a folder that is there."""

    def __init__(self, path: Path) -> None:
        self._path, self._lock = path, threading.Lock()
        self._failed = False

    def note(self, who: str, role: str, address: str, method: str, path: str, status: int) -> None:
        """Write a line; what cannot be written is logged once, and stops nobody."""
        line = {"time": utc_text(time.time_ns()), "who": who, "role": role, "address": address, "method": method,
                "path": path, "status": status}  # fmt: skip
        with self._lock:
            try:
                if self._path.exists() and self._path.stat().st_size > _MOST_BYTES:
                    self._path.replace(self._path.with_suffix(".1.jsonl"))
                with os.fdopen(os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), "w") as file:
                    file.write(json.dumps(line) + "\n")
            except OSError as error:
                if not self._failed:
                    _log.warning("%s: what is done is not logged: %s", self._path, error.strerror)
                self._failed = True

    def last(self, count: int) -> list[dict[str, object]]:
        """The newest lines, the newest first."""
        lines: deque[str] = deque(maxlen=count)
        for path in (self._path.with_suffix(".1.jsonl"), self._path):
            if path.exists():
                with path.open(encoding="utf-8") as file:
                    lines.extend(file)
        return [json.loads(line) for line in reversed(lines) if line.endswith("\n")]
