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
# The time since boot, which must be whole: a message without one is none.
_CLOCKS = ("TimeUS", "TimeMS")
_LOOKED_AT = 1 << 16
# Messages of a name that are kept as words until they are turned to numbers.
_CHUNK = 20_000


def is_text(data: NDArray[np.uint8]) -> bool:
    """Whether the bytes of a log are such lines. data: (N,), its beginning at least."""
    head = data[:_LOOKED_AT].tobytes().rstrip(b"\0")
    return b"\0" not in head and any(line.replace(b" ", b"").startswith(b"FMT,") for line in head.splitlines())


class _Messages:
    """Messages of one name as they are read."""

    def __init__(self, letters: str, columns: list[str]) -> None:
        self.letters, self.columns = letters, columns
        self.clock = next((columns.index(one) for one in _CLOCKS if one in columns), None)
        self._cells: list[list[str]] = []
        self._places: list[int] = []
        self._parts: list[list[NDArray[Any]]] = []
        self._kept: list[NDArray[np.int64]] = []

    def add(self, rest: str, number: int) -> bool:
        """Take a line's fields; False where they are none of such a message."""
        # The last field may be a text with commas in it.
        cells = rest.split(",", len(self.columns) - 1)
        if len(cells) != len(self.columns):
            return False
        if self.clock is not None:
            stamp = _whole(cells[self.clock])
            if stamp is None or not 0 <= stamp < 1 << 62:
                return False
            cells[self.clock] = str(stamp)
        self._cells.append(cells)
        self._places.append(number)
        if len(self._cells) >= _CHUNK:
            self._turn()
        return True

    def _turn(self) -> None:
        """From words to numbers."""
        if self._cells:
            by_column = zip(*self._cells, strict=True)
            self._parts.append([_column(one, list(cells)) for one, cells in zip(self.letters, by_column, strict=True)])
            self._kept.append(np.array(self._places, np.int64))
        self._cells, self._places = [], []

    def table(self) -> tuple[NDArray[Any], NDArray[np.int64]] | None:
        """(N,) structured messages and the (N,) lines that they stand in; None for no message."""
        self._turn()
        if not self._kept:
            return None
        joined = [np.concatenate([part[i] for part in self._parts]) for i in range(len(self.columns))]
        table = np.zeros(joined[0].size, dtype=[(c, v.dtype) for c, v in zip(self.columns, joined, strict=True)])
        for column, values in zip(self.columns, joined, strict=True):
            table[column] = values
        return table, np.concatenate(self._kept)


def read_lines(data: NDArray[np.uint8]) -> tuple[dict[str, tuple[NDArray[Any], NDArray[np.int64]]], int]:
    """Name -> (N,) structured messages and the (N,) lines that they stand in; and how many bytes are in no message.

    data: (M,) bytes of the log.
    """
    every: dict[str, _Messages] = {}
    skipped = 0
    for number, raw in enumerate(data.tobytes().splitlines()):
        line = raw.decode("utf-8", "replace")
        name, _, rest = line.partition(",")
        name = name.strip()
        if name == _FMT:
            fields = [one.strip() for one in rest.split(",", 4)]
            columns = [one.strip() for one in fields[-1].split(",") if one.strip()]
            if len(fields) == 5 and len(columns) == len(fields[3]) == len(set(columns)):
                if fields[2] not in every:
                    every[fields[2]] = _Messages(fields[3], columns)
                continue
        if name not in every or not every[name].add(rest, number):
            skipped += len(raw) + 1 if raw.strip() else 0
    found = {name: one.table() for name, one in every.items()}
    return {name: one for name, one in found.items() if one is not None}, skipped


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


def _whole(cell: str) -> int | None:
    """A whole number, written as one or with zeros behind a point; None for anything else."""
    try:
        return int(cell)
    except ValueError:
        value = _number(cell)
        return int(value) if value == value // 1 and abs(value) < 1e15 else None


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")
