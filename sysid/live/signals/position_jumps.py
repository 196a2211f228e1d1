"""GPS positions that jump: what a position moves from one reading to the next, against its own ground velocity.

A receiver that loses satellites or hears a false one moves its position at once; its velocity comes from the Doppler
shift and does not go with it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from sysid.arrays import Array
from sysid.live.signals.sensor_failures import SensorFailure

_POSITION, _VELOCITY = ("lat", "lon"), ("vn", "ve")
# Metres of a degree of latitude: a minute of arc is a nautical mile.
_METRES_PER_DEGREE = 60.0 * 1852.0
# A jump is from so many metres on, and so many times what positions and velocities usually differ by between two
# readings; that is known from so many of them, the newest of so many.
_LEAST_M, _FAR, _FIRST, _USUAL = 5.0, 8.0, 10, 100
# A position that comes back within so much of the jump was one bad reading.
_BACK = 0.3
# Readings further apart are not compared, s: the velocity may have changed between them. Kept, s.
_APART_S, _KEPT_S = 1.5, 10.0
# A velocity so near to the ends of an interval stands for them, s.
_SLACK_S = 0.3

Samples = Mapping[str, tuple[Array, Array]]


class PositionJumps:
    """Takes positions (deg) and ground velocities (m/s) as they come; gives each jump once."""

    def __init__(self) -> None:
        self._held: dict[str, deque[tuple[float, float]]] = {name: deque() for name in (*_POSITION, *_VELOCITY)}
        self._done = -np.inf
        self._usual: deque[float] = deque(maxlen=_USUAL)
        # A jump that the next reading has to confirm: its time, and how far it went north and east, m.
        self._open: tuple[float, Array] | None = None

    def take(self, samples: Samples) -> None:
        """Take samples: signal -> stamps (s) and values. Signals other than positions and velocities are left out."""
        for name in self._held.keys() & samples.keys():
            time_s, values = samples[name]
            # Exactly 0 is what a receiver says that does not know.
            kept = [(t, v) for t, v in zip(time_s.tolist(), values.tolist(), strict=True) if v or name in _VELOCITY]
            held = self._held[name]
            held.extend(kept)
            while held and held[0][0] < held[-1][0] - _KEPT_S:
                held.popleft()

    def check(self) -> SensorFailure | None:
        """The newest jump that has been confirmed, if any."""
        if not all(self._held.values()):
            return None
        ends = min(held[-1][0] for held in self._held.values())
        positions = dict(self._held["lat"])
        stamps = [t for t, _ in self._held["lon"] if t in positions and self._done <= t <= ends]
        east_of = dict(self._held["lon"])
        velocities = [np.array(self._held[name]).T for name in _VELOCITY]
        found = None
        for before, now in pairwise(stamps):
            self._done = now
            if not 0.0 < now - before < _APART_S or not all(_covered(t, before, now) for t, _ in velocities):
                self._open = None  # what was to be confirmed cannot be
                continue
            cosine = np.cos(np.radians(positions[now]))
            moved = np.array([positions[now] - positions[before], (east_of[now] - east_of[before]) * cosine])
            flown = [_mean(t, v, before, now) * (now - before) for t, v in velocities]
            found = self._judge(now, _METRES_PER_DEGREE * moved - np.array(flown)) or found
        return found

    def _judge(self, time_s: float, off: Array) -> SensorFailure | None:
        """Judge what one position is off by, north and east, m."""
        if self._open is not None:
            began, size = self._open
            self._open = None
            if float(np.linalg.norm(size + off)) > _BACK * float(np.linalg.norm(size)):
                # One that jumps again and again is usual for this receiver.
                self._usual.append(float(np.linalg.norm(size)))
                return _failure(began, size)
            return None
        far = float(np.linalg.norm(off))
        enough = len(self._usual) >= _FIRST
        if enough and far > max(_LEAST_M, _FAR * float(np.sqrt(np.mean(np.square(self._usual))))):
            self._open = (time_s, off)
        else:
            self._usual.append(far)
        return None


def _covered(time_s: Array, begin_s: float, end_s: float) -> bool:
    """Whether velocities are known all along an interval."""
    near = time_s[(time_s > begin_s - _APART_S) & (time_s < end_s + _APART_S)]
    whole = near.size > 1 and near[0] <= begin_s + _SLACK_S and near[-1] >= end_s - _SLACK_S
    return bool(whole and np.max(np.diff(near)) < _APART_S)


def _mean(time_s: Array, values: Array, begin_s: float, end_s: float) -> float:
    """Mean over an interval of values that change linearly between their stamps."""
    inside = time_s[(time_s > begin_s) & (time_s < end_s)]
    grid = np.concatenate([[begin_s], inside, [end_s]])
    return float(np.trapezoid(np.interp(grid, time_s, values), grid)) / (end_s - begin_s)


def _failure(time_s: float, size: Array) -> SensorFailure:
    north, east = (float(one) for one in size)
    ways = [
        f"{abs(value):.0f} m {word}"
        for value, word in ((north, "north" if north > 0.0 else "south"), (east, "east" if east > 0.0 else "west"))
        if abs(value) > 0.2 * float(np.hypot(north, east))
    ]
    text = f"the GPS position jumped by {' and '.join(ways)}"
    return SensorFailure(
        time_s, "gps_jump", "gps", float(np.hypot(north, east)), "m", text, "its antenna and satellites"
    )
