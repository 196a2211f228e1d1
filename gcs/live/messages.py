"""From bytes to one vehicle's messages on one clock, as they come.

A recording knows the whole flight when its clock is fitted; here each stamp must be placed at once. Stamps since boot
are the clock; what carries a stamp since 1970 is moved by SYSTEM_TIME where the vehicle sends it, else, and what
carries no stamp at all, by its reception (gcs.live.reception).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gcs.clock.stamps import Stamps
from gcs.flights.sender import AUTOPILOT_INVALID, GCS
from gcs.flights.signal_sources import INSTANCE_FIELDS
from gcs.flights.streams import Stream
from gcs.links.datagrams import Batch
from gcs.live.reception import Reception
from gcs.mavlink.columns import FrameColumns, message_columns
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.frameparts import AUTOPILOT, LAST_VEHICLE, frame_times
from gcs.mavlink.framing import Framer, Frames

NS_PER_S = 1_000_000_000
# Stamps beyond are since 1970: nothing is switched on for thirty years.
_EPOCH_NS = 30 * 365 * 86_400 * NS_PER_S
# A stamp that falls behind the newest by more says that the vehicle has started anew.
_RESET_S = 5.0


@dataclass
class _Clock:
    """One vehicle's clock. since: the two kinds of stamps, since boot and since 1970."""

    boot: Reception = field(default_factory=Reception)
    epoch: Reception = field(default_factory=Reception)
    epoch_less_boot: int | None = None
    start_ns: int | None = None

    def place(self, stamps: Stamps) -> NDArray[np.int64]:
        """(N,) ns since boot of each message."""
        raw, valid, log_ns = stamps.raw_ns, stamps.valid, stamps.log_ns
        if not valid.any():
            return self.boot.at(log_ns) if self.boot.known else log_ns
        if stamps.period_ns and self.boot.known:
            whole = np.rint((self.boot.at(log_ns) - raw) / stamps.period_ns)
            raw = raw + whole.astype(np.int64) * stamps.period_ns
        epoch = bool(raw[valid][0] > _EPOCH_NS)
        (self.epoch if epoch else self.boot).add(log_ns[valid], raw[valid])
        if not epoch or not self.boot.known:
            return raw
        last = log_ns[-1:]
        shift = self.epoch_less_boot
        return raw - (self.epoch.at(last) - self.boot.at(last) if shift is None else shift)


class VehicleMessages:
    """Takes batches of all links and gives one vehicle's messages with their times.

    The vehicle is the first whose autopilot's HEARTBEAT is heard, of one system alone where it is bound. A message that
    a second link brings once more has the stamp of the first and is left out by whoever takes the signals.
    """

    def __init__(self, dialect: Dialect, wanted: Sequence[str]) -> None:
        self._dialect = dialect
        self._framers: dict[str, Framer] = {}
        self._bound: int | None = None
        self.want(wanted)
        self.restart()

    def want(self, wanted: Sequence[str]) -> None:
        """Give these messages from here on; vehicle and clock stay."""
        self._wanted = frozenset((*wanted, "SYSTEM_TIME"))

    def bind(self, system: int | None) -> bool:
        """Take only this system for the vehicle, None for any; whether the one that is followed may stay.

        One that may not is to be forgotten by `restart`.
        """
        self._bound = system
        return self.system is None or system is None or self.system == system

    def restart(self) -> None:
        """Forget the vehicle and its clock; unfinished frames stay."""
        self.system: int | None = None
        self.autopilot = AUTOPILOT_INVALID
        self._clock = _Clock()
        self._instances: dict[tuple[str, int], int] = {}
        self.newest_s: float | None = None

    def take(self, batches: Sequence[Batch]) -> list[Stream]:
        """Streams of the wanted messages in batches of any sources, `time_s` in s since the vehicle's first message.

        What several links brought is put in the order of reception, so that one fills the gaps of another.
        """
        by_source: dict[str, list[Batch]] = {}
        for batch in batches:
            by_source.setdefault(batch.source, []).append(batch)
        found: dict[tuple[str, int], list[Stream]] = {}
        for source, parts in by_source.items():
            for stream in self._framed(source, Batch.joined(parts)):
                found.setdefault((stream.message, stream.component), []).append(stream)
        return self._timed([self._lowest_instance(_in_order(parts)) for parts in found.values()])

    def _framed(self, source: str, batch: Batch) -> Iterator[Stream]:
        """The wanted messages of the vehicle in what one source brought."""
        framer = self._framers.setdefault(source, Framer(self._dialect))
        held = framer.pending
        _, frames = framer.feed(batch.data)
        if not len(frames):
            return
        received = frame_times(frames, batch.ends, batch.received_ns, held)
        columns = message_columns(frames, self._dialect)
        self._find_vehicle(frames, columns.get("HEARTBEAT"))
        if self.system is None:
            return
        for name in self._wanted & columns.keys():
            index, fields = columns[name].index, columns[name].fields
            mine = frames.sysid[index] == self.system
            if not mine.all():
                index, fields = index[mine], fields[mine]
            components = frames.compid[index]
            for component in sorted(set(components.tolist()), key=lambda c: (c != AUTOPILOT, c)):
                chosen = components == component
                whole = Stream(name, component, received[index], fields)
                yield whole if chosen.all() else whole.only(chosen)

    def _find_vehicle(self, frames: Frames, beats: FrameColumns | None) -> None:
        if self.system is not None or beats is None:
            return
        for index, beat in zip(beats.index.tolist(), beats.fields, strict=True):
            system = int(frames.sysid[index])
            if self._bound is not None and system != self._bound:
                continue
            if beat["type"] != GCS and beat["autopilot"] != AUTOPILOT_INVALID and system <= LAST_VEHICLE:
                self.system, self.autopilot = system, int(beat["autopilot"])
                return

    def _lowest_instance(self, stream: Stream) -> Stream:
        """Without the messages of a second sensor of the same kind."""
        name = INSTANCE_FIELDS.get(stream.message)
        if name is None or name not in (stream.records.dtype.names or ()) or not stream.log_ns.size:
            return stream
        instance = stream.records[name]
        key = (stream.message, stream.component)
        lowest = min(int(instance.min()), self._instances.get(key, 255))
        self._instances[key] = lowest
        chosen = np.asarray(instance == lowest)
        return stream if chosen.all() else stream.only(chosen)

    def _timed(self, streams: list[Stream], *, anew: bool = False) -> list[Stream]:
        """The streams with their times. anew: the clock has just started anew with them, which it does once a turn.

        Clocks of one vehicle that stand more than _RESET_S apart would start it for ever.
        """
        for stream in streams:
            if stream.message == "SYSTEM_TIME":
                self._take_system_time(stream)
        timed = []
        # Those with stamps first: they give the clock by which the others are placed.
        stamped = [(stream, stream.stamps) for stream in streams if stream.log_ns.size]
        for stream, stamps in sorted(stamped, key=lambda one: not one[1].valid.any()):
            if not stamps.valid.any() and not self._clock.boot.known:
                continue
            since_boot = self._clock.place(stamps)
            if self._clock.start_ns is None:
                self._clock.start_ns = int(since_boot.min())
            seconds = (since_boot - self._clock.start_ns) / NS_PER_S
            newest = float(seconds.max())
            if not anew and self.newest_s is not None and newest < self.newest_s - _RESET_S:
                system, autopilot = self.system, self.autopilot
                self.restart()
                self.system, self.autopilot = system, autopilot
                return self._timed(streams, anew=True)
            self.newest_s = newest if self.newest_s is None else max(self.newest_s, newest)
            timed.append(replace(stream, time_s=seconds))
        return timed

    def _take_system_time(self, stream: Stream) -> None:
        unix_us, boot_ms = stream.records["time_unix_usec"][-1], stream.records["time_boot_ms"][-1]
        if 0 < unix_us < 2**62 // 1000:
            self._clock.epoch_less_boot = int(unix_us) * 1_000 - int(boot_ms) * 1_000_000


def _in_order(parts: list[Stream]) -> Stream:
    """The same message of several sources, in the order of reception."""
    if len(parts) == 1:
        return parts[0]
    log_ns = np.concatenate([part.log_ns for part in parts])
    order = np.argsort(log_ns, kind="stable")
    records = np.concatenate([part.records for part in parts])
    return Stream(parts[0].message, parts[0].component, log_ns[order], records[order])
