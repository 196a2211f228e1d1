"""Whether two vehicles send under one system number: sources heard together whose clocks since boot lie far apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink.dialect import STAMP_OFFSET, STAMP_SCALE, STAMP_SIZE, Dialect
from gcs.mavlink.framing import Frames

# A source is live for so long after its last frame.
_LIVE_NS = 2_000_000_000
# One link may be so far behind another, ms; beyond it for so long, by about the same, they are two vehicles'. What a
# link held back comes nearer while it comes, and a vehicle that was started anew is so on all links.
_APART_MS, _LASTING_NS, _STEADY_MS = 5000, 3_000_000_000, 2000
_WRAP_MS = 1 << 32


class SameNumber:
    """Compares what the sources of one flight send as its autopilot. Times are UTC ns of reception.

    words: what is wrong and what to do, once that has been seen, empty else.
    """

    def __init__(self, dialect: Dialect) -> None:
        table = dialect.table
        self._places = table[:, STAMP_OFFSET]
        self._stamped = (table[:, STAMP_SIZE] == 4) & (table[:, STAMP_SCALE] == 1_000_000)
        self._heard: dict[str, int] = {}
        # By source and message what lies between reception and its stamp, ms.
        self._offsets: dict[str, dict[int, int]] = {}
        # By pair of sources since when they are apart, and by how much then, ms.
        self._apart: dict[frozenset[str], tuple[int, int]] = {}
        self.words = ""

    def add(self, source: str, frames: Frames, received: NDArray[np.int64], sender: tuple[int, int]) -> bool:
        """Take what a source brought; whether it and another are two vehicles now.

        received: (frames,) of each. sender: system and component.
        """
        now_ns = int(received[-1])
        self._heard[source] = now_ns
        for gone in [name for name, last in self._heard.items() if abs(now_ns - last) > _LIVE_NS]:
            del self._heard[gone]
            self._offsets.pop(gone, None)
            self._apart = {pair: found for pair, found in self._apart.items() if gone not in pair}
        if len(self._heard) < 2:
            return False
        offsets = self._offsets.setdefault(source, {})
        newest = self._newest(frames, received, sender)
        offsets |= newest
        if not newest:
            return False
        apart = [self._compare(source, other, now_ns) for other in self._offsets if other != source]
        if not any(apart):
            return False
        self.words = (
            f"two vehicles send as system {sender[0]}, their clocks {max(apart) / 1000.0:.0f} s apart, and are recorded"
            " as one flight: give one of them another number (SYSID_THISMAV, MAV_SYS_ID on a PX4), or find who else"
            " sends in its name; GET /api/links shows where they are heard"
        )
        return True

    def _newest(self, frames: Frames, received: NDArray[np.int64], sender: tuple[int, int]) -> dict[int, int]:
        """By message what lies between its newest reception and the stamp in it, ms."""
        at = np.flatnonzero((frames.message >= 0) & (frames.sysid == sender[0]) & (frames.compid == sender[1]))
        at = at[self._stamped[frames.message[at]]][::-1]
        rows, first = np.unique(frames.message[at], return_index=True)
        found = {}
        for row, index in zip(rows.tolist(), at[first].tolist(), strict=True):
            start = int(frames.payload_offset[index])
            sent = frames.buffer[start : start + int(frames.payload_length[index])].tobytes()
            place = int(self._places[row])
            stamp = int.from_bytes(sent[place : place + 4], "little")  # MAVLink 2 does not send trailing zeros
            found[row] = int(received[index]) // 1_000_000 - stamp
        return found

    def _compare(self, source: str, other: str, now_ns: int) -> int:
        """For how many ms the clocks of two sources lie apart, 0 where they are one vehicle's or it is not sure yet."""
        mine, theirs = self._offsets[source], self._offsets[other]
        gaps = [_wrapped(mine[row] - theirs[row]) for row in mine.keys() & theirs.keys()]
        pair = frozenset((source, other))
        gap = min(map(abs, gaps), default=0)
        since_ns, before = self._apart.get(pair, (now_ns, gap))
        if gap <= _APART_MS:
            self._apart.pop(pair, None)
            return 0
        if abs(gap - before) > _STEADY_MS:
            since_ns, before = now_ns, gap
        self._apart[pair] = since_ns, before
        return gap if now_ns - since_ns > _LASTING_NS else 0


def _wrapped(ms: int) -> int:
    """A difference of clocks that begin anew after 49 days."""
    return (ms + _WRAP_MS // 2) % _WRAP_MS - _WRAP_MS // 2
