"""What a link carries, per system: rates, losses by sequence gaps, checksum failures, and how the clocks run."""

from __future__ import annotations

import struct
import threading
from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.clock.track import ClockState, ClockTracker
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.frame_counts import SenderAccount
from gcs.mavlink.frameparts import choose_frames
from gcs.mavlink.framing import Frames
from gcs.mavlink.signing import SignatureChecker, SignatureCounts, SignatureMemory

_RATE_WINDOW_S = 5
_SUMS = (
    *("frames", "frames_per_s", "bytes_per_s", "raw_bytes", "bad_crc", "unknown_messages", "other_senders"),
    *SignatureCounts().to_json(),
)


class LinkStatistics:
    """Statistics of one source (a peer of a link), fed with what its framer found. Thread-safe.

    key: what signatures are checked with; without one, signed frames are only counted. memory: of the
    stamps, shared by all sources. require_signed: whether other frames are only counted: no clock goes by them.
    """

    def __init__(
        self,
        dialect: Dialect,
        key: bytes | None = None,
        memory: SignatureMemory | None = None,
        *,
        require_signed: bool = False,
    ) -> None:
        self._lock = threading.Lock()
        self._account = SenderAccount()
        self._signatures = SignatureChecker(key, memory)
        self._require_signed = require_signed
        self._radio: dict[str, object] | None = None
        self._per_second: deque[tuple[int, int, int]] = deque(maxlen=_RATE_WINDOW_S + 1)
        self._clocks = ClockTracker(dialect)
        self._frames = self._raw = self._bad_crc = self._unknown = self._others = 0

    def add(self, frames: Frames, received_ns: NDArray[np.int64]) -> NDArray[np.bool_] | None:
        """Count one batch. received_ns: (len(frames),) UTC time of each frame.

        (len(frames),) which of them may be believed, None for all.
        """
        with self._lock:
            account = self._account
            account.add(frames)
            self._raw += frames.consumed - account.bytes
            self._bad_crc += frames.bad_crc
            if len(frames) == 0:
                return None
            self._frames += len(frames)
            self._unknown += account.unknown
            self._others += account.others
            good = self._signatures.add(frames, received_ns, account.signed)
            believed = good if self._require_signed else None
            second = int(received_ns[-1]) // 1_000_000_000
            if self._per_second and self._per_second[-1][0] == second:
                _, count, total = self._per_second[-1]
                self._per_second[-1] = (second, count + len(frames), total + account.bytes)
            else:
                self._per_second.append((second, len(frames), account.bytes))
            if account.radio >= 0:
                self._radio = radio_report(frames, account.radio, int(received_ns[account.radio]))
            times = received_ns if believed is None else received_ns[believed]
            self._clocks.add(choose_frames(frames, believed), times)
            return believed

    def to_json(self, now_ns: int) -> dict[str, Any]:
        """Rates over the last 5 s, totals, and one entry for each system.

        other_senders: frames of senders beyond those that are accounted for one by one.
        """
        clocks = {state.system: state for state in self.clocks()}
        with self._lock:
            newest = now_ns // 1_000_000_000
            recent = [entry for entry in self._per_second if newest - _RATE_WINDOW_S <= entry[0] < newest]
            systems: dict[int, dict[str, Any]] = {}
            for system, component, counts in self._account.senders():
                entry = systems.get(system) or systems.setdefault(system, _system(system, clocks.get(system)))
                sent = counts["received"] + counts["lost"]
                entry["components"].append({"component": component, **counts, "loss": counts["lost"] / sent})
            return {
                "frames": self._frames,
                "frames_per_s": sum(entry[1] for entry in recent) / _RATE_WINDOW_S,
                "bytes_per_s": sum(entry[2] for entry in recent) / _RATE_WINDOW_S,
                "raw_bytes": self._raw,
                "bad_crc": self._bad_crc,
                "unknown_messages": self._unknown,
                "other_senders": self._others,
                **self._signatures.counts.to_json(),
                "radio": self._radio,
                "systems": list(systems.values()),
            }

    def clocks(self, until_ns: int | None = None) -> list[ClockState]:
        """The clock of every system that sends its time; until_ns: as it was at the end of a flight."""
        with self._lock:
            clocks = self._clocks.snapshot()
        return clocks.states(until_ns)  # takes a while, for which reception need not wait


def _system(system: int, clock: ClockState | None) -> dict[str, Any]:
    return {"system": system, **(clock or ClockState(system, 0)).to_json(), "components": []}


def radio_report(frames: Frames, i: int, received_ns: int) -> dict[str, object]:
    """What frame i, a RADIO_STATUS or RADIO, says of a telemetry radio and of its partner (`rem…`)."""
    start = int(frames.payload_offset[i])
    sent = frames.buffer[start : start + int(frames.payload_length[i])].tobytes()
    values = struct.unpack("<HHBBBBB", sent.ljust(9, b"\0")[:9])  # MAVLink 2 does not send trailing zeros
    names = ("rxerrors", "fixed", "rssi", "remrssi", "txbuf", "noise", "remnoise")
    sender = {"system": int(frames.sysid[i]), "component": int(frames.compid[i])}
    return {**sender, "received_ns": received_ns, **dict(zip(names, values, strict=True))}


def merged(statistics: Sequence[tuple[str, dict[str, Any]]]) -> dict[str, Any]:
    """One link's statistics out of those of its sources: (source, its statistics), the first being the link itself.

    Losses stay apart by source: each counts what did not come that way, whatever came by another.
    """
    (first, whole), *others = [(name, {**entry}) for name, entry in statistics]
    _name_source(first, whole)
    for name, entry in others:
        _name_source(name, entry)
        for key in _SUMS:
            whole[key] += entry[key]
        whole["systems"] = [*whole["systems"], *entry["systems"]]
        newest = [radio for radio in (whole["radio"], entry["radio"]) if radio is not None]
        whole["radio"] = max(newest, key=lambda radio: radio["received_ns"], default=None)
    return whole


def _name_source(name: str, entry: dict[str, Any]) -> None:
    entry["systems"] = [{**system, "source": name} for system in entry["systems"]]
