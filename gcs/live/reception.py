"""Reception against a vehicle's stamps while messages come: where a message without a stamp belongs."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

Times = NDArray[np.int64]

# Stretches of reception of which the message with the smallest delay is kept, ns, and how many of them count.
_STRETCH_NS, _STRETCHES = 250_000_000, 120
# A stream that gains or loses more than this share of the time gone by, and than delays of a radio link make besides
# (ns), is a replay or a simulation: no clock of a board does. So many of the last stretches say at which pace.
_CLOCK_SHARE, _DELAYS_NS = 0.25, 300_000_000
_RECENT = 12


class Reception:
    """One kind of a vehicle's stamps against the time of reception, by the smallest delay seen lately.

    At the pace of a clock the smallest delay of the last half minute counts. A stream that comes at another pace, as of
    a replay ten times as fast as the flight, has no delay that lasts: its times follow the pace of the last seconds.
    """

    def __init__(self) -> None:
        # Stretch of reception, reception and stamp of the message with the smallest delay in it.
        self._earliest: deque[tuple[int, int, int]] = deque()

    @property
    def known(self) -> bool:
        """Whether a stamp has come at all."""
        return bool(self._earliest)

    def add(self, log_ns: Times, raw_ns: Times) -> None:
        """Take receptions and stamps, (N,) ns each."""
        for stretch in np.unique(log_ns // _STRETCH_NS).tolist():
            inside = np.flatnonzero(log_ns // _STRETCH_NS == stretch)
            best = inside[np.argmin(log_ns[inside] - raw_ns[inside])]
            one = (stretch, int(log_ns[best]), int(raw_ns[best]))
            if self._earliest and self._earliest[-1][0] == stretch:
                other = self._earliest.pop()
                one = min(one, other, key=lambda entry: entry[1] - entry[2])
            self._earliest.append(one)
        while self._earliest[-1][0] - self._earliest[0][0] > _STRETCHES:
            self._earliest.popleft()

    def pace(self) -> float:
        """Seconds of the vehicle in one of reception; 1 for a clock."""
        recent = np.array(list(self._earliest)[-_RECENT:], dtype=np.int64)
        log_ns, raw_ns = recent[:, 1] - recent[0, 1], recent[:, 2] - recent[0, 2]
        least = _CLOCK_SHARE * log_ns[-1] + _DELAYS_NS
        if abs(raw_ns[-1] - log_ns[-1]) <= least:
            return 1.0
        # The median of the slopes between any two, which a stalled link does not move (Theil and Sen).
        first, second = np.triu_indices(len(recent), 1)
        pace = float(np.median((raw_ns[second] - raw_ns[first]) / np.maximum(log_ns[second] - log_ns[first], 1)))
        return pace if pace > 0.0 and abs(pace - 1.0) * log_ns[-1] > least else 1.0

    def at(self, log_ns: Times) -> Times:
        """The stamps, (N,) ns, that messages of these receptions would carry without a delay; needs a known stamp."""
        pace = self.pace()
        counted = list(self._earliest) if pace == 1.0 else list(self._earliest)[-_RECENT:]
        _, origin, stamp = counted[-1]
        ahead = max(raw - stamp - pace * (log - origin) for _, log, raw in counted)
        return np.asarray(stamp + np.rint(ahead + pace * (log_ns - origin)).astype(np.int64), dtype=np.int64)
