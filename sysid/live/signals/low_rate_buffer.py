"""Samples that come seldom, which wait for the rows nearest to them."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from sysid.arrays import Array
from sysid.live.signals.row_alignment import Rows

# Rows may never come; so many are kept of each signal.
_KEPT = 1000
_NEAR_S = 0.1


class SparseSamples:
    """Takes samples of some signals as they come and gives each at its row."""

    def __init__(self, names: Sequence[str]) -> None:
        self._held = {name: deque[tuple[float, float]](maxlen=_KEPT) for name in names}

    def __len__(self) -> int:
        """Samples of the signal of which most wait."""
        return max(len(held) for held in self._held.values())

    def add(self, name: str, time_s: Array, values: Array) -> None:
        """Take samples, of a signal of another name none."""
        if name in self._held:
            self._held[name].extend(zip(time_s.tolist(), values.tolist(), strict=True))

    def at(self, rows: Rows) -> dict[str, Array]:
        """(N,) each sample at the row nearest to it; NaN elsewhere. One far from any row is left out."""
        columns = {}
        for name, held in self._held.items():
            column = columns[name] = np.full(rows.time_s.size, np.nan)
            while held and held[0][0] <= rows.time_s[-1] + 0.5 * rows.interval_s:
                stamp, value = held.popleft()
                place = min(int(np.searchsorted(rows.time_s, stamp - 0.5 * rows.interval_s)), column.size - 1)
                if stamp > rows.time_s[place] - _NEAR_S:
                    column[place] = value
        return columns
