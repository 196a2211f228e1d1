"""A log that stays small whatever happens: so many lines a minute, each of bounded length, equal ones once."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from gcs.text.json_log import ACCESS_LOG

_MOST_LINES, _PERIOD_S = 300, 60.0
_LONGEST = 2000


@dataclass
class _Kind:
    """Lines that say the same: when one was written, and how many were left out since."""

    written_s: float
    left_out: int = 0


class SparingFilter(logging.Filter):
    """Lets the first lines of each minute through, of equal ones the first alone, and says how many it left out.

    clock: seconds, ever later. equal_once: False where each line counts by itself, as in an access log.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, equal_once: bool = True) -> None:
        super().__init__()
        self._clock, self._lock = clock, threading.Lock()
        self._equal_once = equal_once
        self._began, self._lines = clock(), 0
        self._kinds: dict[tuple[str, int, str], _Kind] = {}
        self._forgotten = 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the line is written; it is cut to its first 2000 characters."""
        text = record.getMessage()[:_LONGEST]
        with self._lock:
            before = self._let_through((record.name, record.levelno, text + _error(record)), self._clock())
        if before is None:
            return False
        record.msg, record.args = before + text, None
        return True

    def _let_through(self, kind: tuple[str, int, str], now: float) -> str | None:
        """What is to stand before a line, None where it is left out."""
        known = self._kinds.get(kind)
        if known is not None and now - known.written_s <= _PERIOD_S:
            known.left_out += 1
            return None
        left_out = 0
        if now - self._began > _PERIOD_S:
            left_out = max(self._lines - _MOST_LINES, 0)
            self._began, self._lines = now, 0
        self._lines += 1
        if self._lines > _MOST_LINES:
            return None
        equal = self._kinds.pop(kind).left_out if kind in self._kinds else 0
        if self._equal_once:
            self._forget(now)
            self._kinds[kind] = _Kind(now)
        left_out, self._forgotten = left_out + self._forgotten, 0
        lines = f"({left_out} lines were left out before this one) " if left_out else ""
        return f"{lines}({equal} equal lines were left out before this one) " if equal else lines

    def _forget(self, now: float) -> None:
        """Drop the kinds whose minute is over; what was left out of them is counted with the rest."""
        over = [kind for kind, known in self._kinds.items() if now - known.written_s > _PERIOD_S]
        self._forgotten += sum(self._kinds.pop(kind).left_out for kind in over)


def _error(record: logging.LogRecord) -> str:
    """The error that a line goes with: another error makes another line."""
    return repr(record.exc_info[1])[:_LONGEST] if record.exc_info else ""


def log_sparingly() -> None:
    """Have every handler of the root logger, of uvicorn's and of the access log write no more than that."""
    sparing = SparingFilter()
    for name in ("", "uvicorn", "uvicorn.error", "uvicorn.access"):
        for handler in logging.getLogger(name).handlers:
            handler.addFilter(sparing)
    for handler in logging.getLogger(ACCESS_LOG).handlers:
        handler.addFilter(SparingFilter(equal_once=False))
