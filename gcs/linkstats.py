"""What a link carries, per system: rates, losses by sequence gaps, checksum failures, and how the clocks run."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs.dialect import Dialect
from gcs.framing import Frames
from sim_vehicle.jit import jit

_RATE_WINDOW_S = 5
_CLOCK_BUCKETS = 600
_MIN_DRIFT_S = 10.0
SYSTEM_TIME = 2


@jit
def _count_sequence(
    sender: NDArray[np.int64],
    sequence: NDArray[np.uint8],
    last: NDArray[np.int64],
    received: NDArray[np.int64],
    lost: NDArray[np.int64],
) -> None:
    """Count frames and gaps per sender (system << 8 | component). A step of 0 is a repeat, not 255 lost frames.

    Steps of up to 32 back are frames out of order, which fill a gap counted before.
    """
    for i in range(sender.size):
        s = sender[i]
        received[s] += 1
        if last[s] < 0:
            last[s] = sequence[i]
            continue
        step = (sequence[i] - last[s]) & 0xFF
        if step == 0:
            continue
        if step >= 224:
            if lost[s] > 0:
                lost[s] -= 1
            continue
        lost[s] += step - 1
        last[s] = sequence[i]


@dataclass
class _Clock:
    """Smallest (reception - boot time) of each second: the envelope that delays on the way cannot reach."""

    seconds: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=_CLOCK_BUCKETS))

    def add(self, received_s: float, boot_s: float) -> None:
        offset = received_s - boot_s
        if self.seconds and abs(offset - self.seconds[-1][1]) > 1.0:
            self.seconds.clear()  # the vehicle was restarted
        if self.seconds and received_s - self.seconds[-1][0] < 1.0:
            at, best = self.seconds[-1]
            self.seconds[-1] = (at, min(best, offset))
        else:
            self.seconds.append((received_s, offset))

    def offset_s(self) -> float | None:
        return self.seconds[-1][1] if self.seconds else None

    def drift_ppm(self) -> float | None:
        """How much faster the vehicle's clock runs than ours."""
        if len(self.seconds) < 3 or self.seconds[-1][0] - self.seconds[0][0] < _MIN_DRIFT_S:
            return None
        at, offset = np.array(self.seconds).T
        slope = np.polyfit(at - at[0], offset - offset[0], 1)[0]
        return float(-slope * 1e6)


class LinkStatistics:
    """Statistics of one link, fed with what its framer found. Thread-safe."""

    def __init__(self, dialect: Dialect) -> None:
        self._lock = threading.Lock()
        self._last = np.full(1 << 16, -1, np.int64)
        self._received = np.zeros(1 << 16, np.int64)
        self._lost = np.zeros(1 << 16, np.int64)
        self._per_second: deque[tuple[int, int, int]] = deque(maxlen=_RATE_WINDOW_S + 1)
        self._clocks: dict[int, _Clock] = {}
        self._frames = self._raw = self._bad_crc = self._unknown = 0

    def add(self, frames: Frames, received_ns: NDArray[np.int64]) -> None:
        """Count one batch. received_ns: (len(frames),) UTC time of each frame."""
        with self._lock:
            self._raw += frames.raw
            self._bad_crc += frames.bad_crc
            if len(frames) == 0:
                return
            self._frames += len(frames)
            self._unknown += frames.unknown
            sender = frames.sysid.astype(np.int64) << 8 | frames.compid
            _count_sequence(sender, frames.seq, self._last, self._received, self._lost)
            second = int(received_ns[-1]) // 1_000_000_000
            size = int(frames.length.sum())
            if self._per_second and self._per_second[-1][0] == second:
                _, count, total = self._per_second[-1]
                self._per_second[-1] = (second, count + len(frames), total + size)
            else:
                self._per_second.append((second, len(frames), size))
            self._add_clocks(frames, received_ns)

    def _add_clocks(self, frames: Frames, received_ns: NDArray[np.int64]) -> None:
        for i in np.flatnonzero((frames.msgid == SYSTEM_TIME) & (frames.message >= 0)).tolist():
            start = int(frames.payload_offset[i])
            payload = frames.buffer[start : start + int(frames.payload_length[i])].tobytes().ljust(12, b"\0")
            boot_ms = int.from_bytes(payload[8:12], "little")
            clock = self._clocks.setdefault(int(frames.sysid[i]), _Clock())
            clock.add(int(received_ns[i]) / 1e9, boot_ms / 1e3)

    def to_json(self, now_ns: int) -> dict[str, object]:
        """Rates over the last 5 s, totals, and one entry for each system."""
        with self._lock:
            newest = now_ns // 1_000_000_000
            recent = [entry for entry in self._per_second if newest - _RATE_WINDOW_S <= entry[0] < newest]
            systems: dict[int, dict[str, object]] = {}
            for sender in np.flatnonzero(self._received).tolist():
                entry = systems.setdefault(sender >> 8, self._system(sender >> 8))
                received, lost = int(self._received[sender]), int(self._lost[sender])
                components = entry["components"]
                assert isinstance(components, list)
                components.append(
                    {
                        "component": sender & 0xFF,
                        "received": received,
                        "lost": lost,
                        "loss": lost / (received + lost),
                    }
                )
            return {
                "frames": self._frames,
                "frames_per_s": sum(entry[1] for entry in recent) / _RATE_WINDOW_S,
                "bytes_per_s": sum(entry[2] for entry in recent) / _RATE_WINDOW_S,
                "raw_bytes": self._raw,
                "bad_crc": self._bad_crc,
                "unknown_messages": self._unknown,
                "systems": list(systems.values()),
            }

    def _system(self, system: int) -> dict[str, object]:
        clock = self._clocks.get(system)
        return {
            "system": system,
            "clock_offset_s": clock.offset_s() if clock else None,
            "clock_drift_ppm": clock.drift_ppm() if clock else None,
            "components": [],
        }
