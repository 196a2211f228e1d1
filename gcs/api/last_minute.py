"""The signals streamed over the last minute, for a page that is opened while the aircraft flies."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from typing import Any

from gcs.live.feed import LiveFeed, LiveState

_KEPT_S = 60.0
_EVERY_S = 0.2
# A signal that was not renewed for so long has no value then.
_FRESH_NS = 2_000_000_000
_DIGITS = 6


class LastMinute:
    """Values of every signal five times a second, of the flight that is followed. Requests may read in any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._flight: str | None = None
        self._kept: deque[tuple[float, dict[str, float]]] = deque()
        self._number = 0

    async def follow(self, feed: LiveFeed) -> None:
        """Look at the feed until cancelled."""
        while True:
            self.look(feed.current)
            await asyncio.sleep(_EVERY_S)

    def look(self, state: LiveState) -> None:
        """Keep what is new of a state."""
        if state.time_s is None or state.signals_number == self._number:
            return
        self._number = state.signals_number
        with self._lock:
            self._keep(state, state.time_s)

    def _keep(self, state: LiveState, time_s: float) -> None:
        if state.flight != self._flight or (self._kept and time_s < self._kept[-1][0]):
            self._kept.clear()
            self._flight = state.flight
        newest = max((at_ns for _, at_ns, _ in state.signals.values()), default=0)
        values = {
            name: float(f"{value:.{_DIGITS}g}")
            for name, (value, at_ns, _) in state.signals.items()
            if newest - at_ns < _FRESH_NS
        }
        self._kept.append((time_s, values))
        while self._kept[0][0] < time_s - _KEPT_S:
            self._kept.popleft()

    def to_json(self) -> dict[str, Any]:
        """The flight, the times, s of it, and of each signal as many values, null where it had none."""
        with self._lock:
            flight, kept = self._flight, list(self._kept)
        names = list(dict.fromkeys(name for _, values in kept for name in values))
        return {
            "flight": flight,
            "time_s": [time for time, _ in kept],
            "signals": {name: [values.get(name) for _, values in kept] for name in names},
        }
