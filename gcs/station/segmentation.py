"""Where one flight ends and the next begins.

A flight begins with the first bytes. It ends a moment after the vehicle disarms, when the vehicle has been silent for
a while, or where its clock starts again from zero (a reboot). Times are UTC ns of reception, handed in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink.dialect import STAMP_OFFSET, STAMP_SCALE, STAMP_SIZE, Dialect
from gcs.mavlink.framing import Frames
from sim_vehicle.jit import jit

HEARTBEAT = 0
#: Why a flight has ended: its vehicle was disarmed, or switched on again, or is heard no more.
DISARMED, RESTARTED, SILENCE = "disarmed", "clock reset", "silence"
_HEARTBEAT_LENGTH = 9
_TYPE_GROUND_STATION = 6  # MAV_TYPE_GCS
_AUTOPILOT_INVALID = 8  # MAV_AUTOPILOT_INVALID: a camera, a gimbal, a companion
_FLAG_ARMED = 0x80  # MAV_MODE_FLAG_SAFETY_ARMED
# A datagram that overtakes another makes a stamp go back a little; only a reboot makes it go back this far.
_CLOCK_RESET_MS = 2000
_WRAP_MS = 1 << 32
_LAG_MS = 5000  # how far one link may be behind another
# A link that begins when all others have been silent for so long may be the vehicle's after a restart.
_QUIET_NS = 1_000_000_000


@dataclass(frozen=True)
class Heartbeat:
    """The parts of one HEARTBEAT that say who sent it and whether it is armed. `index` is its place in the frames."""

    index: int
    system: int
    component: int
    ground_station: bool
    autopilot: bool
    armed: bool


def heartbeats(frames: Frames) -> list[Heartbeat]:
    """Every HEARTBEAT of a batch, in order."""
    found: list[Heartbeat] = []
    at = np.flatnonzero((frames.msgid == HEARTBEAT) & (frames.message >= 0))
    if at.size == 0:
        return found
    starts, lengths = frames.payload_offset[at].tolist(), frames.payload_length[at].tolist()
    systems, components = frames.sysid[at].tolist(), frames.compid[at].tolist()
    for i, index in enumerate(at.tolist()):
        sent = frames.buffer[starts[i] : starts[i] + lengths[i]].tobytes()
        payload = sent.ljust(_HEARTBEAT_LENGTH, b"\0")  # MAVLink 2 does not send trailing zeros
        found.append(
            Heartbeat(
                index,
                systems[i],
                components[i],
                ground_station=payload[4] == _TYPE_GROUND_STATION,
                autopilot=payload[5] != _AUTOPILOT_INVALID,
                armed=bool(payload[6] & _FLAG_ARMED),
            )
        )
    return found


@jit
def _first_reset(
    buffer: NDArray[np.uint8],
    payload: NDArray[np.int64],
    length: NDArray[np.uint8],
    sender: NDArray[np.int64],
    message: NDArray[np.int16],
    wanted: int,
    table: NDArray[np.int64],
    last: NDArray[np.int64],
    elsewhere: NDArray[np.int64],
    quiet_ms: int,
) -> int:
    """Index of the first frame of `wanted` whose boot clock went back; -1 if none. Updates `last` per message.

    elsewhere: (messages,) what the other links sent last. One that lags behind restarts a clock that they know already.
    quiet_ms: since when the links before this one are silent, -1 where there are none or they are not. What was
    switched on again since then has a clock no older; what is farther behind than any link is another vehicle.
    """
    for i in range(payload.size):
        row = message[i]
        if row < 0 or sender[i] != wanted:
            continue
        if table[row, STAMP_SIZE] != 4 or table[row, STAMP_SCALE] != 1_000_000:
            continue
        stamp = np.int64(0)
        for k in range(4):
            at = table[row, STAMP_OFFSET] + k
            if at < length[i]:
                stamp |= np.int64(buffer[payload[i] + at]) << (8 * k)
        back = last[row] - stamp
        other = elsewhere[row]
        known = other > 0 and abs(other - stamp) < _LAG_MS and last[row] - other > _CLOCK_RESET_MS
        if back > _CLOCK_RESET_MS and back < _WRAP_MS // 2 and not known:
            return i
        behind = other - stamp
        anew = stamp < quiet_ms + _CLOCK_RESET_MS or behind > _LAG_MS
        if quiet_ms >= 0 and other > 0 and behind > _CLOCK_RESET_MS and behind < _WRAP_MS // 2 and anew:
            return i
        last[row] = stamp
    return -1


class FlightSegmenter:
    """The state of one flight: who flies, whether it is armed, when it was last heard, where its clock stands."""

    def __init__(self, dialect: Dialect, silence_ns: int, disarm_ns: int) -> None:
        self._table = dialect.table
        self._silence_ns = silence_ns
        self._disarm_ns = disarm_ns
        self._clocks: dict[str, NDArray[np.int64]] = {}
        # When the vehicle was heard first and last over each link.
        self._heard: dict[str, tuple[int, int]] = {}
        self._ends_at: int | None = None
        self._last_ns: int | None = None
        self.system: int | None = None
        self.component = 0
        self._has_autopilot = False
        self.armed = False

    def heard(self, at_ns: int) -> None:
        """Frames of the vehicle (or of a system not known yet) arrived."""
        self._last_ns = at_ns if self._last_ns is None else max(self._last_ns, at_ns)

    def heartbeat(self, beat: Heartbeat, at_ns: int) -> None:
        """Take in a HEARTBEAT that is not a ground station's."""
        if self.system is None:
            self.system = beat.system
        if beat.system != self.system:
            return
        if self.component == 0 or (beat.autopilot and not self._has_autopilot):
            self.component, self._has_autopilot = beat.component, beat.autopilot
        if beat.component != self.component:
            return
        if self.armed and not beat.armed:
            self._ends_at = at_ns + self._disarm_ns
        elif beat.armed:
            self._ends_at = None
        self.armed = beat.armed

    def clock_reset(self, link: str, frames: Frames, received: NDArray[np.int64]) -> int | None:
        """Index of the first frame behind a reboot of the autopilot, as its stamps over this link show.

        received: (frames,) UTC ns. A link that begins where the others end, such as another port of the sender,
        goes on with their clock.
        """
        if self.system is None or self.system not in frames.systems:
            return None
        quiet_ms = self._quiet_ms(link, received)
        last = self._clocks.get(link)
        if last is None:
            last = self._clocks[link] = np.zeros(self._table.shape[0], np.int64)
        others = [clock for name, clock in self._clocks.items() if name != link]
        elsewhere = np.max(others, axis=0) if others else np.zeros_like(last)
        index = _first_reset(
            frames.buffer,
            frames.payload_offset,
            frames.payload_length,
            frames.sysid.astype(np.int64) << 8 | frames.compid,
            frames.message,
            self.system << 8 | self.component,
            self._table,
            last,
            elsewhere,
            quiet_ms,
        )
        return None if index < 0 else int(index)

    def forget_clock(self, link: str) -> None:
        """Take the next stamps over a link as they come, whatever came before."""
        self._clocks.pop(link, None)

    def _quiet_ms(self, link: str, received: NDArray[np.int64]) -> int:
        """For how long the links that this one follows have been silent; -1 where it follows none."""
        now_ns, newest_ns = int(received[0]), int(received[-1])
        first_ns, _ = self._heard.get(link, (now_ns, now_ns))
        self._heard[link] = first_ns, newest_ns
        before_ns = max((last for name, (_, last) in self._heard.items() if name != link), default=None)
        if before_ns is None or before_ns > first_ns or now_ns - before_ns < _QUIET_NS:
            return -1
        return (now_ns - before_ns) // 1_000_000

    def end_reason(self, now_ns: int) -> str | None:
        """Why the flight has ended by now, None while it goes on."""
        if self._ends_at is not None and now_ns >= self._ends_at:
            return DISARMED
        if self._last_ns is not None and now_ns - self._last_ns >= self._silence_ns:
            return SILENCE
        return None
