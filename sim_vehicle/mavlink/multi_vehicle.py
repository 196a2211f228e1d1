"""Several flights at once, tick by tick in turn, so that what they say together is the same in every run."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from sim_vehicle.flight.tick import Tick

OnTick = Callable[[Tick], None]
Flight = Callable[[OnTick], None]


class _StoppedError(Exception):
    """Another flight failed, or the user stopped the run."""


class _Turns:
    """Lets flights go on one after the other, each once in a round, in the order of their numbers."""

    def __init__(self, count: int) -> None:
        self._flying = list(range(count))
        self._current = 0
        self._stopped = False
        self._changed = threading.Condition()

    def wait_for(self, number: int) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._stopped or self._flying[self._current] == number)
            if self._stopped:
                raise _StoppedError

    def pass_on(self) -> None:
        with self._changed:
            self._current = (self._current + 1) % len(self._flying)
            self._changed.notify_all()

    def leave(self, number: int) -> None:
        """A flight that has ended takes no further turns. It must not have the turn of another."""
        with self._changed:
            at = self._flying.index(number)
            self._flying.pop(at)
            if at < self._current:
                self._current -= 1
            if self._flying:
                self._current %= len(self._flying)
            self._changed.notify_all()

    def stop(self) -> None:
        with self._changed:
            self._stopped = True
            self._changed.notify_all()


def fly_together(flights: Sequence[Flight], listeners: Sequence[OnTick]) -> None:
    """Run flights, each in a thread, and give each one's ticks to its listener, one at a time.

    The n-th ticks of all flights come before any (n + 1)-th, in the flights' order. The first error of a
    flight stops the others and is raised.
    """
    if len(flights) == 1:
        flights[0](listeners[0])
        return
    turns = _Turns(len(flights))
    errors: list[BaseException] = []

    def run(number: int) -> None:
        def on_tick(tick: Tick) -> None:
            turns.wait_for(number)
            listeners[number](tick)
            turns.pass_on()

        try:
            flights[number](on_tick)
        except _StoppedError:
            pass
        except BaseException as error:
            errors.append(error)
            turns.stop()
        finally:
            turns.leave(number)

    threads = [threading.Thread(target=run, args=(number,), daemon=True) for number in range(len(flights))]
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        turns.stop()
    if errors:
        raise errors[0]
