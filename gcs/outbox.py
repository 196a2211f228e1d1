"""Whole frames on their way into a byte stream that takes them when it can: nobody ever waits for a slow peer."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

#: Bytes that may wait for a peer that reads slowly; 20 s of ordinary telemetry.
LIMIT_BYTES = 256 * 1024
_POLL_S = 0.005


class Outbox:
    """Bytes that a stream has not taken yet. Thread-safe, so frames of several senders never mix.

    write: gives bytes to the stream without waiting; how many it took. It may raise OSError.
    taken: told how many bytes the stream has taken.
    """

    def __init__(self, write: Callable[[memoryview], int], taken: Callable[[int], None]) -> None:
        self._write = write
        self._taken = taken
        self._pending = bytearray()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._pending)

    def offer(self, data: bytes, wait_s: float = 0.0) -> bool:
        """Take all of `data`, or nothing of it if there is no room within `wait_s`. Raises OSError as `write` does."""
        deadline = time.monotonic() + wait_s
        while True:
            with self._lock:
                self._flush()
                if not self._pending or len(self._pending) + len(data) <= LIMIT_BYTES:
                    self._pending += data
                    self._flush()
                    return True
            if time.monotonic() >= deadline:
                return False
            time.sleep(_POLL_S)

    def flush(self, wait_s: float = 0.0) -> None:
        """Give the stream what it takes now, or within `wait_s`. Raises OSError as `write` does."""
        deadline = time.monotonic() + wait_s
        while True:
            with self._lock:
                self._flush()
            if not self._pending or time.monotonic() >= deadline:
                return
            time.sleep(_POLL_S)

    def _flush(self) -> None:
        while self._pending:
            with memoryview(self._pending) as view:
                count = self._write(view)
            if count == 0:
                return
            self._taken(count)
            del self._pending[:count]
