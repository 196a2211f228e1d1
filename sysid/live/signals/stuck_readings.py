"""Vanes and an airspeed that stand still while the force on the aircraft changes: their readings are no regressors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from sysid.arrays import Array
from sysid.live.signals.row_alignment import Rows

# What each reading makes of the accelerometer, and how much of it a tenth of a degree or of a m/s makes.
_FELT_BY = {"alpha": "az", "beta": "ay", "airspeed": "ax"}
_FELT_M_S2 = 0.25  # m/s^2, standard deviation of an acceleration of an aircraft that moves
# Rows are left out after so long without a change of a reading, s: an airspeed comes seldom, in steps.
_STILL_S = {"alpha": 0.3, "beta": 0.3, "airspeed": 2.0}
# It is reported as stuck, and as failed, after so long: one that sticks for a moment is one with friction.
_REPORTED_S, _FAILED_S = 1.5, {"alpha": 5.0, "beta": 5.0, "airspeed": 3.0}
_REMEMBERED_S = 60.0


class StuckReadings:
    """Takes rows as they come and passes on those in which no reading is stuck; `names` are those reported as stuck,
    `failed` those that have been for long, and since when, s.
    """

    def __init__(self) -> None:
        self._value: dict[str, float] = {}
        self._felt: dict[str, Array] = {}
        self._left_out = False
        self.names: tuple[str, ...] = ()
        self.failed: dict[str, float] = {}

    def moving(self, pieces: Iterable[Rows]) -> Iterator[Rows]:
        """The rows, but for those that end with a reading stuck."""
        for rows in pieces:
            still = {name: self._still_s(name, rows) for name in _FELT_BY if name in rows.columns}
            self.names = tuple(name for name, seconds in still.items() if seconds > _REPORTED_S)
            end = float(rows.time_s[-1])
            self.failed = {name: end - seconds for name, seconds in still.items() if seconds > _FAILED_S[name]}
            after_gap, self._left_out = self._left_out, any(still.values())
            if not self._left_out:
                yield rows.part(0, rows.time_s.size, continues=rows.continues and not after_gap)

    def _still_s(self, name: str, rows: Rows) -> float:
        """How long a reading has been the same, 0 for not yet, or where the force on the aircraft has been as well."""
        read, felt = rows.columns[name], rows.columns[_FELT_BY[name]]
        moved = np.flatnonzero(np.diff(read, prepend=self._value.get(name, np.nan)) != 0.0)
        self._value[name] = float(read[-1])
        seen = felt[moved[-1] :] if moved.size else np.concatenate([self._felt[name], felt])
        self._felt[name] = seen[-round(_REMEMBERED_S / rows.interval_s) :]
        seconds = seen.size * rows.interval_s
        return seconds if seconds > _STILL_S[name] and float(np.std(seen)) > _FELT_M_S2 else 0.0
