"""Sensors that fail and aircraft that change in flight: sensors are judged first, then the change, then its cause."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.live.recursive.causes import CauseFound, KnownAxis, Lengths, likeliest
from sysid.live.recursive.change_detection import Change, ChangeDetector
from sysid.live.signals.position_jumps import PositionJumps
from sysid.live.signals.sensor_failures import SensorFailure, SensorMonitor
from sysid.live.signals.silent_channels import SilentChannels

# A change of the aircraft waits so long where sensors disagree by so much of what indicates a sensor failure: doubt
# -> s.
_WAITS_S = {0.7: 5.0, 0.4: 1.6}
# One within so long of a sensor's failure is that, and of another one the same, s.
_BLAMED_S, _SAME_S = 3.0, 3.0
# A change is a sensor's where that is the cause with such a probability.
_SENSOR = 0.5
# The cause of a change is named so long after it, s, or from so soon on where it is so sure.
_CAUSE_S, _SOON_S, _SURE = 5.0, 1.5, 0.95

Detectors = Mapping[str, ChangeDetector]


@dataclass(frozen=True)
class News:
    """changed_s: since when the aircraft is another; failed_s: since when a sensor is; None where neither is news."""

    changed_s: float | None = None
    failed_s: float | None = None


@dataclass(frozen=True)
class _Seen:
    """A change of the aircraft, when it was seen, and the axes as they were before it."""

    since_s: float
    change: Change
    known: Mapping[str, KnownAxis]


class Watch:
    """What has failed and changed in a flight. sensors, silent: take the rows; positions: samples. Detectors are by
    axis.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self.changes: list[Change] = []
        self.failures: list[SensorFailure] = []
        # Changes that wait while a sensor may be to blame; axes before the last one, while its cause is looked for.
        self._doubted: list[_Seen] = []
        self._open: Mapping[str, KnownAxis] = {}
        self.silent = SilentChannels()
        self.positions = PositionJumps()
        self._dead: SensorFailure | None = None
        # Sensors that repeat one reading.
        self._repeating: set[str] = set()
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forget what sensors have shown; what was reported stands."""
        self.sensors = SensorMonitor(self._vehicle.environment.gravity)
        self._open = {}

    def hear(self, now_s: float) -> None:
        """Report signals that no longer come, and those that come again. now_s: newest stamp of all."""
        for signal, at_s in self.silent.back().items():
            self._end(f"{signal}_lost", at_s)
        self.failures += self.silent.gone(now_s)
        if (jump := self.positions.check()) is not None:
            self.failures = [one for one in self.failures if one.name != jump.name] + [jump]

    def _end(self, name: str, time_s: float) -> None:
        """The failure of this name is over."""
        self.failures = [
            replace(one, until_s=time_s) if one.name == name and one.until_s is None else one for one in self.failures
        ]

    def notice(self, time_s: float, change: Change, detectors: Detectors) -> bool:
        """Take a change of the aircraft that a detector sees; whether it is reported."""
        # No equation of the aircraft has a position or a ground velocity in it.
        failed = [one for one in self.failures if one.signal != "gps"][-1:]
        if any(change.time_s < one.time_s + _BLAMED_S for one in failed) or self._is_reported(change):
            return False
        if (dead := self.silent.dead(change.axis)) is not None:
            self._dead = dead
            return False
        known = {axis: one.known_before(change.time_s) for axis, one in detectors.items()}
        seen = _Seen(time_s, change, {axis: one for axis, one in known.items() if one is not None})
        if not self._waits_s:
            self._report(seen)
            return True
        self._doubted.append(seen)
        detectors[change.axis].restart()
        return False

    def judge(self, time_s: float, stuck: Mapping[str, float], detectors: Detectors) -> News:
        """What is news by now. stuck: sensors that repeat one reading, whose rows are left out, and since when, s."""
        failed_s = None
        for name in self._repeating - stuck.keys():
            self._repeating.remove(name)
            self.sensors.reported.pop(name, None)
            self._end(f"{name}_still", time_s)
        if new := [name for name in stuck if name not in self.sensors.reported]:
            self.failures.append(self.sensors.stands_still(new[0], stuck[new[0]]))
            self._repeating.add(new[0])
        elif (failure := self._dead or self.sensors.check()) is not None:
            self.failures.append(failure)
            self._dead, failed_s = None, failure.time_s
            self._doubted = [one for one in self._doubted if one.change.time_s < failed_s - _BLAMED_S]
        self._look_for_cause(time_s, detectors)
        waits_s = self._waits_s
        waited = [one for one in self._doubted if time_s > one.since_s + waits_s]
        self._doubted = [one for one in self._doubted if time_s <= one.since_s + waits_s]
        reported = [one for one in waited[:1] if not self._is_reported(one.change)]
        for one in reported:
            self._report(one)
        return News(reported[0].change.time_s if reported else None, failed_s)

    def _is_reported(self, change: Change) -> bool:
        """Whether it is another side of what was reported last."""
        return any(abs(change.time_s - one.time_s) < _SAME_S for one in self.changes[-1:])

    @property
    def _waits_s(self) -> float:
        return next((seconds for doubt, seconds in _WAITS_S.items() if self.sensors.doubt > doubt), 0.0)

    def _report(self, seen: _Seen) -> None:
        self._open = seen.known
        self.changes.append(seen.change)

    def _look_for_cause(self, time_s: float, detectors: Detectors) -> None:
        """Name the cause of the last change by what has come since, until it has settled."""
        if not self._open or not self.changes:
            return
        change, geometry = self.changes[-1], self._vehicle.geometry
        axes = [detectors[axis].equations(one, change.time_s) for axis, one in self._open.items() if axis in detectors]
        causes = tuple(likeliest(axes, Lengths(geometry.b, geometry.c)))
        late = time_s > change.time_s + _CAUSE_S
        sure = time_s > change.time_s + _SOON_S and bool(causes) and causes[0].probability > _SURE
        if late or sure:
            self._open = {}
            if causes and causes[0].cause.sensor and causes[0].probability > _SENSOR:
                del self.changes[-1]
                self._blame(causes[0], change.time_s)
            else:
                self.changes[-1] = replace(change, causes=causes)

    def _blame(self, found: CauseFound, time_s: float) -> None:
        """What seemed a change of the aircraft is a sensor that reads a wrong share of the truth, or late."""
        off = found.size - 100.0
        sensor = found.cause.sensor
        if found.cause.unit:
            text = f"{found.cause.name} reads {abs(off):.0f} % {'high' if off > 0.0 else 'low'}"
            failure = SensorFailure(
                time_s, f"{sensor}_scale", sensor, off, "%", text, std=found.std, probability=found.probability
            )
        else:
            failure = SensorFailure(
                time_s, f"{sensor}_slow", sensor, 1.0, "", f"the {sensor} vane lags", probability=found.probability
            )
        same = [one for one in self.failures if one.name == failure.name]
        if same:
            failure = replace(failure, time_s=same[0].time_s)
        self.failures = [*(one for one in self.failures if one not in same), failure]
        self.sensors.note(failure)
