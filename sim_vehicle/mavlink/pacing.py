"""Keeping time with the wall clock: every wake-up is computed from the start, so that errors do not add up."""

from __future__ import annotations

import time
from collections.abc import Callable


class Pacer:
    """Waits until flight time has come.

    speed: flight seconds per second of the clock. clock, sleep: monotonic seconds, replaced in tests.
    """

    def __init__(
        self,
        speed: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._speed = speed
        self._clock = clock
        self._sleep = sleep
        self._start: float | None = None

    def wait_until(self, flight_s: float) -> None:
        """Return when `flight_s` seconds of flight have passed since the first call; at once if that is past."""
        now = self._clock()
        if self._start is None:
            self._start = now - flight_s / self._speed
        left = self._start + flight_s / self._speed - now
        if left > 0.0:
            self._sleep(left)

    def left_until(self, flight_s: float) -> float:
        """Seconds of the clock until `flight_s`, negative where that is past; 0 before the flight has begun."""
        return 0.0 if self._start is None else self._start + flight_s / self._speed - self._clock()

    def flight_time(self) -> float:
        """Seconds of flight that have passed; 0 before it has begun."""
        return 0.0 if self._start is None else (self._clock() - self._start) * self._speed
