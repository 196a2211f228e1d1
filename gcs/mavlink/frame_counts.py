"""One compiled pass over a batch of frames: who sent how many, how many are missing, and which need a closer look."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink.crc import Int
from gcs.mavlink.framing import MAGIC_V2, SIGNED, UNKNOWN, Frames
from gcs.mavlink.sequence import DUPLICATE, LATE, NEW, NEWEST, number_of, sequence_states
from sim_vehicle.jit import jit

RADIO_STATUS, RADIO = 109, 166

# Columns of the table of senders.
_SENDER, RECEIVED, LOST, DUPLICATES = range(4)
_COLUMNS = 4
# What one pass adds up.
_BYTES, _UNKNOWN, _SIGNED, _OTHERS, _RADIO, _NEXT = range(6)
#: Senders that are accounted for one by one; a source that names more is a fault, or wants to fill the memory.
MOST_SENDERS = 256

Ints = NDArray[np.int64]


@jit
def _count_frame(row: Ints, state: Ints, sequence: Int) -> None:
    before = state[NEWEST]
    number, found = number_of(state, sequence)
    if found == DUPLICATE:
        row[DUPLICATES] += 1
    else:
        row[RECEIVED] += 1
    if found == LATE:
        row[LOST] -= 1
    elif found == NEW and before >= 0:
        row[LOST] += number - before - 1


@jit
def _pass(
    buffer: NDArray[np.uint8],
    offset: Ints,
    length: NDArray[np.int32],
    msgid: NDArray[np.int32],
    kind: NDArray[np.uint8],
    row_of: NDArray[np.int32],
    rows: Ints,
    states: Ints,
    count: int,
    start: int,
    sums: Ints,
) -> int:
    """Take frames from `start` on into `rows`; the number of rows in use.

    row_of: (65536,) row + 1 of a sender (system << 8 | component), 0 where there is none yet. states: of the senders'
    counters, one for each row. sums[_OTHERS]: frames of senders beyond MOST_SENDERS. sums[_NEXT]: the frame that there
    was no row for, or the number of frames.
    """
    for i in range(start, offset.size):
        at = offset[i]
        first = at + (4 if buffer[at] == MAGIC_V2 else 2)
        sequence = np.int64(buffer[first])
        sender = np.int64(buffer[first + 1]) << 8 | np.int64(buffer[first + 2])
        row = row_of[sender] - 1
        if row < 0 and count < MOST_SENDERS:
            if count == rows.shape[0]:
                sums[_NEXT] = i
                return count
            row = count
            count += 1
            row_of[sender] = row + 1
            rows[row, _SENDER] = sender
        if row < 0:
            sums[_OTHERS] += 1
        else:
            _count_frame(rows[row], states[row], sequence)
        sums[_BYTES] += length[i]
        if buffer[at] == MAGIC_V2 and buffer[at + 2] == SIGNED:
            sums[_SIGNED] += 1
        if kind[i] == UNKNOWN:
            sums[_UNKNOWN] += 1
        elif msgid[i] == RADIO_STATUS or msgid[i] == RADIO:
            sums[_RADIO] = i
    sums[_NEXT] = offset.size
    return count


class SenderAccount:
    """Frames received, missing and doubled of every sender of one source, by the counter in the frames.

    A frame that comes a second time is a duplicate; one that is delayed fills the gap that was counted for it.
    Of the last batch, bytes: in frames; unknown, signed, others: frames of unknown id, with a signature, of senders
    beyond MOST_SENDERS; radio: index of the last radio report, -1 if there is none.
    """

    def __init__(self) -> None:
        self._row_of = np.zeros(1 << 16, np.int32)
        self._rows = np.zeros((16, _COLUMNS), np.int64)
        self._states = sequence_states(16)
        self._count = 0
        self._sums = np.zeros(_NEXT + 1, np.int64)
        self.bytes = self.unknown = self.signed = self.others = 0
        self.radio = -1

    def add(self, frames: Frames) -> None:
        """Take in one batch."""
        sums = self._sums
        sums[:] = 0
        sums[_RADIO] = -1
        while sums[_NEXT] < len(frames):
            self._count = _pass(
                frames.buffer,
                frames.offset,
                frames.length,
                frames.msgid,
                frames.kind,
                self._row_of,
                self._rows,
                self._states,
                self._count,
                int(sums[_NEXT]),
                sums,
            )
            if self._count == self._rows.shape[0] < MOST_SENDERS:
                self._rows = np.concatenate((self._rows, np.zeros_like(self._rows)))
                self._states = np.concatenate((self._states, sequence_states(self._count)))
        self.bytes, self.unknown, self.signed, self.others, self.radio = sums[:_NEXT].tolist()

    def senders(self) -> list[tuple[int, int, dict[str, int]]]:
        """(system, component, counts) of all, sorted."""
        found = []
        for row in self._rows[: self._count].tolist():
            counts = {"received": row[RECEIVED], "lost": row[LOST], "duplicates": row[DUPLICATES]}
            found.append((row[_SENDER] >> 8, row[_SENDER] & 0xFF, counts))
        return sorted(found, key=lambda entry: entry[:2])
