"""Samples that come as they come -> rows on the stamps of the accelerometer.

A row is made once every signal has reached its stamp, or when the accelerometer is so far ahead that the others will
hardly come any more. A lost sample of the accelerometer is interpolated; a longer gap begins a new run of rows.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.arrays import Array
from sysid.live.signals.sample_buffer import Tracks
from sysid.signals.resampling import GAP_S

BASE = "az"
# How far the accelerometer may run ahead of a signal before the row is made without it.
_PATIENCE_S = 0.08
_KEPT_S = 1.0
_KEPT_ALONE_S = 60.0


@dataclass(frozen=True)
class Rows:
    """N rows without gaps. time_s: (N,). columns: name -> (N,). continues: whether the first one follows the last.

    Commands are means over the interval before each row, as their own stamps have them.
    commands_known: (N,) whether all commands are known; the one before is held where a message is lost.
    """

    interval_s: float
    time_s: Array
    columns: dict[str, Array]
    continues: bool
    commands_known: NDArray[np.bool_]

    def part(self, start: int, stop: int, *, continues: bool) -> Rows:
        """Some of the rows."""
        columns = {name: values[start:stop] for name, values in self.columns.items()}
        return Rows(self.interval_s, self.time_s[start:stop], columns, continues, self.commands_known[start:stop])


class TimeBase:
    """Makes rows of the `needed` signals, which must all be there, and of `others`, which may be NaN.

    named: controls of other names than the usual four.
    """

    def __init__(self, needed: Sequence[str], others: Sequence[str] = (), named: Collection[str] = ()) -> None:
        self._others, self._named = tuple(others), tuple(named)
        self._tracks = Tracks((), self._named)
        self.interval_s: float | None = None
        self._last = -np.inf
        self._unbroken = False
        self.need(needed)

    def need(self, needed: Sequence[str]) -> None:
        """These signals are needed from here on; the rows begin a new run."""
        names = tuple(dict.fromkeys((*needed, *self._others, BASE)))
        self._tracks = Tracks(names, self._named).taken_from(self._tracks)
        self._needed = np.array([names.index(name) for name in needed], np.int64)
        self._commands = self._needed[self._tracks.held[self._needed]]
        self._base = names.index(BASE)
        self._unbroken = False

    def add(self, samples: Mapping[str, tuple[Array, Array]]) -> None:
        """Take samples: name -> stamps (s, ascending) and values. Signals nobody asked for are left out."""
        self._tracks.add(samples)

    def __len__(self) -> int:
        """Samples of the signal of which most are kept."""
        return len(self._tracks)

    def left_out(self) -> dict[str, int]:
        """How many readings of each signal stood alone, where there were any."""
        counts = zip(self._tracks.names, self._tracks.left_out.tolist(), strict=True)
        return {name: count for name, count in counts if count}

    def missing(self) -> list[str]:
        """Needed signals of which nothing has come, or nothing lately."""
        newest = self._tracks.newest
        late = self._needed[newest[self._needed] < newest[self._base] - 10.0 * GAP_S]
        return [self._tracks.names[i] for i in late]

    def rows(self) -> list[Rows]:
        """The rows that are complete now, cut at gaps."""
        newest = self._tracks.newest
        if self.interval_s is None:
            self.interval_s = self._tracks.period_s(BASE)
            if self.interval_s is None:
                self._tracks.trim(float(newest.max()) - _KEPT_ALONE_S)
                return []
        there = newest[self._needed]
        there = there[np.isfinite(there)]
        ready = max(float(there.min()) if there.size else -np.inf, float(newest[self._base]) - _PATIENCE_S)
        stamps = self._tracks.stamps_after(BASE, self._last, ready)
        if not stamps.size:
            # The others may go on for long after the last sample of the accelerometer.
            self._tracks.trim(float(newest.max()) - _KEPT_ALONE_S)
            return []
        stamps = self._filled(stamps)
        values = self._tracks.at(stamps)
        self._average_commands(stamps, values)
        commands = self._commands[np.isfinite(newest[self._commands])]
        pieces = self._cut(stamps, values, self._tracks.held_known(stamps, commands))
        self._last = float(stamps[-1])
        self._tracks.trim(self._last - _KEPT_S)
        return pieces

    def _average_commands(self, stamps: Array, values: Array) -> None:
        """Put the mean of each command over the interval before a row in the place of its value there."""
        assert self.interval_s is not None
        if not self._commands.size:
            return
        begins = np.concatenate([[self._last], stamps[:-1]])
        begins = np.where(stamps - begins <= 1.5 * self.interval_s, begins, stamps - self.interval_s)
        means = self._tracks.means(begins, stamps, self._commands)
        values[self._commands] = np.where(np.isfinite(values[self._commands]), means, np.nan)

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

    def _cut(self, stamps: Array, values: Array, commands_known: NDArray[np.bool_]) -> list[Rows]:
        assert self.interval_s is not None
        whole = Rows(self.interval_s, stamps, dict(zip(self._tracks.names, values, strict=True)), False, commands_known)
        good = np.asarray(np.isfinite(values[self._needed]).all(axis=0), np.bool_)
        follows: NDArray[np.bool_] = np.diff(stamps, prepend=self._last) <= 1.5 * self.interval_s
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
