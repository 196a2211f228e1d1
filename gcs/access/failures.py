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
        self._seen: OrderedDict[str, dict[bytes, float]] = OrderedDict()

    def wait_s(self, address: str) -> float:
        """How long an address has to wait before a token of it is looked at; 0 where it may ask."""
        times = sorted(one for one in self._seen.get(address, {}).values() if self._clock() - one < _PERIOD_S)
        return times[-MOST] + _PERIOD_S - self._clock() if len(times) >= MOST else 0.0

    def count(self, address: str, digest: bytes) -> None:
        """Note a wrong token; the same one again, as of a page whose token has ended, is none more."""
        seen = {one: at for one, at in self._seen.pop(address, {}).items() if self._clock() - at < _PERIOD_S}
        self._seen[address] = {**seen, digest: seen.get(digest, self._clock())}
        if len(self._seen) > _ADDRESSES:
            self._seen.popitem(last=False)
