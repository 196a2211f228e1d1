"""Which parts of flights, and which of their signals, are examined for mistakes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.flight import FlightData
from sysid.hypotheses import GROUPS, VANES

_FEWEST = 100  # samples of a part
_LONGEST_S = 60.0


def longest(parts: Sequence[FlightData]) -> list[FlightData]:
    """The longest parts, together at most some minutes: more of the same tells nothing new."""
    kept: list[FlightData] = []
    total = 0.0
    for part in sorted(map(_whole, parts), key=lambda one: -one.time_s.size):
        if part.time_s.size < _FEWEST or (kept and total > 2.0 * _LONGEST_S):
            break
        kept.append(part)
        total += part.time_s.size * part.interval_s
    return kept


def _whole(part: FlightData) -> FlightData:
    """The longest run in which vanes and heading, where they are there at all, carry values."""
    good = np.ones(part.time_s.size, dtype=np.bool_)
    for name in (*VANES, "psi"):
        if name in part and np.isfinite(part[name]).mean() > 0.5:
            good &= np.isfinite(part[name])
    edges = np.concatenate(([-1], np.flatnonzero(~good), [good.size]))
    longest = int(np.argmax(np.diff(edges)))
    return part.window(int(edges[longest]) + 1, int(edges[longest + 1]))


def known(part: FlightData) -> list[str]:
    """Signals that are examined and carry values."""
    names = [name for group in (*GROUPS.values(),) for name in group]
    return [name for name in dict.fromkeys(names) if name in part and np.isfinite(part[name]).any()]
