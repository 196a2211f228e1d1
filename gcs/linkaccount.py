"""One compiled pass over a batch of frames: who sent how many, how many are missing, and which need a closer look."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.framing import MAGIC_V2, SIGNED, UNKNOWN, Frames
from sim_vehicle.jit import jit

RADIO_STATUS, RADIO = 109, 166

# Columns of the table of senders.
_SENDER, _LAST, _SEEN, RECEIVED, LOST, DUPLICATES = range(6)
_COLUMNS = 6
# What one pass adds up.
_BYTES, _UNKNOWN, _SIGNED, _RADIO, _NEXT = range(5)
# A frame may come this many places late, or a second time, and is known for that.
_WINDOW = 63

Ints = NDArray[np.int64]


@jit
def _pass(
    buffer: NDArray[np.uint8],
    offset: Ints,
    length: NDArray[np.int32],
    msgid: NDArray[np.int32],
    kind: NDArray[np.uint8],
    row_of: NDArray[np.int32],
    rows: Ints,
    count: int,
    start: int,
    sums: Ints,
) -> int:
    """Take frames from `start` on into `rows`; the number of rows in use.

    row_of: (65536,) row + 1 of a sender (system << 8 | component), 0 where there is none yet. sums[_NEXT]: the frame
    that there was no row for, or the number of frames.
    """
    for i in range(start, offset.size):
        at = offset[i]
        first = at + (4 if buffer[at] == MAGIC_V2 else 2)
        sequence = np.int64(buffer[first])
        sender = np.int64(buffer[first + 1]) << 8 | np.int64(buffer[first + 2])
        row = row_of[sender] - 1
        if row < 0:
            if count == rows.shape[0]:
                sums[_NEXT] = i
                return count
            row = count
            count += 1
            row_of[sender] = row + 1
            rows[row, _SENDER] = sender
            rows[row, _LAST] = sequence
            rows[row, _SEEN] = -1
            rows[row, RECEIVED] = 1
        else:
            step = (sequence - rows[row, _LAST]) & 0xFF
            late = 256 - step
            if step == 0:
                rows[row, DUPLICATES] += 1
            elif late <= _WINDOW:
                if (rows[row, _SEEN] >> late) & 1:
                    rows[row, DUPLICATES] += 1
                else:
                    rows[row, _SEEN] |= np.int64(1) << late
                    rows[row, RECEIVED] += 1
                    rows[row, LOST] -= 1
            else:
                rows[row, _SEEN] = (rows[row, _SEEN] << step | 1) if step <= _WINDOW else 1
                rows[row, RECEIVED] += 1
                rows[row, LOST] += step - 1
                rows[row, _LAST] = sequence
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

    A frame that comes a second time is a duplicate; one that comes late fills the gap that was counted for it.
    Of the last batch, bytes: in frames; unknown, signed: frames of unknown id, frames with a signature; radio: index of
    the last radio report, -1 if there is none.
    """

    def __init__(self) -> None:
        self._row_of = np.zeros(1 << 16, np.int32)
        self._rows = np.zeros((16, _COLUMNS), np.int64)
        self._count = 0
        self._sums = np.zeros(5, np.int64)
        self.bytes = self.unknown = self.signed = 0
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
                self._count,
                int(sums[_NEXT]),
                sums,
            )
            if self._count == self._rows.shape[0]:
                self._rows = np.concatenate((self._rows, np.zeros_like(self._rows)))
        self.bytes, self.unknown, self.signed, self.radio = sums[:_NEXT].tolist()

    def senders(self) -> list[tuple[int, int, dict[str, int]]]:
        """(system, component, counts) of all, sorted."""
        found = []
        for row in self._rows[: self._count].tolist():
            counts = {"received": row[RECEIVED], "lost": row[LOST], "duplicates": row[DUPLICATES]}
            found.append((row[_SENDER] >> 8, row[_SENDER] & 0xFF, counts))
        return sorted(found, key=lambda entry: entry[:2])
