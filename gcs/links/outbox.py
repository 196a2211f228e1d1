"""Whole frames on their way into a byte stream that takes them when it can: nobody ever waits for a slow peer."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

#: Bytes that may wait for a peer that reads slowly; 20 s of ordinary telemetry.
LIMIT_BYTES = 256 * 1024
#: After this time old telemetry helps nobody, and a command is a danger.
STALE_S = 5.0
_POLL_S = 0.005


class Outbox:
    """Frames that a stream has not taken yet. Thread-safe, so frames of several senders never mix.

    write: gives bytes to the stream without waiting; how many it took. It may raise OSError.
    taken: gets how many bytes the stream has taken. dropped: gets how many frames had waited too long.
    """

    def __init__(
        self,
        write: Callable[[memoryview], int],
        taken: Callable[[int], None],
        dropped: Callable[[int], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._write = write
        self._taken = taken
        self._dropped = dropped
        self._clock = clock
        self._pending = bytearray()
        # When each frame in `_pending` grows stale, and its length; of the first the stream may have a part.
        self._frames: deque[tuple[float, int]] = deque()
        self._begun = 0
        self._closed = False
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._pending)

    def offer(self, frames: Sequence[bytes], wait_s: float = 0.0) -> int:
        """Take as many of the frames as there is room for within `wait_s`; how many. Raises OSError as `write` does.

        Those that somebody waits for (`wait_s` above 0) never grow stale.
        """
        deadline = time.monotonic() + wait_s
        count = 0
        while True:
            with self._lock:
                if self._closed:
                    return count
                self._flush()
                until = math.inf if wait_s > 0 else self._clock() + STALE_S
                while count < len(frames) and self._has_room(len(frames[count])):
                    self._pending += frames[count]
                    self._frames.append((until, len(frames[count])))
                    count += 1
                self._flush()
            if count == len(frames) or time.monotonic() >= deadline:
                return count
            time.sleep(_POLL_S)

    def flush(self, wait_s: float = 0.0) -> None:
        """Give the stream what it takes now, or within `wait_s`. Raises OSError as `write` does."""
        deadline = time.monotonic() + wait_s
        while True:
            with self._lock:
                if not self._closed:
                    self._flush()
            if self._closed or not self._pending or time.monotonic() >= deadline:
                return
            time.sleep(_POLL_S)

    def close(self) -> None:
        """Write nothing more: behind this call the stream may be closed, and its number given to another file."""
        with self._lock:
            self._closed = True

    def _has_room(self, length: int) -> bool:
        return not self._pending or len(self._pending) + length <= LIMIT_BYTES

    def _flush(self) -> None:
        self._drop_stale()
        while self._pending:
            with memoryview(self._pending) as view:
                count = self._write(view)
            if count == 0:
                return
            self._taken(count)
            del self._pending[:count]
            self._begun += count
            while self._frames and self._begun >= self._frames[0][1]:
                self._begun -= self._frames.popleft()[1]

    def _drop_stale(self) -> None:
        """Drop whole frames that have waited too long; one that the stream has begun to take is finished."""
        first = 1 if self._begun else 0
        now, count, size = self._clock(), 0, 0
        while len(self._frames) > first and self._frames[first][0] < now:
            size += self._frames[first][1]
            del self._frames[first]
            count += 1
        if count:
            start = self._frames[0][1] - self._begun if first else 0
            del self._pending[start : start + size]
            self._dropped(count)
