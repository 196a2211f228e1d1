"""What fails by silence: signals that no longer come, and commands that the telemetry repeats while the aircraft obeys.

A command that stands still is a stick that nobody moves, but where the axis that it moves no longer goes with the model
from then on, and other commands go on changing.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.vehicle.controls import DEFLECTION_SIGNALS
from sysid.arrays import Array
from sysid.live.signals.row_alignment import Rows
from sysid.live.signals.sensor_failures import READINGS, SensorFailure
from sysid.signals.record import SURFACES

# A signal is gone after so long, s, or so many times the interval at which it came.
_GONE_S, _INTERVALS = 3.0, 6.0
# Signals that go together, and what people call them.
_GROUPS = {**dict.fromkeys(("vn", "ve", "vd"), ("gps", "the ground velocity of the GPS"))}
_NAMES = {**READINGS, "thrust": "the thrust", "psi": "the heading"}
# What people call a surface, and those that move an axis, the first most.
_SURFACES = {signal: name for name, signal in DEFLECTION_SIGNALS.items() if signal in SURFACES}
_MOVES = {"CL": ("de",), "CD": ("de",), "Cm": ("de",), "CY": ("dr", "da"), "Cl": ("da", "dr"), "Cn": ("dr", "da")}
# A command stands still from so long on, s; before that it has changed, and others go on changing, in such shares of
# the samples of so many seconds, at least so many.
_STILL_S, _ALIVE, _BESIDE, _BEFORE_S, _LEAST_S = 0.8, 0.3, 0.1, 8.0, 5.0
_KEPT_S = 16.0
_RECEIVER = "its wire, its receiver and what sends it"
_SAME = 1e-9  # rad: means over equal commands differ by rounding


class SilentChannels:
    """Takes what comes; says once of each channel that it has failed."""

    def __init__(self) -> None:
        self._came: dict[str, tuple[float, float, int]] = {}
        # Surfaces whose channels are dead, and signals that are gone.
        self._dead: set[str] = set()
        self._lost: set[str] = set()
        # Of each row: time, and whether each command changed.
        self._rows: deque[tuple[float, NDArray[np.bool_]]] = deque()
        self._last: Array = np.full(len(_SURFACES), np.nan)
        # Signals that were gone and have come again, and when.
        self._back: dict[str, float] = {}

    def note(self, name: str, time_s: Array) -> None:
        """Samples of a signal have come, at these stamps (N,), s."""
        first, _, count = self._came.get(name, (float(time_s[0]), 0.0, 0))
        self._came[name] = (first, float(time_s[-1]), count + time_s.size)
        signal, _ = _GROUPS.get(name, (name, ""))
        if signal in self._lost:
            self._lost.remove(signal)
            self._back[signal] = float(time_s[0])

    def back(self) -> dict[str, float]:
        """Signals that have come again since the last call, and from when on, s."""
        back, self._back = self._back, {}
        return back

    def take(self, rows: Rows) -> None:
        """Take rows as they come."""
        if not rows.continues:
            self._rows.clear()
            self._last = np.full(len(_SURFACES), np.nan)
        missing = np.full(rows.time_s.size, np.nan)
        commands = np.stack([rows.columns.get(name, missing) for name in _SURFACES], axis=1)
        changed = np.abs(np.diff(commands, axis=0, prepend=self._last[None, :])) > _SAME
        self._last = commands[-1]
        self._rows.extend(zip(rows.time_s.tolist(), changed, strict=True))
        while self._rows and self._rows[0][0] < float(rows.time_s[-1]) - _KEPT_S:
            self._rows.popleft()

    def gone(self, now_s: float) -> list[SensorFailure]:
        """Signals that no longer come, which others do."""
        found = []
        for name, (first, last, count) in self._came.items():
            signal, words = _GROUPS.get(name, (name, _NAMES.get(name, "")))
            interval = (last - first) / max(count - 1, 1)
            if words and signal not in self._lost and count > 1 and now_s - last > max(_GONE_S, _INTERVALS * interval):
                self._lost.add(signal)
                found.append(
                    SensorFailure(last, f"{signal}_lost", signal, 1.0, "", f"no reading of {words}", _RECEIVER)
                )
        return found

    def dead(self, axis: str) -> SensorFailure | None:
        """The command that may be to blame where an axis no longer follows its commands."""
        if not self._rows:
            return None
        times = np.array([one[0] for one in self._rows])
        changed = np.array([one[1] for one in self._rows])
        for surface in _MOVES[axis]:
            j = list(_SURFACES).index(surface)
            last = np.flatnonzero(changed[:, j])
            if surface in self._dead or not last.size:
                continue
            since = float(times[last[-1]])
            before, later = (times <= since) & (times > since - _BEFORE_S), times > since
            if float(times[-1]) - since < _STILL_S or since - float(times[0]) < _LEAST_S:
                continue
            others = np.delete(changed[later], j, axis=1).mean(axis=0)
            if changed[before, j].mean() > _ALIVE and others.max() > _BESIDE:
                self._dead.add(surface)
                text = f"the {_SURFACES[surface]} moves, but the telemetry repeats its command"
                return SensorFailure(since, f"{surface}_channel", surface, 1.0, "", text, "that channel's messages")
        return None
