"""How much one peer of a link may send: what is beyond is left out and counted, so that it takes neither disk nor time.

A token bucket (ITU-T I.371's continuous-state leaky bucket, counted in bytes): it fills at `BYTES_PER_S` and holds
`BURST_S` of that, so that what waited while this process was held up is taken whole.
"""

from __future__ import annotations

import numpy as np

from gcs.links.datagrams import Batch

#: Bytes a second that one peer may send, over any longer time. 200,000 ordinary messages a second are 7.4 MB.
BYTES_PER_S = 8_000_000
#: Seconds' worth of bytes that may come at once: as much as the kernel keeps of a socket while this process is held up.
BURST_S = 2.0
#: For so long behind the last bytes left out a peer counts as one that sends too much, s.
REFUSED_MEMORY_S = 5.0


class Allowance:
    """What one peer may still send."""

    def __init__(self, bytes_per_s: float = BYTES_PER_S, burst_s: float = BURST_S) -> None:
        self._rate, self._most = bytes_per_s, bytes_per_s * burst_s
        self._left = self._most
        self._at: float | None = None

    def take(self, batch: Batch, now: float) -> tuple[Batch | None, int]:
        """The reads of a batch that the peer may still send, None where it may send none, and the bytes left out.

        now: monotonic time, s.
        """
        if self._at is not None:
            self._left = min(self._most, self._left + self._rate * (now - self._at))
        self._at = now
        if len(batch.data) <= self._left:
            self._left -= len(batch.data)
            return batch, 0
        taken = int(np.searchsorted(batch.ends, self._left, side="right"))
        kept = int(batch.ends[taken - 1]) if taken else 0
        self._left -= kept
        refused = len(batch.data) - kept
        if not taken:
            return None, refused
        return Batch(batch.data[:kept], batch.ends[:taken], batch.received_ns[:taken], batch.source), refused
