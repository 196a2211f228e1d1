"""Quick ranking of readings of the same data by the relations between the sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.flight import Array
from sysid.relations import Columns, Window, level_cost, whiten


class QuickCost:
    """Negative log likelihood without estimating any sensor error: enough to rank readings that differ much.

    columns: the reading that others differ from. filters: relation -> whitening filter, the same for all readings.
    """

    def __init__(self, windows: Sequence[Window], columns: Sequence[Columns], filters: Mapping[str, Array]) -> None:
        self._windows, self._filters = windows, filters
        self._squares: list[dict[str, tuple[float, int]]] = [{} for _ in windows]
        self.base = self._total(columns, [window.relations for window in windows], self._squares)

    def cost(self, columns: Sequence[Columns], signals: Sequence[str]) -> float:
        """Of another reading, in which `signals` differ."""
        squares = [dict(known) for known in self._squares]
        return self._total(columns, [window.entered(signals) for window in self._windows], squares)

    def _total(
        self,
        columns: Sequence[Columns],
        only: Sequence[Sequence[str]],
        squares: Sequence[dict[str, tuple[float, int]]],
    ) -> float:
        states = [w.states(c, {}) for w, c in zip(self._windows, columns, strict=True)]
        for w, s, c, names, known in zip(self._windows, states, columns, only, squares, strict=True):
            for name, gap in w.gaps_of(s, c, names).items():
                white = whiten(gap, self._filters[name])
                known[name] = float(white @ white), white.size
        cost = level_cost(self._windows, states)
        for name in dict.fromkeys(name for known in squares for name in known):
            parts = [known[name] for known in squares if name in known]
            count = sum(size for _, size in parts)
            cost += count * 0.5 * float(np.log(max(sum(square for square, _ in parts) / count, 1e-18)))
        return cost
