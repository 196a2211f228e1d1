"""Places that are held for a while: so many by all together, and no more than a part of them by one."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from gcs.errors import BusyError


class Places:
    """Thread-safe. most, of_one: by all, and by one who asks. what: who holds them, in words, as "files are sent"."""

    def __init__(self, most: int, of_one: int, what: str) -> None:
        self._most, self._of_one, self._what = most, of_one, what
        self._held, self._lock = Counter[str](), threading.Lock()

    @property
    def full(self) -> bool:
        """Whether all are held."""
        with self._lock:
            return self._held.total() >= self._most

    def take(self, who: str) -> None:
        """Hold one more, until it is given back. BusyError where there is none, or that one has enough."""
        with self._lock:
            if self._held.total() >= self._most:
                raise BusyError(f"{self._most} {self._what} already; come again in a minute")
            if self._held[who] >= self._of_one:
                raise BusyError(f"{self._of_one} {self._what} by {who} already; end one, or come again later")
            self._held[who] += 1

    def give_back(self, who: str) -> None:
        """Hold one less."""
        with self._lock:
            self._held[who] -= 1
            if not self._held[who]:
                del self._held[who]

    @contextmanager
    def held(self, who: str) -> Iterator[None]:
        """One, for as long as the context lasts."""
        self.take(who)
        try:
            yield
        finally:
            self.give_back(who)
