"""ArduPilot's onboard logs as text (.log, .txt): what Mission Planner, MAVProxy and old boards write of a .bin.

A line is a message: its name and the fields that the FMT line of that name lists, already in their units.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_FMT = "FMT"
# Letters of fields that are words; of whole numbers, which a time must be.
_WORDS = {"n": "S4", "N": "S16", "Z": "S64"}
_WHOLE = frozenset("bBhHiIqQM")
_LOOKED_AT = 4096


def is_text(data: NDArray[np.uint8]) -> bool:
    """Whether the bytes of a log are such lines. data: (N,), its beginning at least."""
    head = data[:_LOOKED_AT].tobytes()
    return b"\0" not in head and any(line.replace(b" ", b"").startswith(b"FMT,") for line in head.splitlines()[:50])


def read_lines(data: NDArray[np.uint8]) -> tuple[dict[str, tuple[NDArray[Any], NDArray[np.int64]]], int]:
    """Name -> (N,) structured messages and the (N,) lines that they stand in; and how many bytes are in no message.

    data: (M,) bytes of the log.
    """
    formats: dict[str, tuple[str, list[str]]] = {}
    rows: dict[str, list[list[str]]] = {}
    places: dict[str, list[int]] = {}
    skipped = 0
    for number, line in enumerate(data.tobytes().decode("utf-8", "replace").splitlines()):
        name, _, rest = line.partition(",")
        name = name.strip()
        if name == _FMT:
            fields = [one.strip() for one in rest.split(",", 4)]
            if len(fields) == 5:
                columns = [one.strip() for one in fields[4].split(",") if one.strip()]
                if len(columns) == len(fields[3]) == len(set(columns)):
                    formats.setdefault(fields[2], (fields[3], columns))
                    continue
        if name not in formats or not rest:
            skipped += len(line) + 1 if line.strip() else 0
            continue
        letters, columns = formats[name]
        # The last field may be a text with commas in it.
        cells = rest.split(",", len(columns) - 1)
        if len(cells) != len(columns):
            skipped += len(line) + 1
            continue
        rows.setdefault(name, []).append(cells)
        places.setdefault(name, []).append(number)
    found = {}
    for name, cells_of in rows.items():
        letters, columns = formats[name]
        by_column = [_column(letter, [row[i] for row in cells_of]) for i, letter in enumerate(letters)]
        table = np.zeros(len(cells_of), dtype=[(c, v.dtype) for c, v in zip(columns, by_column, strict=True)])
        for column, values in zip(columns, by_column, strict=True):
            table[column] = values
        found[name] = (table, np.array(places[name], np.int64))
    return found, skipped


def _column(letter: str, cells: list[str]) -> NDArray[Any]:
    """(N,) the values of a field; NaN for what is no number, as a mode by its name."""
    if letter in _WORDS:
        return np.array([one.strip().encode() for one in cells], _WORDS[letter])
    if letter in _WHOLE:
        try:
            return np.array([int(one) for one in cells], np.int64)
        except (ValueError, OverflowError):
            pass
    return np.array([_number(one) for one in cells])


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")
