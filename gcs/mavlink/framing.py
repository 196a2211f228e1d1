"""Finding MAVLink frames in a stream of bytes, and accounting for every other byte.

Frames are MAVLink 1 (0xFE) and 2 (0xFD, signed ones too), as the MAVLink serialisation guide lays them out.

- A frame counts when its checksum, seeded with the message's CRC_EXTRA, is right. A candidate whose checksum
  fails is ONE byte of noise, never its whole length: trusting a false header's length loses the good frames
  behind it.
- A frame of an id that the dialect does not know has an unknown CRC_EXTRA. It counts as a frame (kind UNKNOWN)
  when some CRC_EXTRA makes its checksum right, which noise does once in 256 times, and no frame with a right
  checksum begins inside it. So it can never swallow a good frame; at worst a few bytes of noise carry the
  wrong label.
- What is still unfinished at the end waits for more bytes. Frames and noise add up to the bytes consumed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink.crc import CRC_TABLES, SEED_FINDER, Int, crc_accumulate, crc_step
from gcs.mavlink.dialect import CRC_EXTRA, WIRE_SIZE, Dialect
from sim_vehicle.jit import jit

MAGIC_V1 = 0xFE
MAGIC_V2 = 0xFD
SIGNED = 0x01  # the only incompatibility flag there is; a frame with another must be refused
SIGNATURE_LENGTH = 13
SMALLEST_FRAME = 8
LARGEST_FRAME = 10 + 255 + 2 + SIGNATURE_LENGTH

#: Values of Frames.kind.
KNOWN, KNOWN_SIGNED, UNKNOWN = 0, 1, 2

#: Added to a frame's length by take_frame when the id is unknown.
UNKNOWN_ID = 1024

# What frame_at says when it found no frame.
_NOISE, _UNFINISHED, _BAD_CRC = 0, -1, -2

Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class Frames:
    """N frames in `buffer` (uint8), in order and not overlapping.

    offset: (N,) int64, of the magic byte. length: (N,) int32, all bytes with checksum and signature.
    msgid: (N,) int32. message: (N,) int16, row in the dialect's table, -1 for unknown ids.
    kind: (N,) uint8 of KNOWN, KNOWN_SIGNED, UNKNOWN (whose signature, if any, shows in `incompat`).
    consumed: bytes of `buffer` that are accounted for: sum(length) + raw.
    bad_crc: complete candidates of known id whose checksum was wrong.

    What is derived from these is worked out once, as several parts of the recorder ask for it.
    """

    buffer: Bytes
    offset: NDArray[np.int64]
    length: NDArray[np.int32]
    msgid: NDArray[np.int32]
    message: NDArray[np.int16]
    kind: NDArray[np.uint8]
    consumed: int
    bad_crc: int

    def __len__(self) -> int:
        return int(self.offset.size)

    @cached_property
    def raw(self) -> int:
        """Consumed bytes that belong to no frame."""
        return self.consumed - int(self.length.sum(dtype=np.int64))

    @cached_property
    def unknown(self) -> int:
        """Number of frames whose id the dialect does not know."""
        return int(np.count_nonzero(self.kind == UNKNOWN))

    @cached_property
    def magic(self) -> Bytes:
        """(N,) 0xFE or 0xFD."""
        return self.buffer[self.offset]

    @cached_property
    def is_v2(self) -> NDArray[np.bool_]:
        """(N,) whether the frame is MAVLink 2."""
        magic: NDArray[np.uint8] = self.magic
        return np.equal(magic, MAGIC_V2)

    @cached_property
    def incompat(self) -> Bytes:
        """(N,) incompatibility flags, 0 for MAVLink 1."""
        return np.where(self.is_v2, self.buffer[self.offset + 2], 0).astype(np.uint8)

    @cached_property
    def seq(self) -> Bytes:
        """(N,) the sender's counter."""
        return self.buffer[self.offset + np.where(self.is_v2, 4, 2)]

    @cached_property
    def sysid(self) -> Bytes:
        """(N,) system."""
        return self.buffer[self.offset + np.where(self.is_v2, 5, 3)]

    @cached_property
    def systems(self) -> tuple[int, ...]:
        """Every system that sent one of the frames, ascending."""
        return tuple(sorted(set(self.sysid.tobytes())))

    @cached_property
    def compid(self) -> Bytes:
        """(N,) component."""
        return self.buffer[self.offset + np.where(self.is_v2, 6, 4)]

    @cached_property
    def payload_offset(self) -> NDArray[np.int64]:
        """(N,) where the payload begins."""
        return self.offset + np.where(self.is_v2, 10, 6)

    @cached_property
    def payload_length(self) -> Bytes:
        """(N,) payload bytes as sent (MAVLink 2 cuts trailing zeros)."""
        return self.buffer[self.offset + 1]

    def frame(self, i: int) -> bytes:
        """The bytes of frame i."""
        start = int(self.offset[i])
        return self.buffer[start : start + int(self.length[i])].tobytes()


@jit
def message_id(buffer: Bytes, p: Int) -> Int:
    """Message id of the frame at p."""
    if buffer[p] == MAGIC_V1:
        return np.int64(buffer[p + 5])
    return np.int64(buffer[p + 7]) | np.int64(buffer[p + 8]) << 8 | np.int64(buffer[p + 9]) << 16


@jit
def frame_at(
    buffer: Bytes,
    p: Int,
    stop: Int,
    index: NDArray[np.int16],
    table: NDArray[np.int64],
    crc_tables: NDArray[np.uint16],
    seeds: NDArray[np.int16],
) -> Int:
    """Length of the frame at p; +UNKNOWN_ID for a plausible one of unknown id; else _NOISE, _UNFINISHED or _BAD_CRC.

    stop: end of the valid bytes of `buffer`. Reads nothing behind it.
    """
    magic = buffer[p]
    if magic == MAGIC_V2:
        header = 10
        if p + 3 <= stop and buffer[p + 2] > SIGNED:
            return _NOISE
    elif magic == MAGIC_V1:
        header = 6
    else:
        return _NOISE
    if p + header + 2 > stop:
        return _UNFINISHED
    checked = p + header + np.int64(buffer[p + 1])
    end = checked + 2
    if magic == MAGIC_V2 and buffer[p + 2] == SIGNED:
        end += SIGNATURE_LENGTH
    if end > stop:
        return _UNFINISHED
    identity = message_id(buffer, p)
    row = np.int64(index[identity]) if identity < index.size else -1
    crc = crc_accumulate(buffer, p + 1, checked, 0xFFFF, crc_tables)
    sent = np.int64(buffer[checked]) | np.int64(buffer[checked + 1]) << 8
    if row >= 0:
        if crc_step(crc, table[row, CRC_EXTRA], crc_tables) == sent:
            return end - p
        return _BAD_CRC if buffer[p + 1] <= table[row, WIRE_SIZE] else _NOISE
    if seeds[sent ^ (crc >> 8)] >= 0:
        return end - p + UNKNOWN_ID
    return _NOISE


@jit
def hides_frame(
    buffer: Bytes,
    start: Int,
    end: Int,
    stop: Int,
    final: bool,
    index: NDArray[np.int16],
    table: NDArray[np.int64],
    crc_tables: NDArray[np.uint16],
    seeds: NDArray[np.int16],
) -> Int:
    """1 if a frame of known id begins in buffer[start:end], 0 if none does, -1 if more bytes are needed to decide."""
    for q in range(start, end):
        if buffer[q] == MAGIC_V1 or buffer[q] == MAGIC_V2:
            found = frame_at(buffer, q, stop, index, table, crc_tables, seeds)
            if 0 < found < UNKNOWN_ID:
                return 1
            if found == _UNFINISHED and not final:
                return -1
    return 0


@jit
def take_frame(
    buffer: Bytes,
    p: Int,
    stop: Int,
    final: bool,
    index: NDArray[np.int16],
    table: NDArray[np.int64],
    crc_tables: NDArray[np.uint16],
    seeds: NDArray[np.int16],
) -> Int:
    """As frame_at, but a frame of unknown id only where it hides no good one; _UNFINISHED only while more may come."""
    found = frame_at(buffer, p, stop, index, table, crc_tables, seeds)
    if found >= UNKNOWN_ID:
        hidden = hides_frame(buffer, p + 1, p + found - UNKNOWN_ID, stop, final, index, table, crc_tables, seeds)
        if hidden != 0:
            found = _UNFINISHED if hidden < 0 else _NOISE
    return _NOISE if found == _UNFINISHED and final else found


@jit
def note_frame(
    buffer: Bytes,
    p: Int,
    found: Int,
    n: int,
    index: NDArray[np.int16],
    offset: NDArray[np.int64],
    length: NDArray[np.int32],
    msgid: NDArray[np.int32],
    message: NDArray[np.int16],
    kind: Bytes,
) -> Int:
    """Enter the frame at p, for which take_frame gave `found`, as number n; its length."""
    identity = message_id(buffer, p)
    offset[n] = p
    msgid[n] = identity
    if found >= UNKNOWN_ID:
        message[n] = -1
        kind[n] = UNKNOWN
        found -= UNKNOWN_ID
    else:
        message[n] = index[identity]
        kind[n] = KNOWN_SIGNED if buffer[p] == MAGIC_V2 and buffer[p + 2] == SIGNED else KNOWN
    length[n] = found
    return found


@jit
def _scan(
    buffer: Bytes,
    final: bool,
    gap: int,
    index: NDArray[np.int16],
    table: NDArray[np.int64],
    crc_tables: NDArray[np.uint16],
    seeds: NDArray[np.int16],
    offset: NDArray[np.int64],
    length: NDArray[np.int32],
    msgid: NDArray[np.int32],
    message: NDArray[np.int16],
    kind: Bytes,
) -> tuple[int, Int, int]:
    """Fill the frame arrays; (frames, bytes consumed, candidates with a wrong checksum).

    Where a good frame stands `gap` bytes behind the last one, it is taken without looking into the gap.
    """
    size = buffer.size
    p: Int = 0
    last_end: Int = 0
    n = 0
    bad = 0
    while p < size:
        # The usual case on its own, a good unsigned MAVLink 2 frame well inside the buffer: 9 times as fast. It is
        # spelt out because the compiler does not put a function with so many arrays into its caller.
        at = p + gap if p == last_end else p
        while at + LARGEST_FRAME <= size and buffer[at] == MAGIC_V2 and buffer[at + 2] == 0:
            checked = at + 10 + np.int64(buffer[at + 1])
            identity = np.int64(buffer[at + 7]) | np.int64(buffer[at + 8]) << 8 | np.int64(buffer[at + 9]) << 16
            row = np.int64(index[identity]) if identity < index.size else np.int64(-1)
            if row < 0:
                break
            crc = crc_step(
                crc_accumulate(buffer, at + 1, checked, 0xFFFF, crc_tables), table[row, CRC_EXTRA], crc_tables
            )
            if crc != np.int64(buffer[checked]) | np.int64(buffer[checked + 1]) << 8:
                break
            offset[n] = at
            length[n] = checked + 2 - at
            msgid[n] = identity
            message[n] = row
            kind[n] = KNOWN
            n += 1
            p = last_end = checked + 2
            at = p + gap
        found: Int = 0
        if p < at < size:
            found = take_frame(buffer, at, size, final, index, table, crc_tables, seeds)
        if (found <= 0 and found != _UNFINISHED) or found >= UNKNOWN_ID:
            at = p
            found = 0
        if at == p and p < size and (buffer[p] == MAGIC_V2 or buffer[p] == MAGIC_V1):
            found = take_frame(buffer, p, size, final, index, table, crc_tables, seeds)
        if found == _UNFINISHED:
            break
        if found > 0:
            p = last_end = at + note_frame(buffer, at, found, n, index, offset, length, msgid, message, kind)
            n += 1
        elif p < size:
            bad += found == _BAD_CRC
            p += 1
    # What stands in a gap whose frame is not here yet belongs to the next buffer.
    return n, p if final else max(last_end, p - gap), bad


def _arrays_for(size: int) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int32], NDArray[np.int16], Bytes]:
    """Room for as many frames as `size` bytes can hold."""
    room = size // SMALLEST_FRAME + 1
    return (
        np.empty(room, np.int64),
        np.empty(room, np.int32),
        np.empty(room, np.int32),
        np.empty(room, np.int16),
        np.empty(room, np.uint8),
    )


def scan(buffer: Bytes, dialect: Dialect, final: bool = False, gap: int = 0) -> Frames:
    """All frames in a contiguous uint8 buffer.

    final: no more bytes will follow, so an unfinished candidate is noise; otherwise the scan stops in front of it
    and `Frames.consumed` says where. gap: bytes expected in front of each frame (8 in a .tlog); they count as noise.
    """
    offset, length, msgid, message, kind = _arrays_for(buffer.size)
    count, consumed, bad = _scan(
        buffer,
        final,
        gap,
        dialect.index,
        dialect.table,
        CRC_TABLES,
        SEED_FINDER,
        offset,
        length,
        msgid,
        message,
        kind,
    )
    return Frames(
        buffer, offset[:count], length[:count], msgid[:count], message[:count], kind[:count], int(consumed), bad
    )


class Framer:
    """Framing of one link, whose bytes come in pieces: keeps the unfinished end for the next piece."""

    def __init__(self, dialect: Dialect) -> None:
        self._dialect = dialect
        self._tail = b""

    @property
    def pending(self) -> int:
        """Bytes held back because a frame may be unfinished."""
        return len(self._tail)

    def feed(self, data: bytes, final: bool = False) -> tuple[Bytes, Frames]:
        """The bytes now accounted for (uint8, held-back ones first) and the frames in them.

        final: nothing follows what is given here (the link is closed or idle), so hold nothing back.
        """
        everything = np.frombuffer(self._tail + data, np.uint8)
        frames = scan(everything, self._dialect, final)
        self._tail = everything[frames.consumed :].tobytes()
        return everything[: frames.consumed], frames

    def flush(self) -> tuple[Bytes, Frames]:
        """What is held back, taken as it is: frames that noise in front of them had hidden, and noise."""
        return self.feed(b"", final=True)
