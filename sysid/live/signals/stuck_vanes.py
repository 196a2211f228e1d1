"""Vanes that stand still while the air's force on the aircraft changes: their angle is no regressor."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from sysid.arrays import Array
from sysid.live.signals.row_alignment import Rows

# What each vane's angle makes of the accelerometer, and how much of it an angle of some tenths of a degree makes.
_FELT_BY = {"alpha": "az", "beta": "ay"}
_FELT_M_S2 = 0.25
# Rows are left out after so long without a change of the vane's reading, the vane is told to be stuck, and to have
# failed: one that sticks for a moment is one with friction.
_STILL_S, _TOLD_S, _FAILED_S = 0.3, 1.5, 5.0
_REMEMBERED_S = 60.0


class StuckVanes:
    """Takes rows as they come and passes on those in which no vane is stuck; `names` are those told to be, `failed`
    those that have been for long.
    """

    def __init__(self) -> None:
        self._value: dict[str, float] = {}
        self._felt: dict[str, Array] = {}
        self._left_out = False
        self.names: tuple[str, ...] = ()
        self.failed: tuple[str, ...] = ()

    def moving(self, pieces: Iterable[Rows]) -> Iterator[Rows]:
        """The rows, but for those that end with a vane stuck."""
        for rows in pieces:
            still = {vane: self._still_s(vane, rows) for vane in _FELT_BY if vane in rows.columns}
            self.names = tuple(vane for vane, seconds in still.items() if seconds > _TOLD_S)
            self.failed = tuple(vane for vane, seconds in still.items() if seconds > _FAILED_S)
            after_gap, self._left_out = self._left_out, max(still.values(), default=0.0) > _STILL_S
            if not self._left_out:
                yield rows.part(0, rows.time_s.size, continues=rows.continues and not after_gap)

    def _still_s(self, vane: str, rows: Rows) -> float:
        """How long the vane's reading has been the same, 0 where the force on the aircraft has been as well."""
        angle, felt = rows.columns[vane], rows.columns[_FELT_BY[vane]]
        moved = np.flatnonzero(np.diff(angle, prepend=self._value.get(vane, np.nan)) != 0.0)
        self._value[vane] = float(angle[-1])
        seen = felt[moved[-1] :] if moved.size else np.concatenate([self._felt[vane], felt])
        self._felt[vane] = seen[-round(_REMEMBERED_S / rows.interval_s) :]
        seconds = seen.size * rows.interval_s
        return seconds if seconds > _STILL_S and float(np.std(seen)) > _FELT_M_S2 else 0.0
