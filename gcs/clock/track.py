"""The vehicles' clocks while they fly: one compiled pass over each batch, and a fit when somebody asks.

Of every second the message that came with the smallest delay is kept, ten minutes back, and every round trip by
TIMESYNC; that is all the memory there is. Stamps count that are taken when the message leaves (ATTITUDE, HIGHRES_IMU,
SYSTEM_TIME and their like) as time since boot.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.clock.fit import NS_PER_S, fit_clock
from gcs.clock.stamppass import (
    COUNT,
    FRESH_WIDTH,
    JITTER,
    KEPT,
    REPLY,
    RESETS,
    SAVE,
    SAVED,
    SENDER,
    STAMP_MS,
    STAMP_US,
    STATE_WIDTH,
    TO_SAVE,
    TRIPS,
    take_stamps,
)
from gcs.clock.timesync import RoundTrips
from gcs.mavlink.dialect import STAMP_OFFSET, STAMP_SCALE, STAMP_SIZE, Dialect
from gcs.mavlink.frame_counts import MOST_SENDERS
from gcs.mavlink.framing import Frames

_FRESH = (
    *("SYSTEM_TIME", "ATTITUDE", "ATTITUDE_QUATERNION", "HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "SCALED_PRESSURE"),
    *("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"),
)
_AUTOPILOT_COMPONENT = 1
_RATE_AFTER_S = 3.0
_DRIFT_AFTER_S = 10.0
_REAL_TIME = 0.01  # no clock is that wrong: a vehicle beyond it is simulated faster or slower than real time
_SAME_CLOCK_NS = NS_PER_S


@dataclass(frozen=True)
class ClockState:
    """What is known of one vehicle's clock over one source.

    offset_s: this computer's UTC less the vehicle's time since boot, now: by round trips where it answers TIMESYNC,
    and then wrong by at most `offset_bound_s` where the ways there and back differ; else by arrivals, and then the
    smallest delay is in it. rate: vehicle's seconds to one of ours. drift_ppm: how much faster its clock runs than
    ours, None where it does not fly in real time. resets: restarts of its clock. round_trip_s: median; delay_s: one way
    at the smallest round trip. jitter_s: mean change of the delay from message to message (RFC 3550). None: not known.
    """

    system: int
    component: int
    offset_s: float | None = None
    offset_std_s: float | None = None
    offset_bound_s: float | None = None
    rate: float | None = None
    drift_ppm: float | None = None
    drift_std_ppm: float | None = None
    round_trip_s: float | None = None
    delay_s: float | None = None
    jitter_s: float | None = None
    resets: int = 0

    def to_json(self) -> dict[str, float | int | None]:
        """The keys of a system's statistics."""
        return {
            "clock_offset_s": self.offset_s,
            "clock_offset_std_s": self.offset_std_s,
            "clock_offset_bound_s": self.offset_bound_s,
            "clock_drift_ppm": self.drift_ppm,
            "clock_drift_std_ppm": self.drift_std_ppm,
            "clock_rate": self.rate,
            "clock_resets": self.resets,
            "round_trip_s": self.round_trip_s,
            "delay_s": self.delay_s,
            "jitter_s": self.jitter_s,
        }

    def text(self) -> str:
        """The clock's pace in words; empty while it is not known."""
        return rate_text(self.rate, self.drift_ppm, self.drift_std_ppm)


def rate_text(rate: float | None, drift_ppm: float | None, drift_std_ppm: float | None) -> str:
    """How a clock runs, in words; empty where it is not known."""
    if drift_ppm is not None:
        error = "" if drift_std_ppm is None else f" ± {1.96 * drift_std_ppm:.2g}"
        return f"drift {drift_ppm:.1f}{error} ppm"
    if rate is not None and not is_real_time(rate):
        return f"runs at {rate:.2f} times real time"
    return ""


def is_real_time(rate: float) -> bool:
    """Whether a clock's rate can be that of a vehicle that flies now."""
    return abs(rate - 1.0) <= _REAL_TIME


class ClockTracker:
    """Clocks of all components heard over one source. Not thread-safe."""

    def __init__(self, dialect: Dialect) -> None:
        self._table = _what_to_read(dialect)
        self._row_of = np.zeros(1 << 16, np.int32)
        self._state = np.zeros((2, STATE_WIDTH), np.int64)
        self._seconds = np.zeros((2, KEPT, 2), np.int64)
        self._trips = np.zeros((2, KEPT, 3), np.int64)
        self._rows = 0
        self._former: dict[int, ClockState] = {}

    def add(self, frames: Frames, received_ns: NDArray[np.int64]) -> None:
        """Take in one batch. received_ns: (len(frames),) UTC of each frame."""
        start = 0
        while start < len(frames):
            rows, stopped = take_stamps(
                frames.buffer,
                frames.offset,
                frames.message,
                received_ns,
                self._table,
                self._row_of,
                self._state,
                self._seconds,
                self._trips,
                self._rows,
                start,
            )
            self._rows, start = int(rows), int(stopped)
            if start < len(frames):
                self._make_way()

    def _make_way(self) -> None:
        """Save what is about to start anew; more rows where all are in use."""
        for row in np.flatnonzero(self._state[:, TO_SAVE] == SAVE).tolist():
            self._former[row] = self._state_of(row)
            self._state[row, TO_SAVE] = SAVED
        if self._rows == self._state.shape[0] < MOST_SENDERS:
            self._state = np.concatenate((self._state, np.zeros_like(self._state)))
            self._seconds = np.concatenate((self._seconds, np.zeros_like(self._seconds)))
            self._trips = np.concatenate((self._trips, np.zeros_like(self._trips)))

    def snapshot(self) -> ClockTracker:
        """What it holds now, to be asked while this one goes on."""
        taken = copy.copy(self)
        taken._state, taken._seconds, taken._trips = self._state.copy(), self._seconds.copy(), self._trips.copy()
        taken._former = dict(self._former)
        return taken

    def systems(self) -> list[int]:
        """Systems that send their time."""
        return sorted({int(sender) >> 8 for sender in self._state[: self._rows, SENDER]})

    def states(self, until_ns: int | None = None) -> list[ClockState]:
        """The clock of every system that sends its time, as `state` gives it."""
        found = (self.state(system, until_ns) for system in self.systems())
        return [state for state in found if state is not None]

    def state(self, system: int, until_ns: int | None = None) -> ClockState | None:
        """The clock of a system's autopilot, or else of the component that sent it most; None where none does.

        until_ns: end of a flight, UTC; where the clock restarted since then, as it was before.
        """
        rows = [row for row in range(self._rows) if int(self._state[row, SENDER]) >> 8 == system]
        if not rows:
            return None
        row = max(rows, key=lambda r: (self._state[r, SENDER] & 0xFF == _AUTOPILOT_COMPONENT, self._state[r, COUNT]))
        seconds = self._seconds[row, : int(self._state[row, COUNT])]
        if until_ns is not None and row in self._former and seconds.size and int(seconds[:, 0].min()) > until_ns:
            return self._former[row]
        return self._state_of(row)

    def _state_of(self, row: int) -> ClockState:
        held = self._state[row]
        system = int(held[SENDER]) >> 8
        component, resets = int(held[SENDER]) & 0xFF, int(held[RESETS])
        seconds = self._seconds[row, : min(int(held[COUNT]), KEPT)]
        trips = self._trips[row, : min(int(held[TRIPS]), KEPT)]
        if seconds.shape[0] == 0:
            found = RoundTrips(trips[:, 0], trips[:, 1], trips[:, 2]) if trips.size else None
            if found is None:
                return ClockState(system, component, resets=resets)
            return ClockState(
                system,
                component,
                offset_s=found.offset_ns(int(trips[:, 1].max())) / NS_PER_S,
                offset_std_s=found.offset_std_s,
                offset_bound_s=found.asymmetry_s,
                round_trip_s=found.median_s,
                delay_s=found.delay_s,
                resets=resets,
            )
        fit = fit_clock(seconds[:, 0], seconds[:, 1])
        now_ns = int(seconds[:, 1].max())
        offset = fit.offset_ns + round(fit.drift * (now_ns - fit.origin_ns))
        std, bound, round_trip, delay = fit.offset_std_at(now_ns), None, None, None
        if trips.size:
            found = RoundTrips(trips[:, 0], trips[:, 1], trips[:, 2], fit.drift)
            round_trip, delay = found.median_s, found.delay_s
            measured = found.offset_ns(now_ns)
            if abs(measured - offset) < _SAME_CLOCK_NS + 1e9 * found.median_s:
                offset, bound = measured, found.asymmetry_s
                std = float(np.hypot(found.offset_std_s, fit.drift_std * (now_ns - found.at_ns) / NS_PER_S))
        span = float(np.ptp(seconds[:, 0])) / NS_PER_S
        rate = 1.0 / (1.0 + fit.drift) if span >= _RATE_AFTER_S and fit.drift > -1.0 else None
        drifts = rate is not None and span >= _DRIFT_AFTER_S and is_real_time(rate)
        return ClockState(
            system,
            component,
            offset / NS_PER_S,
            _finite(std),
            bound,
            rate,
            (rate - 1.0) * 1e6 if drifts and rate is not None else None,
            _finite(fit.drift_std * 1e6) if drifts else None,
            round_trip,
            delay,
            int(held[JITTER]) / NS_PER_S,
            resets,
        )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _what_to_read(dialect: Dialect) -> NDArray[np.int64]:
    """(messages, 2): for each row of the dialect's table what to read, 0 for nothing, and where in the payload."""
    wanted = np.zeros((dialect.table.shape[0], FRESH_WIDTH), np.int64)
    for name in (*_FRESH, "TIMESYNC"):
        message = dialect.by_name.get(name)
        if message is None:
            continue
        row = int(dialect.index[message.id])
        stamp = dialect.table[row]
        if name == "TIMESYNC":
            wanted[row] = REPLY, 0
        elif stamp[STAMP_SIZE] == 4 and stamp[STAMP_SCALE] == 1_000_000:
            wanted[row] = STAMP_MS, stamp[STAMP_OFFSET]
        elif stamp[STAMP_SIZE] == 8 and stamp[STAMP_SCALE] == 1_000:
            wanted[row] = STAMP_US, stamp[STAMP_OFFSET]
    return wanted


def clock_metadata(source: str, states: Iterable[ClockState]) -> dict[str, dict[str, str]]:
    """Clocks heard over a source as metadata of a recording: `clock/<system>/<source>` -> its figures as text.

    What is not known is left out.
    """
    found: dict[str, dict[str, str]] = {}
    for state in states:
        known = {name: repr(value) for name, value in state.to_json().items() if value is not None}
        names = {"system": str(state.system), "component": str(state.component), "source": source}
        found[f"clock/{state.system}/{source}"] = {**names, **known}
    return found
