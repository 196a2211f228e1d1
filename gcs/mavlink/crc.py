"""The checksum of MAVLink: CRC-16/MCRF4XX (reflected polynomial 0x8408, start 0xFFFF, no final inversion).

Eight bytes at a time by "slicing" (Kounavis and Berry, "A systematic approach to building high performance
software-based CRC generators", 2005): table k holds the checksum of a byte that k zero bytes follow.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit

POLYNOMIAL = 0x8408

Int = int | np.signedinteger[Any]  # compiled code makes no difference


def _slicing_tables() -> NDArray[np.uint16]:
    tables = np.zeros((8, 256), np.uint16)
    for byte in range(256):
        value = byte
        for _ in range(8):
            value = (value >> 1) ^ POLYNOMIAL if value & 1 else value >> 1
        tables[0, byte] = value
    for k in range(1, 8):
        previous = tables[k - 1]
        tables[k] = (previous >> 8) ^ tables[0, previous & 0xFF]
    return tables.reshape(-1)


def _seed_finder(table: NDArray[np.uint16]) -> NDArray[np.int16]:
    """(65536,) for each value of the last step's table its index, or -1 where no byte gives it."""
    finder = np.full(65536, -1, np.int16)
    finder[table[:256]] = np.arange(256)
    return finder


#: (2048,) slicing tables 0 to 7 behind one another.
CRC_TABLES = _slicing_tables()

#: (65536,) inverse of table 0: the byte whose last step leads to a value, or -1.
SEED_FINDER = _seed_finder(CRC_TABLES)


@jit
def crc_accumulate(buffer: NDArray[np.uint8], start: Int, stop: Int, value: Int, tables: NDArray[np.uint16]) -> Int:
    """Checksum `value` continued over buffer[start:stop]."""
    # 32-bit unsigned throughout: no sign extension and no negative indexes to check.
    crc = np.uint32(value)
    p = start
    while p + 8 <= stop:
        crc = (
            np.uint32(tables[np.uint32(1792) + (np.uint32(buffer[p]) ^ (crc & np.uint32(0xFF)))])
            ^ np.uint32(tables[np.uint32(1536) + (np.uint32(buffer[p + 1]) ^ (crc >> np.uint32(8)))])
            ^ np.uint32(tables[np.uint32(1280) + np.uint32(buffer[p + 2])])
            ^ np.uint32(tables[np.uint32(1024) + np.uint32(buffer[p + 3])])
            ^ np.uint32(tables[np.uint32(768) + np.uint32(buffer[p + 4])])
            ^ np.uint32(tables[np.uint32(512) + np.uint32(buffer[p + 5])])
            ^ np.uint32(tables[np.uint32(256) + np.uint32(buffer[p + 6])])
            ^ np.uint32(tables[np.uint32(buffer[p + 7])])
        )
        p += 8
    while p < stop:
        crc = (crc >> np.uint32(8)) ^ np.uint32(tables[(crc ^ np.uint32(buffer[p])) & np.uint32(0xFF)])
        p += 1
    return np.int64(crc)


@jit
def crc_step(value: Int, byte: Int, tables: NDArray[np.uint16]) -> Int:
    """Checksum `value` continued over one byte (MAVLink's CRC_EXTRA)."""
    return (np.int64(value) >> 8) ^ np.int64(tables[(np.int64(value) ^ np.int64(byte)) & 0xFF])


def crc_of(data: bytes, value: int = 0xFFFF) -> int:
    """Checksum of `data` in plain Python, for the few bytes that are not worth compiling for."""
    for byte in data:
        value = (value >> 8) ^ _TABLE[(value ^ byte) & 0xFF]
    return value


_TABLE: list[int] = CRC_TABLES[:256].tolist()
