"""Compiled loops over bytes: little-endian numbers, and payloads placed as CDR bodies without decoding them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink.crc import Int
from gcs.mavlink.dialect import CDR_SIZE, RUN_COUNT, RUNS, WIRE_SIZE
from sim_vehicle.jit import jit

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


@jit
def put(out: Bytes, at: Int, value: Int, size: Int) -> None:
    """Write `size` bytes of an integer, little-endian."""
    for k in range(size):
        out[at + k] = np.uint8((value >> (8 * k)) & 0xFF)


@jit
def put_8(out: Bytes, at: Int, value: Int) -> None:
    """Write 8 bytes, little-endian; spelt out, so that the compiler makes one store of it."""
    out[at] = np.uint8(value)
    out[at + 1] = np.uint8(value >> 8)
    out[at + 2] = np.uint8(value >> 16)
    out[at + 3] = np.uint8(value >> 24)
    out[at + 4] = np.uint8(value >> 32)
    out[at + 5] = np.uint8(value >> 40)
    out[at + 6] = np.uint8(value >> 48)
    out[at + 7] = np.uint8(value >> 56)


@jit
def get(buffer: Bytes, at: Int, size: Int) -> Int:
    """Read `size` bytes as a little-endian integer (8 bytes: signed)."""
    value = np.int64(0)
    for k in range(size):
        value |= np.int64(buffer[at + k]) << (8 * k)
    return value


@jit
def get_4(buffer: Bytes, at: Int) -> Int:
    """Read 4 bytes, little-endian; spelt out, so that the compiler makes one load of it."""
    return (
        np.int64(buffer[at])
        | np.int64(buffer[at + 1]) << 8
        | np.int64(buffer[at + 2]) << 16
        | np.int64(buffer[at + 3]) << 24
    )


@jit
def copy_8(source: Bytes, start: Int, out: Bytes, at: Int) -> None:
    """Copy 8 bytes; all are read before the first is written, so that one load and one store do it."""
    a, b, c, d = source[start], source[start + 1], source[start + 2], source[start + 3]
    e, f, g, h = source[start + 4], source[start + 5], source[start + 6], source[start + 7]
    out[at], out[at + 1], out[at + 2], out[at + 3] = a, b, c, d
    out[at + 4], out[at + 5], out[at + 6], out[at + 7] = e, f, g, h


@jit
def copy_payload(buffer: Bytes, start: Int, sent: Int, table: Ints, m: Int, out: Bytes, body: Int) -> None:
    """Place a payload of `sent` bytes, zero-extended, as CDR body at out[body:]."""
    if table[m, RUN_COUNT] == 1:
        size = min(sent, table[m, WIRE_SIZE])
        k = 0
        if start + size + 8 <= buffer.size and body + size + 8 <= out.size:
            while k < size:
                copy_8(buffer, start + k, out, body + k)
                k += 8
            k = size
        while k < size:
            out[body + k] = buffer[start + k]
            k += 1
        while k < table[m, CDR_SIZE]:
            out[body + k] = 0
            k += 1
        return
    for k in range(table[m, CDR_SIZE]):
        out[body + k] = 0
    for run in range(table[m, RUN_COUNT]):
        wire, cdr, length = table[m, RUNS + 3 * run], table[m, RUNS + 3 * run + 1], table[m, RUNS + 3 * run + 2]
        for k in range(min(length, sent - wire)):
            out[body + cdr + k] = buffer[start + wire + k]
