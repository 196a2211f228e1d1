"""A plan laid out on control ticks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim_vehicle.errors import PlanError
from sim_vehicle.manoeuvres.plan import Plan
from sim_vehicle.manoeuvres.shapes import Segment

RELEASE_S = 0.5  # s before the excitation at which the autopilot begins to let go


class Schedule:
    """What each tick of a plan adds to the controls.

    ticks: round(duration / dt) + 1, so that the flight lasts exactly the plan's duration from first to last sample.
    increments: (ticks, 4 + named), named: the vehicle's controls of other names. freed: (ticks, 2) bool. speed_change:
    (ticks,) m/s. segments: (name, begin s, end s).
    """

    def __init__(self, plan: Plan, dt: float, named: Sequence[str] = ()) -> None:
        self.ticks = round(plan.duration / dt) + 1
        if self.ticks < 2:
            raise PlanError(f"the plan lasts {plan.duration:g} s; it must last longer than one tick of {dt:g} s")
        self._time = np.asarray(np.arange(self.ticks) * dt, dtype=np.float64)
        self._named = tuple(named)
        self.increments = np.zeros((self.ticks, 4 + len(self._named)))
        self.freed = np.zeros((self.ticks, 2), dtype=np.bool_)
        self.speed_change = np.zeros(self.ticks)
        self.segments: list[tuple[str, float, float]] = []
        begin = 0.0
        for segment in plan.segments:
            self.lay(segment, begin)
            begin += segment.duration

    def lay(self, segment: Segment, begin: float) -> None:
        """Fly a segment from `begin`, s, on, in place of what was to be flown there; while a flight goes on, too."""
        end = begin + segment.duration
        inside = (self._time > begin - 1e-9) & (self._time < end - 1e-9)
        local = self._time[inside] - begin
        self.increments[inside] = segment.increments(local, self._named)
        let_go = local > segment.start - RELEASE_S - 1e-9
        self.freed[inside] = let_go[:, None] & np.array(segment.freed())[None, :]
        self.speed_change[inside] = [segment.speed_change(float(t)) for t in local]
        self.segments.append((segment.manoeuvre, begin, end))
