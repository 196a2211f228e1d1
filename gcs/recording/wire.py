"""The topic /mavlink/wire: what the CDR messages do not hold of the byte stream that each link received.

One message per link and chunk, written behind the link's CDR messages of that chunk, in the order the bytes came:

- `first_byte`: bytes of this link before this message, so that a reader notices a missing chunk.
- `start_ns`: log time of the chunk's first bytes; `run_time` counts from it, in ns.
- `form`: one entry per CDR message of this link in this chunk, in file order. 0: a MAVLink 2 frame without flags,
  its payload cut behind its last byte that is not zero (at least one byte stays). 1: a MAVLink 1 frame of the
  base length. 2: a frame in any other form, described by a run of kind 2.
- `run_frame`, `run_kind`, `run_length`, `run_time`, and `run_bytes` behind one another: runs of bytes.
  Kind 0: noise in front of frame `run_frame`. Kind 1: one frame of an id that the dialect does not know, in front
  of frame `run_frame`. Kind 2, for frame `run_frame` itself: magic, payload length sent, incompatibility and
  compatibility flags, then payload bytes beyond the length the dialect knows, then the signature if there is one.

Everything else of a frame follows from its channel (link, system, component, message id, CRC_EXTRA, base length,
definition), its sequence (low byte) and its data; the checksum was right, so it is computed again.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink.cdr import CDR_HEADER

WIRE_TOPIC = "/mavlink/wire"
WIRE_SCHEMA_NAME = "mavlink/msg/Wire"
WIRE_SCHEMA = """\
uint64 first_byte
uint64 start_ns
uint8[] form
uint32[] run_frame
uint32[] run_length
uint32[] run_time
uint8[] run_kind
uint8[] run_bytes
"""

Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class WireRecord:
    """One decoded message of the topic; the run arrays have one entry per run."""

    first_byte: int
    start_ns: int
    form: Bytes
    run_frame: NDArray[np.int64]
    run_length: NDArray[np.int64]
    run_time: NDArray[np.int64]
    run_kind: NDArray[np.int64]
    run_bytes: Bytes


def encode_wire(first_byte: int, start_ns: int, form: Bytes, runs: NDArray[np.int64], run_bytes: Bytes) -> bytes:
    """CDR message of the topic. runs: (N, 4) frame, kind, length, time."""
    body = bytearray(struct.pack("<QQ", first_byte, start_ns))
    _append_sequence(body, form)
    for column in (0, 2, 3):
        _append_sequence(body, np.ascontiguousarray(runs[:, column], np.uint32))
    _append_sequence(body, np.ascontiguousarray(runs[:, 1], np.uint8))
    _append_sequence(body, run_bytes)
    return CDR_HEADER + bytes(body)


def _append_sequence(body: bytearray, values: NDArray[Any]) -> None:
    body += bytes(-len(body) % 4)
    body += struct.pack("<I", values.size)
    body += values.tobytes()


def decode_wire(data: bytes) -> WireRecord:
    """The record of one CDR message of the topic; ValueError if its lengths do not fit its bytes."""
    body = memoryview(data)[len(CDR_HEADER) :]
    if len(body) < 16:
        raise ValueError("wire message is too short")
    first_byte, start_ns = struct.unpack_from("<QQ", body)
    at = 16
    columns: list[NDArray[Any]] = []
    for kind in (np.uint8, np.uint32, np.uint32, np.uint32, np.uint8, np.uint8):
        at += -at % 4
        if at + 4 > len(body):
            raise ValueError("wire message is too short")
        (count,) = struct.unpack_from("<I", body, at)
        columns.append(np.frombuffer(body, kind, count, at + 4))
        at += 4 + columns[-1].nbytes
    form, frame, length, time, run_kind, run_bytes = columns
    counts = {frame.size, length.size, time.size, run_kind.size}
    if len(counts) != 1 or int(length.sum(dtype=np.int64)) != run_bytes.size or start_ns >> 63:
        raise ValueError("the runs of a wire message do not fit its bytes")
    as_int = [column.astype(np.int64) for column in (frame, length, time, run_kind)]
    return WireRecord(first_byte, start_ns, form, as_int[0], as_int[1], as_int[2], as_int[3], run_bytes)
