"""Parts of a batch of frames, when they came, and whose they are."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink.framing import Frames

AUTOPILOT = 1  # MAV_COMP_ID_AUTOPILOT1
LAST_VEHICLE = 249  # ground stations count down from 255


def likely_vehicle(frames: Frames) -> int:
    """The system to name a recording by before any HEARTBEAT: the first autopilot among the frames, else the first."""
    if len(frames) == 0:
        return 0
    autopilots = np.flatnonzero(frames.compid == AUTOPILOT)
    return int(frames.sysid[autopilots[0] if autopilots.size else 0])


def autopilots(frames: Frames) -> set[int]:
    """Systems whose autopilot sent one of the frames; those numbered as ground stations are left out."""
    sent = (frames.compid == AUTOPILOT) & (frames.sysid <= LAST_VEHICLE) & (frames.message >= 0)
    return set(frames.sysid[sent].tolist())


def runs_by_vehicle(frames: Frames, vehicles: Collection[int]) -> list[tuple[int, int]]:
    """Ranges of frames that belong together: one, unless several vehicles share the link."""
    count = len(frames)
    if count == 0:
        return [(0, 0)]
    if len(frames.systems) == 1:
        return [(0, count)]
    systems = frames.sysid
    owner = np.where(np.isin(systems, list(vehicles)), systems.astype(np.int64), -1)
    seen = np.flatnonzero(owner >= 0)
    if seen.size == 0 or (owner[seen] == owner[seen[0]]).all():
        return [(0, count)]
    # A frame of no vehicle stays with the one before it.
    last = np.maximum.accumulate(np.where(owner >= 0, np.arange(count), -1))
    owner = np.where(last >= 0, owner[np.maximum(last, 0)], owner[seen[0]])
    cuts = np.flatnonzero(np.diff(owner)) + 1
    return list(zip([0, *cuts.tolist()], [*cuts.tolist(), count], strict=True))


def choose_frames(frames: Frames, chosen: NDArray[np.bool_] | None) -> Frames:
    """Those of the frames that were chosen, without the bytes between them; all where None is given."""
    if chosen is None or chosen.all():
        return frames
    return Frames(
        frames.buffer,
        frames.offset[chosen],
        frames.length[chosen],
        frames.msgid[chosen],
        frames.message[chosen],
        frames.kind[chosen],
        consumed=frames.consumed,
        bad_crc=0,
    )


def slice_frames(frames: Frames, start: int, stop: int) -> Frames:
    """Frames start..stop-1 with the bytes up to the next frame; the first range also takes the bytes in front."""
    if start == 0 and stop == len(frames):
        return frames
    begin = 0 if start == 0 else int(frames.offset[start])
    end = frames.consumed if stop == len(frames) else int(frames.offset[stop])
    part = slice(start, stop)
    return Frames(
        frames.buffer[begin:end],
        frames.offset[part] - begin,
        frames.length[part],
        frames.msgid[part],
        frames.message[part],
        frames.kind[part],
        consumed=end - begin,
        bad_crc=0,
    )


def frame_times(
    frames: Frames, ends: NDArray[np.int64], received_ns: NDArray[np.int64], held: int
) -> NDArray[np.int64]:
    """(N,) UTC ns at which the last byte of each frame came.

    ends: (M,) offset just behind each datagram or read. received_ns: (M,) when it came. held: bytes in front of them.
    """
    last_byte = frames.offset + frames.length - 1 - held
    index = np.searchsorted(ends, last_byte, side="right")
    return received_ns[np.minimum(index, ends.size - 1)]
