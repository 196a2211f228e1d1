"""The last samples of each signal in one table, on which compiled code works: signals are many, samples few."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit, jit_arrays
from sysid.arrays import Array, IntArray
from sysid.signals.outliers import MAD_TO_SIGMA, SHARE, SIGMAS
from sysid.signals.resampling import ANGLES, GAP_S, is_held

Flags = NDArray[np.bool_]

_FIRST_SAMPLES = 12  # of a signal, before which its usual interval is unknown
# A message that is later than so many of its periods after the one before is the next but one.
_LOST = 1.6
_SAME_S = 1e-6  # stamps that differ by less are the same


class Tracks:
    """Samples of S signals, `names`, of which `named` are controls of other names than the usual four. newest: (S,) the
    last stamps, s. left_out: (S,) readings that stood alone.
    """

    def __init__(self, names: Sequence[str], named: Collection[str] = ()) -> None:
        self.names = tuple(names)
        self._place = {name: i for i, name in enumerate(self.names)}
        size = len(self.names)
        self._time_s, self._values = np.zeros((size, 1)), np.zeros((size, 1))
        self._count = np.zeros(size, np.int64)
        self._angle = np.array([name in ANGLES for name in self.names], np.bool_)
        self.held: Flags = np.array([is_held(name, named) for name in self.names], np.bool_)
        # One reading of each may wait for the next one, which shows whether it stands alone: stamp, value.
        self._waiting = np.full((size, 2), np.nan)
        self._period_s, self._gap_s = np.full(size, GAP_S), np.full(size, GAP_S)
        self.newest = np.full(size, -np.inf)
        self.left_out = np.zeros(size, np.int64)

    def __len__(self) -> int:
        """Samples of the signal of which most are kept."""
        return int(self._count.max(initial=0))

    def taken_from(self, others: Tracks) -> Tracks:
        """These with what others hold of the same signals."""
        self._make_room(others._time_s.shape[1])
        for i, name in enumerate(self.names):
            j = others._place.get(name)
            if j is not None:
                for own, given in zip(self._columns(), others._columns(), strict=True):
                    own[i] = given[j]
                count = others._count[j]
                self._time_s[i, :count], self._values[i, :count] = others._time_s[j, :count], others._values[j, :count]
        return self

    def _columns(self) -> tuple[NDArray[np.generic], ...]:
        return (self._count, self._waiting, self._period_s, self._gap_s, self.newest, self.left_out)

    def add(self, samples: Mapping[str, tuple[Array, Array]]) -> None:
        """Take samples: name -> stamps (s) and values. Signals that have no track are left out."""
        chosen = [(self._place[name], *pair) for name, pair in samples.items() if name in self._place]
        if not chosen:
            return
        places, stamps, readings = zip(*chosen, strict=True)
        sizes = np.array([one.size for one in stamps])
        self._make_room(len(self) + int(sizes.max()) + 1)
        _add(
            np.array(places), np.cumsum(sizes), np.concatenate(stamps, dtype=np.float64),
            np.concatenate(readings, dtype=np.float64), self._angle, self.held, self._time_s, self._values, self._count,
            self._waiting, self._period_s, self._gap_s, self.newest, self.left_out,
        )  # fmt: skip

    def _make_room(self, samples: int) -> None:
        more = samples - self._time_s.shape[1]
        if more > 0:
            grown = ((0, 0), (0, max(more, samples // 2)))
            self._time_s, self._values = np.pad(self._time_s, grown), np.pad(self._values, grown)

    def stamps_after(self, name: str, after_s: float, until_s: float) -> Array:
        """(N,) of a signal, within these limits."""
        place = self._place[name]
        stamps = self._time_s[place, : self._count[place]]
        return stamps[(stamps > after_s + _SAME_S) & (stamps <= until_s + _SAME_S)]

    def period_s(self, name: str) -> float | None:
        """Median time from sample to sample; None before there are enough."""
        place = self._place[name]
        return float(self._period_s[place]) if self._gap_s[place] > GAP_S else None

    def at(self, stamps: Array) -> Array:
        """(S, N) values at the stamps, NaN where no sample is near."""
        found = np.empty((len(self.names), stamps.size))
        _at(stamps, self._time_s, self._values, self._count, self._gap_s, self.held, found)
        return found

    def means(self, begins: Array, stamps: Array, chosen: IntArray) -> Array:
        """(C, N) means of held signals, by place, from `begins` to `stamps`, each step where its own stamp has it."""
        found = np.empty((chosen.size, stamps.size))
        _means(begins, stamps, chosen, self._time_s, self._values, self._count, found)
        return found

    def held_known(self, stamps: Array, chosen: IntArray) -> Flags:
        """(N,) whether the held values of these signals, by place, are known at the stamps.

        They are not where the next one should have come and did not.
        """
        found = np.ones(stamps.size, np.bool_)
        _held_known(stamps, chosen, self._time_s, self._count, self._period_s, found)
        return found

    def trim(self, before_s: float) -> None:
        """Forget what is older, but for the last one before."""
        _trim(before_s, self._time_s, self._values, self._count)


@jit_arrays
def _add(
    places: IntArray, ends: IntArray, stamps: Array, readings: Array, angle: Flags, held: Flags, time_s: Array,
    values: Array, count: IntArray, waiting: Array, period_s: Array, gap_s: Array, newest: Array, left_out: IntArray,
) -> None:  # fmt: skip
    """Take each signal's new samples (which end at `ends`) into its track."""
    start = 0
    for n in range(places.size):
        i = places[n]
        first = stop = count[i]
        last = newest[i]
        if np.isfinite(waiting[i, 0]):
            time_s[i, stop], values[i, stop] = waiting[i, 0], waiting[i, 1]
            last = waiting[i, 0]
            waiting[i, 0] = np.nan
            stop += 1
        for k in range(start, ends[n]):
            if stamps[k] > last:
                last = stamps[k]
                time_s[i, stop], values[i, stop] = last, readings[k]
                if angle[i] and stop and np.isfinite(values[i, stop - 1]):
                    values[i, stop] += 2.0 * np.pi * np.rint((values[i, stop - 1] - readings[k]) / (2.0 * np.pi))
                stop += 1
        start = ends[n]
        if stop == first:
            continue
        if not held[i] and first >= _FIRST_SAMPLES:
            kept = _reject_isolated(time_s[i], values[i], first, stop, waiting[i])
            left_out[i] += stop - kept - (1 if np.isfinite(waiting[i, 0]) else 0)
            stop = kept
        count[i] = stop
        newest[i] = time_s[i, stop - 1]
        if gap_s[i] == GAP_S and stop > _FIRST_SAMPLES:
            period_s[i] = np.median(np.diff(time_s[i, :stop]))
            gap_s[i] = max(GAP_S * 1.001, 2.5 * period_s[i])


@jit_arrays
def _reject_isolated(time_s: Array, values: Array, first: int, stop: int, waiting: Array) -> int:
    """Leave out of the new readings [first, stop) those that stand alone; one past the last that is left.

    They differ from the readings on both sides, which agree: by 20 robust deviations of the steps, and by half of what
    the signal covered lately, as in `sysid.signals.outliers`. The last one may be the first of more: it waits.
    """
    largest = 0.0
    for k in range(first, stop):
        largest = max(largest, abs(values[k] - values[k - 1]))
    limit = SIGMAS * MAD_TO_SIGMA * np.median(np.abs(np.diff(values[:first])))
    if largest <= limit:
        return stop
    low, high = np.percentile(values[:first], np.array([5.0, 95.0]))
    limit = max(limit, SHARE * (high - low))
    if largest <= limit:
        return stop
    given = values[first - 1 : stop].copy()
    kept = first
    alone = False
    for k in range(1, given.size):
        step, before = abs(given[k] - given[k - 1]), alone
        alone = False
        if k + 1 < given.size:
            smaller = min(step, abs(given[k + 1] - given[k]))
            alone = smaller > limit and abs(given[k + 1] - given[k - 1]) < 0.5 * smaller
        elif step > limit and not before:
            waiting[0], waiting[1] = time_s[first - 1 + k], given[k]
            continue
        if not alone:
            time_s[kept], values[kept] = time_s[first - 1 + k], given[k]
            kept += 1
    return kept


@jit
def _at(
    stamps: Array, time_s: Array, values: Array, count: IntArray, gap_s: Array, held: Flags, found: Array
) -> None:  # fmt: skip
    for i in range(count.size):
        size = count[i]
        after = 0
        for k in range(stamps.size):
            while after < size and time_s[i, after] <= stamps[k] + _SAME_S:
                after += 1
            found[i, k] = np.nan
            if not after:
                continue
            age = stamps[k] - time_s[i, after - 1]
            if after == size:
                near = age <= gap_s[i]
            else:
                near = time_s[i, after] - time_s[i, after - 1] <= gap_s[i] or age <= _SAME_S
            if near and (held[i] or after == size or age <= 0.0):
                found[i, k] = values[i, after - 1]
            elif near:
                share = age / (time_s[i, after] - time_s[i, after - 1])
                found[i, k] = values[i, after - 1] + share * (values[i, after] - values[i, after - 1])


@jit
def _means(
    begins: Array, stamps: Array, chosen: IntArray, time_s: Array, values: Array, count: IntArray, found: Array
) -> None:  # fmt: skip
    for n in range(chosen.size):
        i = chosen[n]
        after = 0
        for k in range(stamps.size):
            # The last sample at or before the interval's begin, else the first there is.
            while after and time_s[i, after - 1] > begins[k] + _SAME_S:
                after -= 1
            while after < count[i] and time_s[i, after] <= begins[k] + _SAME_S:
                after += 1
            since, total = begins[k], 0.0
            value = values[i, max(after - 1, 0)]
            for j in range(after, count[i]):
                if time_s[i, j] >= stamps[k] - _SAME_S:
                    break
                total += (time_s[i, j] - since) * value
                since, value = time_s[i, j], values[i, j]
            found[n, k] = (total + (stamps[k] - since) * value) / (stamps[k] - begins[k])


@jit
def _held_known(stamps: Array, chosen: IntArray, time_s: Array, count: IntArray, period_s: Array, found: Flags) -> None:
    for n in range(chosen.size):
        i = chosen[n]
        late = _LOST * period_s[i]
        after = 0
        for k in range(stamps.size):
            while after < count[i] and time_s[i, after] <= stamps[k] + _SAME_S:
                after += 1
            if not after:
                found[k] = False
                continue
            lower = time_s[i, after - 1]
            next_in_time = after < count[i] and time_s[i, after] - lower < late
            if not next_in_time and stamps[k] - lower >= late - period_s[i]:
                found[k] = False


@jit
def _trim(before_s: float, time_s: Array, values: Array, count: IntArray) -> None:
    for i in range(count.size):
        first = 0
        while first < count[i] and time_s[i, first] < before_s:
            first += 1
        first = max(first - 1, 0)
        if first:
            count[i] -= first
            for k in range(count[i]):
                time_s[i, k], values[i, k] = time_s[i, k + first], values[i, k + first]
