"""One clock for a flight: the vehicle's time since boot, for messages with and without a stamp.

A stamp may count from boot or from 1970, be 32 or 64 bits wide, come from another board with a clock of its own, or be
missing. All are put on the reference component's time since boot:

- 32-bit stamps are unwrapped against the time of reception, and joined to the others by whole periods;
- stamps since 1970 are recognised by their size (as the MAVLink definition of `time_usec` says) and moved by the
  difference that SYSTEM_TIME gives, or, without it, by the difference of the two kinds' arrival;
- another component whose stamps disagree is moved so that its earliest arrivals agree, with a warning;
- a message without a stamp gets its time of reception through the fitted line of reception over stamp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gcs.clock.fit import NS_PER_S, ClockFit, Times, fit_clock
from gcs.errors import SignalMapError

SMALLEST_EPOCH_NS = 500_000_000 * NS_PER_S  # 1985; no vehicle has been up for 16 years
SAME_COMPONENT_NS = 2 * NS_PER_S  # a GPS fix may be stamped that much before it is sent
OTHER_COMPONENT_NS = NS_PER_S // 10  # a second board's clock is as good as its time synchronisation
RESET_NS = NS_PER_S
AT_ONCE_NS = 3 * NS_PER_S // 10
STRAY_NS = 10 * NS_PER_S
NEIGHBOURS = 7  # stamps among which up to three strays are detected


@dataclass(frozen=True)
class Stamps:
    """Stamps of one message of one component in order of reception.

    log_ns: (N,) time of reception, UTC. raw_ns: (N,) the message's own stamp; what a 0 means, `valid` says.
    period_ns: after how long the field wraps, 0 for 64 bits.
    """

    message: str
    component: int
    log_ns: Times
    raw_ns: Times
    period_ns: int = 0

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """(N,) which messages carry a stamp.

        A 0 is how MAVLink leaves a stamp out. At the very start, before stamps of the first second, it is the moment of
        boot: as many of them as there are messages of the next stamp (a message that comes under several names).
        """
        given: NDArray[np.bool_] = self.raw_ns != 0
        first = int(np.argmax(given)) if given.any() else 0
        if first > 0 and self.raw_ns[first] <= NS_PER_S:
            alike = int(np.argmin(self.raw_ns[first:] == self.raw_ns[first])) or self.raw_ns.size - first
            given[:first] = first <= alike
        return given

    @property
    def is_short(self) -> bool:
        """Whether the stamp wraps within a day, so that it says nothing of how long ago the vehicle started."""
        return 0 < self.period_ns < 86_400 * NS_PER_S


def unwrap(stamps: Stamps) -> Times:
    """Raw stamps with whole periods added so that they follow the time of reception; first one as it is."""
    if stamps.period_ns == 0 or stamps.raw_ns.size == 0:
        return stamps.raw_ns
    if not stamps.valid.any():
        return stamps.raw_ns
    start = int(np.argmax(stamps.valid))
    expected = stamps.log_ns - stamps.log_ns[start] + stamps.raw_ns[start]
    turns = np.rint((expected - stamps.raw_ns).astype(np.float64) / stamps.period_ns).astype(np.int64)
    return np.where(stamps.valid, stamps.raw_ns + turns * stamps.period_ns, 0)


@dataclass
class VehicleClock:
    """The clock of one flight; times come out in seconds from its first stamp.

    fit: reception over the reference component's time since boot. epoch_ns: 1970 minus boot, None where unknown.
    start_ns: first stamp, time since boot. offsets: (component, message) -> what is added to its stamps, ns.
    window: first and last reception of the flight, the one with most messages between two restarts of the clock.
    """

    fit: ClockFit
    reference: int
    epoch_ns: int | None
    start_ns: int
    window: tuple[int, int]
    offsets: dict[tuple[int, str], int] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    def seconds(self, stamps: Stamps) -> NDArray[np.float64]:
        """Seconds from the flight's first stamp of every message, by reception where it carries no stamp."""
        own = boot_stamps(stamps, self.epoch_ns, self.fit) + self.offsets.get((stamps.component, stamps.message), 0)
        times = np.where(stamps.valid, own, self.fit.to_vehicle(stamps.log_ns))
        return np.asarray((times - self.start_ns) / NS_PER_S, dtype=np.float64)

    def inside(self, log_ns: Times) -> NDArray[np.bool_]:
        """Which receptions belong to the flight."""
        return np.asarray((log_ns >= self.window[0]) & (log_ns <= self.window[1]))


def boot_stamps(stamps: Stamps, epoch_ns: int | None, fit: ClockFit | None = None) -> Times:
    """Stamps unwrapped and since boot; with `fit`, joined to its clock by whole periods as well."""
    own = unwrap(stamps)
    if epoch_ns is not None:
        own = np.where(own > SMALLEST_EPOCH_NS, own - epoch_ns, own)
    valid = stamps.valid
    if fit is not None and stamps.period_ns and valid.any():
        # The stamp had wrapped before the recording began, where it lies whole periods behind the others.
        late = float(np.median(fit.delay(stamps.log_ns[valid], own[valid])))
        own = own + round(late / stamps.period_ns) * stamps.period_ns
    return own


def build_clock(stamps: Sequence[Stamps], system_time: tuple[Times, Times, Times] | None = None) -> VehicleClock:
    """The clock of a flight from the stamps of all its messages.

    system_time: SYSTEM_TIME's (reception ns, unix ns, boot ns), each (M,), if the vehicle sends any.
    Raises SignalMapError where no message carries a stamp.
    """
    stamped = [entry for entry in stamps if entry.valid.any()]
    if not stamped:
        raise SignalMapError("no message of the vehicle carries a time stamp; the recording cannot be put on one clock")
    warnings: list[str] = []
    window = longest_run(stamped, warnings)
    stamped = [cut for entry in stamped if (cut := _cut(entry, window)).raw_ns.size]
    if system_time is not None:
        inside = (system_time[0] >= window[0]) & (system_time[0] <= window[1])
        system_time = (system_time[0][inside], system_time[1][inside], system_time[2][inside])
    epoch = _epoch(stamped, system_time, warnings)
    reference = _reference_component(stamped)
    clock = VehicleClock(_fit_reference(stamped, reference, epoch), reference, epoch, 0, window, {}, warnings)
    for component in sorted({entry.component for entry in stamped}):
        _align(clock, [entry for entry in stamped if entry.component == component])
    clock.start_ns = min(_first_stamp(clock, entry) for entry in stamped)
    return clock


def _leader(group: Sequence[Stamps]) -> Stamps:
    """The message that gives a component's time: its commonest with a stamp that does not wrap."""
    return max([entry for entry in group if not entry.is_short] or group, key=lambda entry: entry.raw_ns.size)


def _fit_reference(stamped: Sequence[Stamps], reference: int, epoch: int | None) -> ClockFit:
    """Fit over the reference component's commonest message and every other of it that keeps the same clock."""
    own = [entry for entry in stamped if entry.component == reference]
    own = [entry for entry in own if not entry.is_short] or own
    leader = _leader(own)
    clock = boot_stamps(leader, epoch)
    order = np.argsort(leader.log_ns, kind="stable")
    logs, times = [], []
    for entry in own:
        stamps = boot_stamps(entry, epoch)
        if abs(_behind(entry.log_ns, stamps, leader.log_ns[order], clock[order])) < SAME_COMPONENT_NS:
            logs.append(entry.log_ns)
            times.append(stamps)
    return fit_clock(np.concatenate(logs), np.concatenate(times))


def _first_stamp(clock: VehicleClock, entry: Stamps) -> int:
    """Earliest stamp that its neighbours confirm, ns since boot: one stray stamp must not move the flight's start."""
    times = boot_stamps(entry, clock.epoch_ns, clock.fit) + clock.offsets.get((entry.component, entry.message), 0)
    window = min(NEIGHBOURS, times.size)
    around = np.median(np.lib.stride_tricks.sliding_window_view(times, window), axis=1)
    place = np.clip(np.arange(times.size) - window // 2, 0, around.size - 1)
    confirmed = np.abs(times - around[place]) < STRAY_NS
    return int(times[confirmed].min()) if confirmed.any() else int(clock.fit.to_vehicle(entry.log_ns).min())


def _behind(log_ns: Times, stamp_ns: Times, clock_log_ns: Times, clock_stamp_ns: Times) -> int:
    """How far, ns, stamps lie behind another message's of the same clock, by the order of reception alone.

    log_ns, stamp_ns: (N,) of the message. clock_log_ns, clock_stamp_ns: (M,) of the one that gives the time. A stamp
    belongs between those of the messages received before and after it; the median of how far it lies outside bears
    strays, pauses, bursts and a flight sent faster than it was flown, which a line through the arrivals does not.
    """
    before = np.searchsorted(clock_log_ns, log_ns, side="left") - 1
    after = np.searchsorted(clock_log_ns, log_ns, side="right")
    unbounded = np.iinfo(np.int64).max
    low = np.where(before >= 0, clock_stamp_ns[np.maximum(before, 0)], -unbounded)
    high = np.where(after < clock_stamp_ns.size, clock_stamp_ns[np.minimum(after, clock_stamp_ns.size - 1)], unbounded)
    outside = np.where(stamp_ns < low, low - stamp_ns, np.where(stamp_ns > high, high - stamp_ns, 0))
    return int(np.median(outside))


def _cut(entry: Stamps, window: tuple[int, int]) -> Stamps:
    inside = _chosen(entry, (entry.log_ns >= window[0]) & (entry.log_ns <= window[1]))
    return _chosen(inside, inside.valid)


def _chosen(entry: Stamps, keep: NDArray[np.bool_]) -> Stamps:
    return Stamps(entry.message, entry.component, entry.log_ns[keep], entry.raw_ns[keep], entry.period_ns)


def _reference_component(stamped: Sequence[Stamps]) -> int:
    """The autopilot (component 1) where it sends stamps, else whoever sends most."""
    counts: dict[int, int] = {}
    for entry in stamped:
        counts[entry.component] = counts.get(entry.component, 0) + entry.raw_ns.size
    return 1 if 1 in counts else max(counts, key=lambda component: counts[component])


def restarts(entry: Stamps) -> Times:
    """Receptions at which the clock since boot begins anew, ns; none for a stamp that wraps within a day."""
    boot = entry.valid & (entry.raw_ns < SMALLEST_EPOCH_NS)
    times, log = entry.raw_ns[boot], entry.log_ns[boot]
    if entry.is_short or times.size < 4:
        return np.empty(0, np.int64)
    # A single stray stamp looks like a restart, so two on either side must agree.
    before, after = np.minimum(times[:-3], times[1:-2]), np.maximum(times[2:-1], times[3:])
    places = np.flatnonzero(after < before - RESET_NS) + 2
    # Of messages that a held-up link brings out of order all at once, some are as new as those before.
    ends = np.searchsorted(log, log[places] + AT_ONCE_NS, side="right")
    newest = np.array([times[place:end].max() for place, end in zip(places, ends, strict=True)], np.int64)
    return log[places[newest < before[places - 2] - RESET_NS]]


def longest_run(stamped: Sequence[Stamps], warnings: list[str]) -> tuple[int, int]:
    """First and last reception, ns, of the longest flight between two restarts of the vehicle's clock."""
    reference = _reference_component(stamped)
    # Messages without a stamp may come before the first stamp and after the last.
    edges = {0, int(np.iinfo(np.int64).max)}
    for entry in stamped:
        if entry.component == reference:
            edges.update(restarts(entry).tolist())
    cuts = sorted(edges)
    # Messages of the same restart are moments apart.
    cuts = [cut for i, cut in enumerate(cuts) if i == 0 or cut - cuts[i - 1] > 2 * NS_PER_S or i == len(cuts) - 1]
    runs = [(a, b - 1) for a, b in pairwise(cuts)]
    if len(runs) > 1:
        warnings.append(
            f"the vehicle's clock restarted, {len(runs) - 1} times; the longest flight is taken, the rest left out"
        )
    return max(
        runs, key=lambda run: sum(np.count_nonzero((e.log_ns >= run[0]) & (e.log_ns <= run[1])) for e in stamped)
    )


def _epoch(
    stamped: Sequence[Stamps], system_time: tuple[Times, Times, Times] | None, warnings: list[str]
) -> int | None:
    """1970 minus boot, ns; None where neither SYSTEM_TIME nor two kinds of stamps give it."""
    if system_time is not None:
        _, unix, boot = system_time
        known = (unix > SMALLEST_EPOCH_NS) & (boot > 0)
        if known.any():
            differences = unix[known] - boot[known]
            # time_boot_ms is cut off to whole ms, so the smallest difference is the true one, while they agree.
            spread = int(differences.max() - differences.min())
            if spread > NS_PER_S // 10:
                warnings.append(f"the vehicle's UTC was set during the flight, by {spread / NS_PER_S:.1f} s")
            return int(differences.min()) if spread <= NS_PER_S // 500 else int(np.median(differences))
    kinds: dict[bool, list[int]] = {True: [], False: []}
    for entry in stamped:
        times = unwrap(entry)
        for since_epoch in (True, False):
            chosen = (times > SMALLEST_EPOCH_NS) == since_epoch
            if chosen.any() and not (entry.is_short and not since_epoch):
                kinds[since_epoch].append(fit_clock(entry.log_ns[chosen], times[chosen]).offset_ns)
    if not kinds[True]:
        return None
    if not kinds[False]:
        return 0
    warnings.append("stamps since boot and since 1970 without SYSTEM_TIME; they are joined by their arrival")
    return min(kinds[False]) - min(kinds[True])


def _align(clock: VehicleClock, group: Sequence[Stamps]) -> None:
    """Move the stamps of one component where they do not agree with the reference's clock.

    Within the reference component each message stands for itself, within another all move together.
    """
    component = group[0].component
    times = {entry.message: boot_stamps(entry, clock.epoch_ns, clock.fit) for entry in group}
    if component == clock.reference:
        leader = _leader(group)
        order = np.argsort(leader.log_ns, kind="stable")
        timed = (leader.log_ns[order], times[leader.message][order])
        delays = {entry.message: _behind(entry.log_ns, times[entry.message], *timed) for entry in group}
        apart = {message: late for message, late in delays.items() if abs(late) > SAME_COMPONENT_NS}
    else:
        delays = {e.message: int(np.quantile(clock.fit.delay(e.log_ns, times[e.message]), 0.05)) for e in group}
        smallest = min(delays.values())
        apart = dict.fromkeys(delays, smallest) if abs(smallest) > OTHER_COMPONENT_NS else {}
    clock.offsets.update({(component, message): shift for message, shift in apart.items()})
    if apart:
        clock.warnings.append(
            f"component {component} stamps {', '.join(apart)} by another clock,"
            f" {-min(apart.values()) / NS_PER_S:+.3f} s apart; they are aligned by their arrival"
        )
