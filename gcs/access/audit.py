"""The log of who did what: a line of JSON for each request that changed something, and in a file of their own refusals.

What was refused, and what changes nothing, is written sparingly, so that nobody can push out what others did.
"""

from __future__ import annotations

import json
import logging
import os
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gcs.access.roles import CHANGES_NOTHING, Role
from gcs.text.utctext import utc_text

_log = logging.getLogger(__name__)

# Of one file. Changes that are full are kept as a file of the next number; of refusals the one before alone is.
_MOST_BYTES = 5_000_000
_LONGEST = 200  # characters of a path
# Of one who asks so many refusals have a line in each minute, and so many who ask are distinguished; one line counts
# the rest.
_FIRST, _MOST_ASKING = 5, 60
# The same change by the same one has so many lines in each minute, and so many changes are distinguished; one line
# counts the rest.
_FIRST_CHANGES, _MOST_CHANGES = 20, 10_000
_MINUTE_S = 60.0
_CHANGING = (Role.OPERATOR.word, Role.ADMIN.word)
_Line = dict[str, Any]


class Audit:
    """Appends to two files in a folder that is there, by a thread of its own, so that nobody waits. Thread-safe.

    changes: of requests that changed something; refusals: of those that were refused, or changed nothing.
    clock: seconds, ever later.
    """

    def __init__(self, changes: Path, refusals: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._changes, self._refusals = _File(changes, keep_all=True), _File(refusals, keep_all=False)
        self._clock, self._lock = clock, threading.Lock()
        self._asking: dict[_File, dict[tuple[str, ...], _Asking]] = {self._changes: {}, self._refusals: {}}
        self._coming: queue.Queue[tuple[_File, _Line] | None] = queue.Queue()
        self._thread: threading.Thread | None = None
        self._closed = False

    def note(self, who: str, role: str, address: str, method: str, path: str, status: int) -> None:
        """Have a line written; what cannot be is logged once, and stops nobody. who, role: empty for strangers."""
        line = {"time": utc_text(time.time_ns()), "who": who, "role": role, "address": address, "method": method,
                "path": path[:_LONGEST], "status": status}  # fmt: skip
        with self._lock:
            self._sum_up(self._clock() - _MINUTE_S)
            # What broke off in the middle may have changed something.
            if role in _CHANGING and (status < 300 or status == 500) and path not in CHANGES_NOTHING:
                self._note_one(self._changes, (who, method, path), line)
            else:
                self._note_one(self._refusals, (who or address,), line)

    def last(self, count: int, changes_alone: bool = False) -> list[_Line]:
        """The newest lines of both files, the newest first; a line that a power cut left in pieces is none."""
        with self._lock:
            self._sum_up(self._clock() - _MINUTE_S)
        self.flush()
        lines = self._changes.last(count) + ([] if changes_alone else self._refusals.last(count))
        return sorted(lines, key=lambda line: str(line.get("time")), reverse=True)[:count]

    def flush(self) -> None:
        """Wait until all lines so far are written."""
        self._coming.join()

    def close(self) -> None:
        """Write all lines, and what is only counted yet, and end the thread; whoever comes later writes by himself."""
        with self._lock:
            self._sum_up(self._clock())
            if not self._closed and self._thread is not None:
                self._coming.put(None)
            self._closed = True
        if self._thread is not None:
            self._thread.join()

    def _note_one(self, file: _File, key: tuple[str, ...], line: _Line) -> None:
        first, most = (_FIRST_CHANGES, _MOST_CHANGES) if file is self._changes else (_FIRST, _MOST_ASKING)
        asking = self._asking[file]
        if key not in asking and len(asking) >= most:
            if file is self._changes:  # no change is ever without a line or a count of its own
                self._sum_up(self._clock())
            else:
                key = ("",)  # all others together
        found = asking.setdefault(key, _Asking(self._clock()))
        found.seen += 1
        found.latest = line
        if found.seen <= first:
            self._write(file, line)

    def _sum_up(self, until: float) -> None:
        """Write one line of what had none, of each who began to ask before a moment, and begin to count anew."""
        for file, first in ((self._changes, _FIRST_CHANGES), (self._refusals, _FIRST)):
            asking = self._asking[file]
            # Those that began first come first.
            while asking and (found := asking[key := next(iter(asking))]).began <= until:
                del asking[key]
                if found.seen > first:
                    self._write(file, {**found.latest, "count": found.seen - first})

    def _write(self, file: _File, line: _Line) -> None:
        if self._closed:
            file.append(line)
            return
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="audit", daemon=True)
            self._thread.start()
        self._coming.put((file, line))

    def _run(self) -> None:
        while True:
            coming = self._coming.get()
            try:
                if coming is None:
                    return
                file, line = coming
                file.append(line)
            finally:
                self._coming.task_done()


@dataclass
class _Asking:
    """What one asks again and again since a moment of the clock: how often, and the line of the latest."""

    began: float
    seen: int = 0
    latest: _Line = field(default_factory=dict)


class _File:
    """Lines of JSON in a file, and in full ones before it: all, numbered in order, or the last alone. Thread-safe."""

    def __init__(self, path: Path, *, keep_all: bool) -> None:
        self._path, self._keep_all = path, keep_all
        self._lock, self._failed = threading.Lock(), False

    def append(self, line: _Line) -> None:
        with self._lock:
            try:
                if self._path.exists() and self._path.stat().st_size > _MOST_BYTES:
                    number = max((0, *self._numbers())) + 1 if self._keep_all else 1
                    self._path.replace(self._numbered(number))
                with os.fdopen(os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), "w") as file:
                    file.write(json.dumps(line) + "\n")
                self._failed = False
            except OSError as error:
                if not self._failed:
                    _log.warning("%s: what is done is not logged: %s", self._path, error.strerror)
                self._failed = True

    def last(self, count: int) -> list[_Line]:
        """The newest lines, the newest first."""
        lines: list[_Line] = []
        with self._lock:
            for path in (self._path, *map(self._numbered, sorted(self._numbers(), reverse=True))):
                if len(lines) < count and path.exists():
                    lines += reversed(_lines(path, count))
        return lines[:count]

    def _numbered(self, number: int) -> Path:
        return self._path.with_suffix(f".{number}.jsonl")

    def _numbers(self) -> list[int]:
        words = (path.name.split(".")[-2] for path in self._path.parent.glob(f"{self._path.stem}.*.jsonl"))
        return [int(word) for word in words if word.isdecimal()]


def _lines(path: Path, count: int) -> deque[_Line]:
    lines: deque[_Line] = deque(maxlen=count)
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in file:
            with suppress(ValueError):
                lines.append(json.loads(line))
    return lines
