"""The file format of ArduPilot's onboard logs (.bin): tables by message name.

A log is a row of messages, each A3 95, its type and the fields that the type's FMT message lists by a letter each
(ArduPilot's AP_Logger; the letters are pymavlink's `DFReader.FORMAT_TO_STRUCT`). There are no checksums, so a message
counts only where the next one, or the file's end, follows right behind it; everything else is skipped and counted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.DFReader import FORMAT_TO_STRUCT

from gcs.errors import ImportFileError
from gcs.importers.dataflash_matlab import read_matrices
from gcs.importers.dataflash_text import is_text, read_lines
from gcs.mavlink.crc import Int
from sim_vehicle.jit import jit

FMT_TYPE, FMT_LENGTH = 0x80, 89
#: Messages that describe others.
DESCRIPTIONS = frozenset({"FMT", "FMTU", "UNIT", "MULT"})
# What old logs hold without a time: parameters and texts.
_LISTS = ("PARM", "MSG")
_HEAD = 3
# The clock begins anew where this many messages on both sides agree that it went back by more than messages overtake
# one another; fewer are damaged stamps.
_AGREE, _BACK_US = 15, 1_000_000

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


@jit
def _find_messages(data: Bytes, lengths: Ints, offset: Ints, kind: Bytes) -> tuple[int, Int, Int]:
    """Places and types of all messages; (their number, bytes skipped, bytes of an unfinished message at the end).

    lengths: (256,) of each type, header included, 0 where it is not known yet; filled from the FMT messages on the way.
    """
    n = 0
    skipped: Int = 0
    p: Int = 0
    end = data.size
    while p + 3 <= end:
        length = lengths[data[p + 2]] if data[p] == 0xA3 and data[p + 1] == 0x95 else np.int64(0)
        after = p + length
        if length > 0 and after > end:
            # Cut off here, if the rest is the beginning of a message; a header among other bytes is not.
            if n > 0 and offset[n - 1] + lengths[kind[n - 1]] == p:
                return n, skipped, end - p
            length = np.int64(0)
        follows = length > 0 and (
            after == end or (data[after] == 0xA3 and (after + 1 == end or data[after + 1] == 0x95))
        )
        if not follows:
            p += 1
            skipped += 1
            continue
        if data[p + 2] == 0x80 and data[p + 4] >= 3 and lengths[data[p + 3]] == 0:
            lengths[data[p + 3]] = data[p + 4]
        offset[n] = p
        kind[n] = data[p + 2]
        n += 1
        p = after
    if n > 0 and offset[n - 1] + lengths[kind[n - 1]] == p:
        return n, skipped, end - p
    return n, skipped + end - p, np.int64(0)


@dataclass(frozen=True)
class Table:
    """All N messages of one type: (N,) structured, in the order of the file, each field's factor, and (N,) places in
    the file. given_us: (N,) times of messages that carry none.
    """

    name: str
    rows: NDArray[Any]
    factors: Mapping[str, float]
    places: Ints
    given_us: Ints | None = None

    def __len__(self) -> int:
        return int(self.rows.size)

    def __contains__(self, field: object) -> bool:
        return field in (self.rows.dtype.names or ())

    @property
    def is_timed(self) -> bool:
        """Whether the time since boot of its messages is known."""
        return self.given_us is not None or self._clock is not None

    @property
    def _clock(self) -> tuple[str, int] | None:
        """The field of the time since boot, and its unit in us.

        Before ArduPilot 3.3 that was TimeMS; a GPS had that of its own week there, and the time since boot in T.
        """
        clocks = (("TimeUS", 1), ("T", 1000) if "Week" in self else ("TimeMS", 1000))
        return next((one for one in clocks if one[0] in self and self.rows.dtype[one[0]].kind in "iu"), None)

    @cached_property
    def time_us(self) -> Ints:
        """(N,) time since boot."""
        if self.given_us is not None:
            return self.given_us
        name, unit = self._clock or ("TimeUS", 1)
        return self.rows[name].astype(np.int64) * unit

    def values(self, *names: str) -> NDArray[np.float64]:
        """(N,) the first of these fields that there is, its factor applied; NaN where the log has none of them."""
        for name in names:
            if name in self and self.rows.dtype[name].kind != "S":
                with np.errstate(invalid="ignore"):  # damaged bytes may be a signalling NaN
                    return self.rows[name].astype(np.float64) * self.factors[name]
        return np.full(len(self), np.nan)

    def texts(self, name: str) -> list[str]:
        """(N,) a field of letters, up to its first zero byte."""
        if name not in self or self.rows.dtype[name].kind != "S":
            return [""] * len(self)
        return [bytes(entry).split(b"\0")[0].decode("utf-8", "replace") for entry in self.rows[name]]

    def only(self, keep: NDArray[np.bool_]) -> Table:
        """The messages chosen by a mask."""
        given = None if self.given_us is None else self.given_us[keep]
        return Table(self.name, self.rows[keep], self.factors, self.places[keep], given)


@dataclass(frozen=True)
class DataflashLog:
    """A log's messages by name, and what of its bytes is no message.

    skipped: bytes that belong to no message. unfinished: bytes of a message cut off at the end. unreadable: types
    whose FMT does not fit their messages. is_text: whether it was one of lines.
    """

    tables: Mapping[str, Table]
    skipped: int
    unfinished: int
    unreadable: tuple[str, ...]
    is_text: bool = False


def boots(log: DataflashLog) -> list[DataflashLog]:
    """The log in parts, each of one run of the clock since boot; what carries no time belongs to every part."""
    timed = [table for table in log.tables.values() if table.is_timed]
    places = np.concatenate([table.places for table in timed]) if timed else np.empty(0, np.int64)
    order = np.argsort(places)
    cuts = [0]
    if timed:
        times = np.concatenate([table.time_us for table in timed])[order]
        for at in (np.flatnonzero(times[1:] < times[:-1] - _BACK_US) + 1).tolist():
            before, after = times[max(at - _AGREE, cuts[-1]) : at], times[at : at + _AGREE]
            if min(before.size, after.size) == _AGREE and np.median(after) < np.median(before) - _BACK_US:
                cuts.append(at)
    edges = [*places[order][cuts[1:]].tolist(), np.iinfo(np.int64).max]
    parts, start = [], -1
    for end in edges:
        tables = {
            name: table.only((table.places >= start) & (table.places < end)) if table.is_timed else table
            for name, table in log.tables.items()
        }
        parts.append(replace(log, tables=tables))
        start = end
    return parts


def read_dataflash(path: Path) -> DataflashLog:
    """Read a log whole, as bytes or as text; ImportFileError if the file cannot be read or holds no FMT message."""
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise ImportFileError(f"{path} cannot be read: {error.strerror}") from None
    if is_text(data):
        return _of_text(data, path)
    lengths = np.zeros(256, np.int64)
    lengths[FMT_TYPE] = FMT_LENGTH
    offset = np.empty(data.size // _HEAD + 1, np.int64)
    kind = np.empty(data.size // _HEAD + 1, np.uint8)
    count, skipped, unfinished = _find_messages(data, lengths, offset, kind)
    offset, kind = offset[:count], kind[:count]
    formats = _formats(data, offset[kind == FMT_TYPE])
    if not formats:
        raise ImportFileError(
            f"{path} holds no message of a dataflash log; check that it is an ArduPilot .bin, or the text of one"
        )
    tables: dict[str, Table] = {}
    unreadable = []
    for number, (name, length, letters, columns) in formats.items():
        places = offset[kind == number]
        if places.size == 0:
            continue
        table = _table(data, places, name, length, letters, columns)
        if table is None:
            unreadable.append(name)
        else:
            tables[name] = table
    return DataflashLog(_timed(tables), int(skipped), int(unfinished), tuple(sorted(unreadable)))


def _of_text(data: Bytes, path: Path) -> DataflashLog:
    """A log as text: fields stand there in their units."""
    found, skipped = read_lines(data)
    if not found:
        raise ImportFileError(f"{path} holds no message of a dataflash log but its formats; give the whole log")
    return DataflashLog(_in_units(found), skipped, 0, (), is_text=True)


def read_mission_planner(path: Path) -> DataflashLog:
    """Read a log that Mission Planner saved for MATLAB; ImportFileError if the file cannot be read."""
    return DataflashLog(_in_units(read_matrices(path)), 0, 0, ())


def _in_units(found: Mapping[str, tuple[NDArray[Any], Ints]]) -> dict[str, Table]:
    """Tables of fields that are in their units already."""
    tables = {
        name: Table(name, rows, dict.fromkeys(rows.dtype.names or (), 1.0), places)
        for name, (rows, places) in found.items()
    }
    return _timed(tables)


def _timed(tables: dict[str, Table]) -> dict[str, Table]:
    """The tables with parameters and texts that carry no time, as in old logs, at that of the message before them."""
    known = [table for table in tables.values() if table.is_timed]
    late = [name for name in _LISTS if name in tables and not tables[name].is_timed]
    if not known or not late:
        return tables
    places = np.concatenate([table.places for table in known])
    order = np.argsort(places)
    places, times = places[order], np.concatenate([table.time_us for table in known])[order]
    before = {name: np.searchsorted(places, tables[name].places) - 1 for name in late}
    return {**tables, **{name: replace(tables[name], given_us=times[np.maximum(at, 0)]) for name, at in before.items()}}


def _formats(data: Bytes, places: Ints) -> dict[int, tuple[str, int, str, list[str]]]:
    """Type -> (name, length, letters, columns) of every FMT message; the first of a type counts."""
    formats: dict[int, tuple[str, int, str, list[str]]] = {}
    for at in places.tolist():
        body = data[at + _HEAD : at + FMT_LENGTH].tobytes()
        name, letters, columns = (
            part.split(b"\0")[0].decode("ascii", "replace") for part in (body[2:6], body[6:22], body[22:86])
        )
        formats.setdefault(body[0], (name, body[1], letters, columns.split(",") if columns else []))
    return formats


def _table(data: Bytes, places: Ints, name: str, length: int, letters: str, columns: list[str]) -> Table | None:
    """The messages at these places; None where letters, columns and length contradict each other."""
    if len(letters) != len(columns) or len(set(columns)) != len(columns) or any(c not in _TYPES for c in letters):
        return None
    layout = np.dtype(list(zip(columns, (_TYPES[letter] for letter in letters), strict=True)))
    if layout.itemsize != length - _HEAD or not columns:
        return None
    bodies = data[places[:, None] + np.arange(_HEAD, length)]
    factors = {column: FORMAT_TO_STRUCT[letter][1] or 1.0 for column, letter in zip(columns, letters, strict=True)}
    return Table(name, np.ascontiguousarray(bodies).view(layout)[:, 0], factors, places)


def _numpy_type(letter: str) -> str:
    """The numpy type of a format letter, from its letter of the struct module."""
    code = FORMAT_TO_STRUCT[letter][0]
    return f"S{code[:-1]}" if code.endswith("s") else f"<{np.dtype(code).str[1:]}"


_TYPES = {letter: _numpy_type(letter) for letter in FORMAT_TO_STRUCT}


__all__ = ["DESCRIPTIONS", "DataflashLog", "Table", "boots", "read_dataflash", "read_mission_planner"]
