"""The log of who did what: a line of JSON for each request that changes something, or was refused."""

from __future__ import annotations

import json
import logging
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from gcs.text.utctext import utc_text

_log = logging.getLogger(__name__)

# Of one file; the one before is kept beside it.
_MOST_BYTES = 5_000_000
_LONGEST = 200  # characters of a path
_STRANGERS = 60


class Audit:
    """Appends to `path`, in a folder that is there. clock: seconds, ever later."""

    def __init__(self, path: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._path, self._clock, self._lock = path, clock, threading.Lock()
        self._failed = False
        self._minute, self._strangers = clock(), 0

    def note(self, who: str, role: str, address: str, method: str, path: str, status: int) -> None:
        """Write a line; what cannot be written is logged once, and stops nobody.

        Of strangers there are so many lines a minute, that they cannot push out what others did.
        """
        line = {"time": utc_text(time.time_ns()), "who": who, "role": role, "address": address, "method": method,
                "path": path[:_LONGEST], "status": status}  # fmt: skip
        with self._lock:
            if self._clock() - self._minute >= 60.0:
                self._minute, self._strangers = self._clock(), 0
            self._strangers += not who
            if not who and self._strangers > _STRANGERS:
                return
            try:
                if self._path.exists() and self._path.stat().st_size > _MOST_BYTES:
                    self._path.replace(self._path.with_suffix(".1.jsonl"))
                with os.fdopen(os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), "w") as file:
                    file.write(json.dumps(line) + "\n")
                self._failed = False
            except OSError as error:
                if not self._failed:
                    _log.warning("%s: what is done is not logged: %s", self._path, error.strerror)
                self._failed = True

    def last(self, count: int) -> list[dict[str, object]]:
        """The newest lines, the newest first; a line that a power cut left in pieces is none."""
        lines: deque[dict[str, object]] = deque(maxlen=count)
        for path in (self._path.with_suffix(".1.jsonl"), self._path):
            if path.exists():
                with path.open(encoding="utf-8", errors="replace") as file:
                    for line in file:
                        with suppress(ValueError):
                            lines.append(json.loads(line))
        return list(reversed(lines))
