"""Which rows were flown: an aircraft that stands or rolls answers to the ground, not to its surfaces.

The rules are those of `sysid.signals.segments`, but nothing may look ahead, so that what counts as fast follows from
the weight: a wing flies from the speed on at which it carries the aircraft with a lift coefficient of 1.2.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.live.signals.row_alignment import Rows
from sysid.signals.segments import GROUND_MARGIN_S, MIN_AIRSPEED, SLOW_FLIGHT_S

_LARGEST_LIFT = 1.2  # lift coefficient, by which an aircraft may be flying
# Of that speed: rolling aircraft are slower, gliding ones faster; a pull-up may fly slower for a while.
_FLIES_FROM, _STANDS_BELOW = 0.8, 0.5
_CLEARANCE_M = 1.5
# The height where the aircraft stands is the mean over so long, and drifts with the air's pressure.
_HEIGHT_MEMORY_S = 5.0
_HEIGHT_NOISE_S = 0.5
# No aircraft rolls fast for so long: a height that says so is wrong.
_LONGEST_ROLL_S = 10.0


class Airborne:
    """Takes rows as they come and passes on those that were flown. vehicle: gives mass and wing."""

    def __init__(self, vehicle: Vehicle) -> None:
        weight = vehicle.mass.mass * vehicle.environment.gravity
        least = np.sqrt(2.0 * weight / (SEA_LEVEL_DENSITY * vehicle.geometry.S * _LARGEST_LIFT))
        self._flies = max(_FLIES_FROM * float(least), MIN_AIRSPEED)
        self._stands = max(_STANDS_BELOW * float(least), 0.8 * MIN_AIRSPEED)
        self._fast_s = self._slow_s = 0.0
        self._ground: float | None = None
        self._height: float | None = None
        self._by_height = False  # whether the height showed the take-off, and so may show the landing
        self.flying: bool | None = None  # not known before the first row

    def flown(self, pieces: Sequence[Rows]) -> Iterator[Rows]:
        """The rows that were flown, cut where they were not."""
        for rows in pieces:
            before = self.flying
            height = rows.columns.get("altitude")
            flags = np.array([
                self._step(float(v), None if height is None else float(height[k]), rows.interval_s)
                for k, v in enumerate(rows.columns["airspeed"])
            ])  # fmt: skip
            edges = np.flatnonzero(np.diff(flags, prepend=~flags[0])).tolist()
            for start, stop in zip(edges, [*edges[1:], flags.size], strict=True):
                if flags[start]:
                    yield rows.part(start, stop, continues=rows.continues and start == 0 and bool(before))

    def _step(self, speed: float, height: float | None, dt: float) -> bool:
        """Whether the aircraft flies at a row."""
        if height is not None and np.isfinite(height):
            share = min(dt / _HEIGHT_NOISE_S, 1.0)
            self._height = height if self._height is None else self._height + share * (height - self._height)
        fast = speed > (self._stands if self.flying else self._flies)
        self._fast_s = self._fast_s + dt if fast else 0.0
        self._slow_s = 0.0 if fast else self._slow_s + dt
        if self.flying is None:
            # The record's own beginning is no take-off: who is fast then has been flying.
            self.flying = fast
        elif not self.flying:
            above = self._above_ground()
            self._by_height = above
            unknown = self._ground is None or self._height is None
            needed = GROUND_MARGIN_S / 3.0 if above else GROUND_MARGIN_S if unknown else _LONGEST_ROLL_S
            self.flying = self._fast_s > needed
        elif self._slow_s > SLOW_FLIGHT_S or (self._by_height and not self._above_ground()):
            self.flying, self._fast_s = False, 0.0
        if not self.flying and not fast:
            self._stand(dt)
        return self.flying and fast

    def _above_ground(self) -> bool:
        return self._ground is not None and self._height is not None and self._height > self._ground + _CLEARANCE_M

    def _stand(self, dt: float) -> None:
        if self._height is not None:
            share = min(dt / _HEIGHT_MEMORY_S, 1.0)
            self._ground = (
                self._height if self._ground is None else self._ground + share * (self._height - self._ground)
            )
