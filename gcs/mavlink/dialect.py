"""MAVLink dialects as tables: what framing, recording and reading need to know about each message.

The definitions are pymavlink's (generated module, or a user's own XML through pymavlink's generator). Checksum
seeds, lengths and field order follow the MAVLink serialisation guide (mavlink.io/en/guide/serialization.html).
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import importlib.util
import io
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from gcs.errors import DialectError
from gcs.mavlink.cdr import NUMPY_TYPES, Layout, layout

DEFAULT_DIALECT = "ardupilotmega"

_ROS_TYPES = {
    "char": "uint8",
    "uint8_t": "uint8",
    "int8_t": "int8",
    "uint16_t": "uint16",
    "int16_t": "int16",
    "uint32_t": "uint32",
    "int32_t": "int32",
    "uint64_t": "uint64",
    "int64_t": "int64",
    "float": "float32",
    "double": "float64",
}

#: Names of the field that says when a message was made, first found counts, and the unit a name promises.
_STAMP_FIELDS = {
    "time_boot_ms": "ms",
    "time_usec": "us",
    "time_boot_us": "us",
    "timestamp": "",
    "time": "",
    "time_unix_usec": "us",
}
_STAMP_NANOSECONDS = {"us": 1_000, "ms": 1_000_000}

# Columns of MessageTable.table.
CRC_EXTRA, BASE_LENGTH, WIRE_SIZE, CDR_SIZE, STAMP_OFFSET, STAMP_SIZE, STAMP_SCALE, RUN_COUNT, RUNS = range(9)
TABLE_WIDTH = RUNS + 3 * 8


@dataclass(frozen=True)
class MessageType:
    """One message of a dialect.

    base_length: payload bytes without extensions, which is what MAVLink 1 sends; layout.wire_size is with them.
    text_fields: names of the char arrays. stamp: name of the field that holds the sender's time, or "".
    stamp_unit: "us", "ms" or "". units: of the fields that have one, as the definitions name them.
    """

    id: int
    name: str
    crc_extra: int
    base_length: int
    layout: Layout
    text_fields: tuple[str, ...]
    stamp: str
    stamp_unit: str
    units: Mapping[str, str]

    @property
    def schema_name(self) -> str:
        """ROS 2 name, as mavlink/msg/HighresImu: readers refuse underscores."""
        return "mavlink/msg/" + "".join(part.capitalize() for part in self.name.split("_"))


@dataclass(frozen=True)
class Dialect:
    """All messages of a dialect, by id and name, and the same as flat arrays for compiled loops.

    index: (largest id + 1,) int16, row of an id in `table`, -1 for an unknown one.
    table: (messages, TABLE_WIDTH) int64, columns as the constants of this module. commands: numbers of MAV_CMD by name.
    """

    name: str
    messages: tuple[MessageType, ...]
    by_id: Mapping[int, MessageType]
    by_name: Mapping[str, MessageType]
    index: NDArray[np.int16]
    table: NDArray[np.int64]
    commands: Mapping[str, int]

    @staticmethod
    def load(name: str = DEFAULT_DIALECT) -> Dialect:
        """Dialect by the name of a pymavlink module, or by the path of a dialect's XML; DialectError otherwise."""
        return _load(name)


@functools.lru_cache(maxsize=8)
def _load(name: str) -> Dialect:
    module = _module_from_xml(Path(name)) if name.lower().endswith(".xml") else _shipped_module(name)
    messages = tuple(sorted((_message_type(kind) for kind in module.mavlink_map.values()), key=lambda m: m.id))
    if not messages:
        raise DialectError(f"dialect {name} defines no messages; give another dialect")
    index = np.full(messages[-1].id + 1, -1, np.int16)
    index[[message.id for message in messages]] = np.arange(len(messages))
    return Dialect(
        name=Path(name).stem,
        messages=messages,
        by_id={message.id: message for message in messages},
        by_name={message.name: message for message in messages},
        index=index,
        table=np.array([_table_row(message) for message in messages], np.int64),
        commands={entry.name: number for number, entry in module.enums.get("MAV_CMD", {}).items()},
    )


def _shipped_module(name: str) -> ModuleType:
    if not name.isidentifier():
        raise DialectError(f"unknown MAVLink dialect {name!r}; name one that pymavlink ships or the path of its .xml")
    try:
        return importlib.import_module(f"pymavlink.dialects.v20.{name}")
    except ImportError:
        raise DialectError(
            f"unknown MAVLink dialect {name!r}; name one that pymavlink ships or the path of its .xml"
        ) from None


def _module_from_xml(path: Path) -> ModuleType:
    """Run pymavlink's generator on a user's XML and import what it wrote."""
    from pymavlink.generator import mavgen  # only needed here, and slow to import

    if not path.is_file():
        raise DialectError(f"no dialect file {path}; give the path of a MAVLink XML")
    try:
        ElementTree.parse(path)
    except ElementTree.ParseError as error:
        raise DialectError(f"dialect {path} cannot be used: {error}") from None
    with tempfile.TemporaryDirectory() as folder:
        source = _with_includes(path, Path(folder))
        output = Path(folder) / f"{path.stem}.py"
        options = mavgen.Opts(str(output), wire_protocol="2.0", language="Python3", validate=False)
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                mavgen.mavgen(options, [str(source)])
            spec = importlib.util.spec_from_file_location(f"gcs_dialect_{path.stem}", output)
            if spec is None or spec.loader is None:
                raise DialectError(f"dialect {path} cannot be used; check that it is a MAVLink XML")
            module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
        # The generator is a script: it leaves by SystemExit and raises parser errors of several libraries.
        except (Exception, SystemExit) as error:
            raise DialectError(f"dialect {path} cannot be used: {' '.join(str(error).split())}") from None
    return module


def definition_files(path: Path) -> list[Path]:
    """A dialect's XML and all that it includes, one by another, of those beside it. DialectError for bad XML."""
    files = [path]
    for file in files:
        files += [other for name in _includes(file) if (other := path.parent / name).is_file() and other not in files]
    return files


def _includes(path: Path) -> list[str]:
    try:
        return [entry.text or "" for entry in ElementTree.parse(path).iter("include")]
    except ElementTree.ParseError as error:
        raise DialectError(f"dialect {path} cannot be used: {error}") from None


def _with_includes(path: Path, folder: Path) -> Path:
    """The definition where everything it includes lies beside it: a copy with what pymavlink ships if need be."""
    included = [name for file in definition_files(path) for name in _includes(file)]
    if all((path.parent / name).is_file() for name in included):
        return path
    shipped = Path(importlib.import_module("pymavlink.dialects.v20").__path__[0])
    for source in (*shipped.glob("*.xml"), *path.parent.glob("*.xml")):  # the user's own come last and so count
        shutil.copyfile(source, folder / source.name)
    for name in included:
        if not (folder / name).is_file():
            raise DialectError(f"dialect {path} includes {name}, which is neither beside it nor known by that name")
    return folder / path.name


def _message_type(kind: Any) -> MessageType:
    """One message from a class of pymavlink's generated module."""
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    counts = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    names = [name.lower() for name in kind.ordered_fieldnames]
    if len(set(names)) != len(names):
        raise DialectError(f"message {kind.msgname} has fields that differ in case only; rename one in the dialect")
    placed = layout((name.lower(), _ROS_TYPES[types[name]], counts[name]) for name in kind.ordered_fieldnames)
    texts = tuple(n.lower() for n in kind.ordered_fieldnames if types[n] == "char" and counts[n])
    stamp, unit = _stamp_field(kind, placed)
    base = _base_length(kind.msgname, [(types[n], n, counts[n]) for n in kind.ordered_fieldnames], kind.crc_extra)
    units = {name.lower(): text for name, text in kind.fieldunits_by_name.items()}
    return MessageType(kind.id, kind.msgname, kind.crc_extra, base, placed, texts, stamp, unit, units)


def _stamp_field(kind: Any, placed: Layout) -> tuple[str, str]:
    present = {field.name: field for field in placed.fields}
    units = {name.lower(): unit for name, unit in kind.fieldunits_by_name.items()}
    for name, promised in _STAMP_FIELDS.items():
        unit = promised or units.get(name, "")
        if name in present and present[name].type in ("uint32", "uint64") and unit in _STAMP_NANOSECONDS:
            return name, unit
    return "", ""


def _base_length(name: str, fields: list[tuple[str, str, int]], crc_extra: int) -> int:
    """Payload length without extension fields.

    The generated module does not mark extensions, but CRC_EXTRA is the checksum of the base fields' names and
    types alone (serialisation guide, "CRC_EXTRA Calculation") and base fields are sorted by size, so the base
    is the longest sorted beginning whose checksum is CRC_EXTRA.
    """
    from gcs.mavlink.crc import crc_of  # brings the compiler with it: not for a command's help

    crc = crc_of(f"{name} ".encode())
    length = base = 0
    last_size = 8
    for kind, field, count in fields:
        size = np.dtype(NUMPY_TYPES[_ROS_TYPES[kind]]).itemsize
        if size > last_size:
            break
        last_size = size
        crc = crc_of(f"{kind} {field} ".encode() + (bytes((count,)) if count else b""), crc)
        length += size * max(count, 1)
        if (crc & 0xFF) ^ (crc >> 8) == crc_extra:
            base = length
    if base == 0:
        raise DialectError(f"message {name} has a checksum seed that its fields do not give; check the dialect")
    return base


def _table_row(message: MessageType) -> list[int]:
    row = [0] * TABLE_WIDTH
    row[CRC_EXTRA], row[BASE_LENGTH] = message.crc_extra, message.base_length
    row[WIRE_SIZE], row[CDR_SIZE] = message.layout.wire_size, message.layout.cdr_size
    row[STAMP_OFFSET] = -1
    if message.stamp:
        field = message.layout.field(message.stamp)
        row[STAMP_OFFSET], row[STAMP_SIZE] = field.cdr_offset, 4 if field.type == "uint32" else 8
        row[STAMP_SCALE] = _STAMP_NANOSECONDS[message.stamp_unit]
    runs = message.layout.runs
    if len(runs) > 8:
        raise DialectError(f"message {message.name} needs {len(runs)} gaps of padding; at most 7 are supported")
    row[RUN_COUNT] = len(runs)
    row[RUNS : RUNS + 3 * len(runs)] = [value for run in runs for value in run]
    return row
