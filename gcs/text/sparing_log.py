"""A log that stays small whatever happens: so many lines a minute, each of bounded length."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

_MOST_LINES, _PERIOD_S = 300, 60.0
_LONGEST = 2000


class SparingFilter(logging.Filter):
    """Lets the first lines of each minute through, and says how many it left out. clock: seconds, ever later."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock, self._lock = clock, threading.Lock()
        self._began, self._lines = clock(), 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the line is written; it is cut to its first 2000 characters."""
        with self._lock:
            now, left_out = self._clock(), 0
            if now - self._began > _PERIOD_S:
                left_out = max(self._lines - _MOST_LINES, 0)
                self._began, self._lines = now, 0
            self._lines += 1
            if self._lines > _MOST_LINES:
                return False
        text = record.getMessage()[:_LONGEST]
        before = f"({left_out} lines were left out before this one) " if left_out else ""
        record.msg, record.args = before + text, None
        return True


def log_sparingly() -> None:
    """Have every handler of the root logger, and of uvicorn's, write no more than that."""
    sparing = SparingFilter()
    for name in ("", "uvicorn", "uvicorn.error", "uvicorn.access"):
        for handler in logging.getLogger(name).handlers:
            handler.addFilter(sparing)
