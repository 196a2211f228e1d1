"""Frames to columns: the fields of all messages of one type as a numpy structured array, no Python per message."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink.dialect import CDR_SIZE, Dialect
from gcs.mavlink.framing import MAGIC_V2, Frames
from gcs.mavlink.payload import copy_payload
from sim_vehicle.jit import jit

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

# The compiled copy works in steps of eight bytes and may write that far behind a message's last body.
_MARGIN = 8


@dataclass(frozen=True)
class FrameColumns:
    """All N messages of one type in a batch of frames.

    index: (N,) their places among the frames, ascending. fields: (N,) structured, names in lower case and units as in
    the dialect, fields that were not sent 0.
    """

    name: str
    index: Ints
    fields: NDArray[Any]

    def __len__(self) -> int:
        return int(self.index.size)


@jit
def _count(message: NDArray[np.int16], counts: Ints) -> None:
    for i in range(message.size):
        if message[i] >= 0:
            counts[message[i]] += 1


@jit
def _gather(
    buffer: Bytes,
    offset: Ints,
    message: NDArray[np.int16],
    table: Ints,
    next_index: Ints,
    next_body: Ints,
    index: Ints,
    bodies: Bytes,
) -> None:
    """Sort the frames by message and copy their payloads, zero-extended and padded, behind one another."""
    for i in range(offset.size):
        m = np.int64(message[i])
        if m < 0:
            continue
        at = offset[i]
        header = 10 if buffer[at] == MAGIC_V2 else 6
        copy_payload(buffer, at + header, np.int64(buffer[at + 1]), table, m, bodies, next_body[m])
        next_body[m] += table[m, CDR_SIZE]
        index[next_index[m]] = i
        next_index[m] += 1


def message_columns(frames: Frames, dialect: Dialect) -> dict[str, FrameColumns]:
    """The columns of every message type among the frames, by name; frames of unknown id are in none."""
    counts = np.zeros(len(dialect.messages), np.int64)
    _count(frames.message, counts)
    first_index = np.cumsum(counts) - counts
    sizes = counts * dialect.table[:, CDR_SIZE] + _MARGIN
    first_body = np.cumsum(sizes) - sizes
    index = np.empty(int(counts.sum()), np.int64)
    bodies = np.empty(int(sizes.sum()), np.uint8)
    _gather(
        frames.buffer,
        frames.offset,
        frames.message,
        dialect.table,
        first_index.copy(),
        first_body.copy(),
        index,
        bodies,
    )
    columns: dict[str, FrameColumns] = {}
    for m in np.flatnonzero(counts).tolist():
        message, start, body = dialect.messages[m], int(first_index[m]), int(first_body[m])
        count = int(counts[m])
        fields = bodies[body : body + count * message.layout.cdr_size].view(message.layout.dtype)
        columns[message.name] = FrameColumns(message.name, index[start : start + count], fields)
    return columns
