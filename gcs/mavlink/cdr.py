"""Where the fields of a message lie: on the MAVLink wire, and in a ROS 2 CDR message.

MAVLink sorts fields by size and packs them; CDR (OMG DDS-XTypes 1.3, 7.4.1, plain XCDR1) aligns each field to its
own size, counted from behind the 4-byte encapsulation header. Base fields therefore lie at the same place in
both; only some extension fields need padding. A `Layout` holds both places and the few runs of bytes
to copy from one to the other.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs.errors import RecordingError

#: Encapsulation header of little-endian plain CDR.
CDR_HEADER = bytes((0, 1, 0, 0))

#: ROS 2 primitive type -> numpy type.
NUMPY_TYPES = {
    "uint8": "<u1",
    "int8": "<i1",
    "uint16": "<u2",
    "int16": "<i2",
    "uint32": "<u4",
    "int32": "<i4",
    "uint64": "<u8",
    "int64": "<i8",
    "float32": "<f4",
    "float64": "<f8",
}

_FIELD_LINE = re.compile(r"^\s*([a-z0-9]+)(?:\[(\d+)\])?\s+([A-Za-z]\w*)\s*(?:#.*)?$")


@dataclass(frozen=True)
class Field:
    """One field: `count` is 0 for a scalar, N for an array of N; offsets in bytes, the CDR one behind the header."""

    name: str
    type: str
    count: int
    wire_offset: int
    cdr_offset: int


@dataclass(frozen=True)
class Layout:
    """All fields of a message in the order of the wire.

    wire_size: bytes of the complete payload. cdr_size: bytes of the CDR body behind the 4-byte header.
    runs: (wire offset, CDR offset, length) of the pieces that are copied as they are.
    """

    fields: tuple[Field, ...]
    wire_size: int
    cdr_size: int
    runs: tuple[tuple[int, int, int], ...]

    @property
    def dtype(self) -> np.dtype[Any]:
        """Structured type of one CDR body, so that columns are views of copied bytes."""
        formats = [NUMPY_TYPES[f.type] if f.count == 0 else (NUMPY_TYPES[f.type], (f.count,)) for f in self.fields]
        return np.dtype(
            {
                "names": [f.name for f in self.fields],
                "formats": formats,
                "offsets": [f.cdr_offset for f in self.fields],
                "itemsize": self.cdr_size,
            }
        )

    @property
    def ros2msg(self) -> str:
        """Text of the ROS 2 message definition."""
        return "".join(f"{f.type}{f'[{f.count}]' if f.count else ''} {f.name}\n" for f in self.fields)

    def field(self, name: str) -> Field:
        """The field of that name; KeyError where there is none."""
        for candidate in self.fields:
            if candidate.name == name:
                return candidate
        raise KeyError(name)


def layout(fields: Iterable[tuple[str, str, int]]) -> Layout:
    """Place (name, ROS 2 type, count) fields, given in the order of the wire, on the wire and in CDR."""
    placed: list[Field] = []
    runs: list[tuple[int, int, int]] = []
    wire = cdr = 0
    for name, kind, count in fields:
        size = np.dtype(NUMPY_TYPES[kind]).itemsize
        cdr += -cdr % size
        placed.append(Field(name, kind, count, wire, cdr))
        length = size * max(count, 1)
        if runs and runs[-1][1] - runs[-1][0] == cdr - wire:
            runs[-1] = (runs[-1][0], runs[-1][1], runs[-1][2] + length)
        else:
            runs.append((wire, cdr, length))
        wire += length
        cdr += length
    return Layout(tuple(placed), wire, cdr, tuple(runs))


def parse_ros2msg(text: str) -> Layout:
    """Layout of a ROS 2 definition made of fixed-size fields; RecordingError for any other."""
    fields: list[tuple[str, str, int]] = []
    for line in text.splitlines():
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        match = _FIELD_LINE.match(line)
        if match is None or match[1] not in NUMPY_TYPES:
            raise RecordingError(
                f"message definition holds {line.strip()!r}, which is no fixed-size field of a MAVLink message"
            )
        fields.append((match[3], match[1], int(match[2] or 0)))
    return layout(fields)
