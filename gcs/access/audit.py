"""The log of who did what: a line of JSON for each request that changed something, and in a file of their own refusals.

What was refused, and what changes nothing, is written sparingly, so that nobody can push out what others did.
"""

from __future__ import annotations

import json
import logging
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gcs.access.roles import Role
from gcs.text.utctext import utc_text

_log = logging.getLogger(__name__)

# Of one file; the one before is kept beside it.
_MOST_BYTES = 5_000_000
_LONGEST = 200  # characters of a path
# Of one who asks so many refusals have a line in each minute, and so many who ask are distinguished; one line counts
# the rest.
_FIRST, _MOST_ASKING = 5, 60
_MINUTE_S = 60.0
_CHANGING = (Role.OPERATOR.word, Role.ADMIN.word)
_Line = dict[str, Any]


class Audit:
    """Appends to two files in a folder that is there. Thread-safe.

    changes: of requests that changed something; refusals: of those that were refused, or came from who changes nothing.
    clock: seconds, ever later.
    """

    def __init__(self, changes: Path, refusals: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._changes, self._refusals = _File(changes), _File(refusals)
        self._clock, self._lock = clock, threading.Lock()
        self._asking: dict[str, _Asking] = {}

    def note(self, who: str, role: str, address: str, method: str, path: str, status: int) -> None:
        """Write a line; what cannot be written is logged once, and stops nobody. who, role: empty for strangers."""
        line = {"time": utc_text(time.time_ns()), "who": who, "role": role, "address": address, "method": method,
                "path": path[:_LONGEST], "status": status}  # fmt: skip
        with self._lock:
            self._sum_up(self._clock() - _MINUTE_S)
            # What broke off in the middle may have changed something.
            if role in _CHANGING and (status < 400 or status == 500):
                self._changes.append(line)
            else:
                self._note_refusal(who or address, line)

    def last(self, count: int, changes_alone: bool = False) -> list[_Line]:
        """The newest lines of both files, the newest first; a line that a power cut left in pieces is none."""
        with self._lock:
            self._sum_up(self._clock() - _MINUTE_S)
            lines = self._changes.last(count) + ([] if changes_alone else self._refusals.last(count))
        return sorted(lines, key=lambda line: str(line.get("time")), reverse=True)[:count]

    def close(self) -> None:
        """Write what is only counted yet."""
        with self._lock:
            self._sum_up(self._clock())

    def _note_refusal(self, asking: str, line: _Line) -> None:
        if asking not in self._asking and len(self._asking) >= _MOST_ASKING:
            asking = ""  # all others together
        found = self._asking.setdefault(asking, _Asking(self._clock()))
        found.seen += 1
        found.latest = line
        if found.seen <= _FIRST:
            self._refusals.append(line)

    def _sum_up(self, until: float) -> None:
        """Write one line of what had none, of each who began to ask before a moment, and begin to count anew."""
        for asking, found in list(self._asking.items()):
            if found.began <= until:
                del self._asking[asking]
                if found.seen > _FIRST:
                    self._refusals.append({**found.latest, "count": found.seen - _FIRST})


@dataclass
class _Asking:
    """Refusals of one who asks since a moment of the clock: how many, and the line of the latest."""

    began: float
    seen: int = 0
    latest: _Line = field(default_factory=dict)


class _File:
    """Lines of JSON in a file, and in the full one before it."""

    def __init__(self, path: Path) -> None:
        self._path, self._before, self._failed = path, path.with_suffix(".1.jsonl"), False

    def append(self, line: _Line) -> None:
        try:
            if self._path.exists() and self._path.stat().st_size > _MOST_BYTES:
                self._path.replace(self._before)
            with os.fdopen(os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), "w") as file:
                file.write(json.dumps(line) + "\n")
            self._failed = False
        except OSError as error:
            if not self._failed:
                _log.warning("%s: what is done is not logged: %s", self._path, error.strerror)
            self._failed = True

    def last(self, count: int) -> list[_Line]:
        """The newest lines, the newest first."""
        lines: deque[_Line] = deque(maxlen=count)
        for path in (self._before, self._path):
            if path.exists():
                with path.open(encoding="utf-8", errors="replace") as file:
                    for line in file:
                        with suppress(ValueError):
                            lines.append(json.loads(line))
        return list(reversed(lines))
