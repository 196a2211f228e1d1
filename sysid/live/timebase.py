"""Samples that come as they come -> rows on the stamps of the accelerometer.

A row is made once every signal has reached its stamp, or when the accelerometer is so far ahead that the others will
hardly come any more. A lost sample of the accelerometer is interpolated; a longer gap begins a new run of rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sysid.flight import Array
from sysid.outliers import MAD_TO_SIGMA, SHARE, SIGMAS
from sysid.timebase import ANGLES, GAP_S, is_held

BASE = "az"
# How far the accelerometer may run ahead of a signal before the row is made without it.
_PATIENCE_S = 0.08
_FIRST_SAMPLES = 12
# A message that is later than so many of its periods after the one before is the next but one.
_LOST = 1.6
_KEPT_S = 1.0


@dataclass(frozen=True)
class Rows:
    """N rows without gaps. time_s: (N,). columns: name -> (N,). continues: whether the first one follows the last.

    told: (N,) whether all commands are known; the one before is held where a message is lost.
    """

    interval_s: float
    time_s: Array
    columns: dict[str, Array]
    continues: bool
    told: NDArray[np.bool_]

    def part(self, start: int, stop: int, *, continues: bool) -> Rows:
        """Some of the rows."""
        columns = {name: values[start:stop] for name, values in self.columns.items()}
        return Rows(self.interval_s, self.time_s[start:stop], columns, continues, self.told[start:stop])


@dataclass
class _Track:
    """The last samples of one signal."""

    time_s: Array = field(default_factory=lambda: np.empty(0))
    values: Array = field(default_factory=lambda: np.empty(0))
    gap_s: float = GAP_S
    period_s: float = GAP_S

    waiting: tuple[Array, Array] = field(default_factory=lambda: (np.empty(0), np.empty(0)))
    left_out: int = 0

    def add(self, time_s: Array, values: Array, *, angle: bool, held: bool) -> None:
        """Take samples (N,); a reading that no motion makes is left out, which the next one tells."""
        time_s, values = np.concatenate([self.waiting[0], time_s]), np.concatenate([self.waiting[1], values])
        fresh = np.diff(np.maximum.accumulate(np.concatenate([[self.newest], time_s]))) > 0.0
        if not fresh.all():
            time_s, values = time_s[fresh], values[fresh]
        if angle and values.size:
            before = self.values[-1:] if self.values.size else values[:1]
            values = np.unwrap(np.concatenate([before, values]))[1:]
        if not held and values.size:
            alone, doubted = _stand_alone(self.values, values)
            self.left_out += int(alone.sum())
            self.waiting = (time_s[-1:], values[-1:]) if doubted else (np.empty(0), np.empty(0))
            if doubted or alone.any():
                keep = ~alone
                keep[-1] &= not doubted
                time_s, values = time_s[keep], values[keep]
        self.time_s = np.concatenate([self.time_s, time_s])
        self.values = np.concatenate([self.values, values])
        if self.gap_s == GAP_S and self.time_s.size > _FIRST_SAMPLES:
            self.period_s = float(np.median(np.diff(self.time_s)))
            self.gap_s = max(GAP_S * 1.001, 2.5 * self.period_s)

    @property
    def newest(self) -> float:
        return float(self.time_s[-1]) if self.time_s.size else -np.inf

    def trim(self, before_s: float) -> None:
        first = max(int(np.searchsorted(self.time_s, before_s)) - 1, 0)
        if first:
            self.time_s, self.values = self.time_s[first:], self.values[first:]

    def told(self, stamps: Array) -> NDArray[np.bool_]:
        """(N,) whether a held value is known at the stamps: not where the next one should have come and did not."""
        after = np.searchsorted(self.time_s, stamps + 1e-6, side="right")
        lower = self.time_s[np.maximum(after - 1, 0)]
        upper = np.append(self.time_s, np.inf)[after]
        late = _LOST * self.period_s
        return np.asarray((after > 0) & ((upper - lower < late) | (stamps - lower < late - self.period_s)))

    def at(self, stamps: Array, *, held: bool) -> Array:
        """(N,) values at the stamps, NaN where no sample is near."""
        if not self.time_s.size:
            return np.full(stamps.size, np.nan)
        after = np.searchsorted(self.time_s, stamps + 1e-6, side="right")
        before = np.maximum(after - 1, 0)
        values = self.values[before] if held else np.interp(stamps, self.time_s, self.values)
        upper = self.time_s[np.minimum(after, self.time_s.size - 1)]
        lower = self.time_s[before]
        inside = (after > 0) & ((upper - lower <= self.gap_s) | (stamps - lower <= 1e-6))
        near = (after == self.time_s.size) & (stamps - lower <= self.gap_s)
        return np.where(inside & (after < self.time_s.size) | near, values, np.nan)


def _stand_alone(before: Array, values: Array) -> tuple[NDArray[np.bool_], bool]:
    """Which of the new readings (N,) stand alone, and whether the last one may.

    They differ from the readings on both sides, which agree: by 20 robust deviations of the steps, and by half of what
    the signal covered lately, as in `sysid.outliers`.
    """
    alone = np.zeros(values.size, np.bool_)
    if before.size < _FIRST_SAMPLES:
        return alone, False
    joined = np.concatenate([before[-1:], values])
    steps = np.abs(np.diff(joined))
    usual = np.abs(np.diff(before))
    # Most readings are within the first limit by the lower of the two middle steps, and percentiles cost time.
    if steps.max() <= SIGMAS * MAD_TO_SIGMA * np.partition(usual, (usual.size - 1) // 2)[(usual.size - 1) // 2]:
        return alone, False
    low, high = np.percentile(before, (5.0, 95.0))
    limit = max(SIGMAS * MAD_TO_SIGMA * float(np.median(usual)), SHARE * float(high - low))
    if not (steps > limit).any():
        return alone, False
    across = np.abs(joined[2:] - joined[:-2])
    alone[:-1] = (np.minimum(steps[:-1], steps[1:]) > limit) & (across < 0.5 * np.minimum(steps[:-1], steps[1:]))
    return alone, bool(steps[-1] > limit and not alone[-2:-1].any())


class TimeBase:
    """Makes rows of the `needed` signals, which must all be there, and of `others`, which may be NaN."""

    def __init__(self, needed: Sequence[str], others: Sequence[str] = ()) -> None:
        self._needed, self._others = tuple(needed), tuple(others)
        self._tracks = {name: _Track() for name in (*needed, *others, BASE)}
        self.interval_s: float | None = None
        self._last = -np.inf

    def need(self, needed: Sequence[str]) -> None:
        """Other signals are needed from here on; the rows begin a new run."""
        self._needed = tuple(needed)
        self._tracks = {name: self._tracks.get(name, _Track()) for name in (*needed, *self._others, BASE)}
        self._unbroken = False

    def add(self, samples: Mapping[str, tuple[Array, Array]]) -> None:
        """Take samples: name -> stamps (s, ascending) and values. Signals nobody asked for are left out."""
        for name, (time_s, values) in samples.items():
            if name in self._tracks:
                self._tracks[name].add(time_s, values, angle=name in ANGLES, held=is_held(name))

    def left_out(self) -> dict[str, int]:
        """How many readings of each signal stood alone, where there were any."""
        return {name: track.left_out for name, track in self._tracks.items() if track.left_out}

    def missing(self) -> list[str]:
        """Needed signals of which nothing has come, or nothing lately."""
        now = self._tracks[BASE].newest
        return [name for name in self._needed if self._tracks[name].newest < now - 10.0 * GAP_S]

    def rows(self) -> list[Rows]:
        """The rows that are complete now, cut at gaps."""
        base = self._tracks[BASE]
        if self.interval_s is None:
            if base.time_s.size < _FIRST_SAMPLES:
                return []
            self.interval_s = float(np.median(np.diff(base.time_s)))
        present = [self._tracks[name].newest for name in self._needed if self._tracks[name].time_s.size]
        ready = max(min(present, default=-np.inf), base.newest - _PATIENCE_S)
        stamps = base.time_s[(base.time_s > self._last + 1e-6) & (base.time_s <= ready + 1e-6)]
        if not stamps.size:
            return []
        stamps = self._filled(stamps)
        columns = {name: track.at(stamps, held=is_held(name)) for name, track in self._tracks.items()}
        pieces = self._cut(stamps, columns, self._told(stamps))
        self._last = float(stamps[-1])
        for track in self._tracks.values():
            track.trim(self._last - _KEPT_S)
        return pieces

    def _filled(self, stamps: Array) -> Array:
        """With the stamps of single lost samples put in."""
        assert self.interval_s is not None
        whole = np.concatenate([[self._last], stamps]) if np.isfinite(self._last) else stamps
        steps = np.diff(whole)
        short = (steps > 1.5 * self.interval_s) & (steps <= GAP_S)
        if not short.any():
            return stamps
        extra = [
            np.linspace(whole[i], whole[i + 1], round(steps[i] / self.interval_s) + 1)[1:-1]
            for i in np.flatnonzero(short)
        ]
        return np.sort(np.concatenate([stamps, *extra]))

    def _told(self, stamps: Array) -> NDArray[np.bool_]:
        tracks = [self._tracks[name] for name in self._needed if is_held(name) and self._tracks[name].time_s.size]
        told: NDArray[np.bool_] = np.logical_and.reduce(
            [np.ones(stamps.size, np.bool_), *(track.told(stamps) for track in tracks)]
        )
        return told

    def _cut(self, stamps: Array, columns: dict[str, Array], told: NDArray[np.bool_]) -> list[Rows]:
        assert self.interval_s is not None
        whole = Rows(self.interval_s, stamps, columns, False, told)
        good = np.logical_and.reduce([np.isfinite(columns[name]) for name in self._needed])
        follows = np.diff(stamps, prepend=self._last) <= 1.5 * self.interval_s
        pieces: list[Rows] = []
        start = 0
        while start < stamps.size:
            if not good[start]:
                start += 1
                continue
            stop = start + 1
            while stop < stamps.size and good[stop] and follows[stop]:
                stop += 1
            continues = bool(follows[start]) and start == 0 and self._unbroken
            pieces.append(whole.part(start, stop, continues=continues))
            start = stop
        self._unbroken = bool(good[-1])
        return pieces

    _unbroken = False
