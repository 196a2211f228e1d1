"""What is to happen at a flight time: at once in a recording's own time, or on a thread that keeps the wall clock."""

from __future__ import annotations

import heapq
import threading
from collections.abc import Callable

from sim_vehicle.mavlink.pacing import Pacer

Action = Callable[[], None]


class Timeline:
    """Runs actions in the order of their times; of equal times, in the order in which they were given.

    pacer: the flight's, of which a thread waits for each time to come; None where `advance` sets the time.
    """

    def __init__(self, pacer: Pacer | None) -> None:
        self._pacer = pacer
        self._heap: list[tuple[float, int, Action]] = []
        self._count = 0
        self._changed = threading.Condition()
        self._ending = False
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._serve, daemon=True) if pacer else None
        if self._thread:
            self._thread.start()

    def at(self, time_s: float, action: Action) -> None:
        """Run `action` at flight time `time_s`. Raises what an earlier action raised."""
        with self._changed:
            if self._error:
                raise self._error
            heapq.heappush(self._heap, (time_s, self._count, action))
            self._count += 1
            self._changed.notify()

    def advance(self, time_s: float) -> None:
        """Without a pacer: run everything due before or at `time_s`."""
        while not self._pacer and self._heap and self._heap[0][0] <= time_s:
            heapq.heappop(self._heap)[2]()

    def finish(self) -> None:
        """Run, or wait for, everything that is left. Raises what an action raised."""
        self.advance(float("inf"))
        self._end(drop=False)
        if self._error:
            raise self._error

    def close(self) -> None:
        """Stop without running what is left."""
        self._end(drop=True)

    def _end(self, *, drop: bool) -> None:
        with self._changed:
            self._ending = True
            if drop:
                self._heap.clear()
            self._changed.notify()
        if self._thread:
            self._thread.join()

    def _serve(self) -> None:
        while action := self._next():
            try:
                action()
            except Exception as error:  # raised for whoever gives the next action
                with self._changed:
                    self._error = error
                    self._heap.clear()
                return

    def _next(self) -> Action | None:
        """The next action once its time has come; None when there will be none any more."""
        assert self._pacer is not None
        with self._changed:
            while True:
                if not self._heap:
                    if self._ending:
                        return None
                    self._changed.wait()
                    continue
                left = self._pacer.left_until(self._heap[0][0])
                if left <= 0.0:
                    return heapq.heappop(self._heap)[2]
                self._changed.wait(left)
