"""How often an address may come with a wrong token."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable

# Wrong tokens of one address that are answered in each minute; more have to wait.
MOST = 10
_PERIOD_S = 60.0
_ADDRESSES = 10_000


class Failures:
    """Counts wrong tokens by address. clock: seconds, ever later."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._seen: OrderedDict[str, list[float]] = OrderedDict()

    def wait_s(self, address: str) -> float:
        """How long an address has to wait before a token of it is looked at; 0 where it may ask."""
        times = [one for one in self._seen.get(address, ()) if self._clock() - one < _PERIOD_S]
        return times[-MOST] + _PERIOD_S - self._clock() if len(times) >= MOST else 0.0

    def count(self, address: str) -> None:
        """Note a wrong token."""
        times = [one for one in self._seen.pop(address, ()) if self._clock() - one < _PERIOD_S]
        self._seen[address] = [*times, self._clock()]
        if len(self._seen) > _ADDRESSES:
            self._seen.popitem(last=False)
