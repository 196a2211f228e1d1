"""Recordings as tables: one long table of text, one wide Parquet table, or a table for each message."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.errors import DialectError, RecordingError
from gcs.formats.arrow import arrow
from gcs.mavlink.dialect import Dialect
from gcs.recording.joined import all_parts
from gcs.recording.reader import MessageColumns, Recording

if TYPE_CHECKING:
    import pyarrow as pa

_BLOCK_ROWS = 4096
# Name, type and unit of the columns in front.
_HEAD = (
    ("log_time_ns", np.int64, "ns"),
    ("publish_time_ns", np.int64, "ns"),
    ("system", np.uint8, ""),
    ("component", np.uint8, ""),
    ("sequence", np.int64, ""),
)


def export_csv(recording: Path, target: Path) -> None:
    """Write a long table: one row per value, in the order of message and time.

    Columns: log_time_ns, system, component, message, field, value. Arrays give one row per element (`data[3]`),
    texts one row.
    """
    source = Recording(all_parts(recording))
    try:
        with target.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(("log_time_ns", "system", "component", "message", "field", "value"))
            for message in source.messages():
                for columns in source.iter_columns(message):
                    _write_message(writer, columns)
    except OSError as error:
        raise RecordingError(f"{target} cannot be written: {error.strerror}") from error


def _write_message(writer: Any, columns: MessageColumns) -> None:
    names = columns.fields.dtype.names or ()
    texts = {name: columns.text(name) for name in columns.text_fields}
    for start in range(0, columns.log_time.size, _BLOCK_ROWS):
        block = slice(start, start + _BLOCK_ROWS)
        times = columns.log_time[block].tolist()
        values = [
            (label, cells)
            for name in names
            for label, cells in _cells(name, texts[name][block] if name in texts else columns.fields[name][block])
        ]
        for row, at in enumerate(times):
            head = (at, columns.system, columns.component, columns.name)
            writer.writerows((*head, label, cells[row]) for label, cells in values)


def _cells(name: str, column: np.ndarray[Any, Any]) -> list[tuple[str, list[Any]]]:
    if column.ndim == 1:
        return [(name, column.tolist())]
    return [(f"{name}[{i}]", column[:, i].tolist()) for i in range(column.shape[1])]


def export_parquet(recording: Path, target: Path) -> None:
    """Write one wide table: a row per message, its values in the columns `MESSAGE.field`, null in all others.

    The columns in front are log_time_ns, publish_time_ns, system, component, sequence and message. Arrays give one
    column per element, texts one of text. A column's metadata names its unit. Rows of one message stand together, so
    a reader of few columns reads only what it needs.
    """
    pa = arrow()
    source = Recording(all_parts(recording))
    units = _Units(source)
    fields = [pa.field("message", pa.string())]
    for name in source.messages():
        # Every part has the same fields; a damaged file may lack all messages of a name.
        for columns in itertools.islice(source.iter_columns(name), 1):
            fields += _fields(columns, units, f"{name}.")
    schema = pa.schema([*_head_fields(), *fields])
    try:
        with pa.parquet.ParquetWriter(target, schema, compression="zstd") as writer:
            for name in source.messages():
                for columns in source.iter_columns(name):
                    writer.write_table(_wide(columns, schema))
    except OSError as error:
        raise RecordingError(f"{target} cannot be written: {error.strerror or error}") from None


def _wide(columns: MessageColumns, schema: pa.Schema) -> pa.Table:
    pa = arrow()
    given: dict[str, Any] = {**_head(columns), "message": [columns.name] * len(columns)}
    given |= {f"{columns.name}.{label}": values for label, values in _values(columns)}
    arrays = [
        pa.array(given[field.name], field.type) if field.name in given else pa.nulls(len(columns), field.type)
        for field in schema
    ]
    return pa.Table.from_arrays(arrays, schema=schema)


def export_messages(recording: Path, folder: Path, ending: str) -> list[Path]:
    """Write a table for each message into a new folder; the files.

    ending: csv or parquet. Columns: log_time_ns, publish_time_ns, system, component, sequence and the message's
    fields. RecordingError if the folder is there already, or cannot be written.
    """
    source = Recording(all_parts(recording))
    write = _messages_writer(source) if ending == "parquet" else _write_csv
    written = []
    try:
        folder.mkdir(parents=True)
        for name in source.messages():
            target = folder / f"{name}.{ending}"
            parts = source.iter_columns(name)
            first = next(parts, None)
            if first is None:
                continue
            write(target, first, itertools.chain((first,), parts))
            written.append(target)
    except FileExistsError:
        raise RecordingError(f"{folder} exists already; choose another name, or remove it first") from None
    except OSError as error:
        raise RecordingError(f"{folder} cannot be written: {error.strerror or error}") from None
    return written


def _write_csv(target: Path, first: MessageColumns, parts: Iterable[MessageColumns]) -> None:
    with target.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*(name for name, _, _ in _HEAD), *(label for label, _ in _values(first))])
        for columns in parts:
            cells = [*_head(columns).values(), *(values for _, values in _values(columns))]
            # A float of 32 bits in as many digits as it has.
            writer.writerows(zip(*(one.astype(str) if one.dtype.kind == "f" else one for one in cells), strict=True))


def _messages_writer(source: Recording) -> Callable[[Path, MessageColumns, Iterable[MessageColumns]], None]:
    pa, units = arrow(), _Units(source)

    def write(target: Path, first: MessageColumns, parts: Iterable[MessageColumns]) -> None:
        schema = pa.schema([*_head_fields(), *_fields(first, units, "")])
        with pa.parquet.ParquetWriter(target, schema, compression="zstd") as writer:
            for columns in parts:
                values = [*_head(columns).values(), *(values for _, values in _values(columns))]
                arrays = [pa.array(one, field.type) for one, field in zip(values, schema, strict=True)]
                writer.write_table(pa.Table.from_arrays(arrays, schema=schema))

    return write


class _Units:
    """Units by message and field, as the dialect of the recording names them."""

    def __init__(self, recording: Recording) -> None:
        self._dialects = []
        for name in recording.dialects():
            try:
                self._dialects.append(Dialect.load(name))
            except DialectError:
                continue  # a user's own dialect is not at hand here; its fields have no unit then

    def of(self, message: str, field: str) -> str:
        for dialect in self._dialects:
            if message in dialect.by_name:
                return dialect.by_name[message].units.get(field, "")
        return ""


def _head_fields() -> list[pa.Field]:
    pa = arrow()
    return [
        pa.field(name, pa.from_numpy_dtype(kind), metadata={"unit": unit} if unit else None)
        for name, kind, unit in _HEAD
    ]


def _head(columns: MessageColumns) -> dict[str, np.ndarray[Any, Any]]:
    count = len(columns)
    values = (
        columns.log_time,
        columns.publish_time,
        np.full(count, columns.system, np.uint8),
        np.full(count, columns.component, np.uint8),
        columns.sequence,
    )
    return {name: np.asarray(part, kind) for (name, kind, _), part in zip(_HEAD, values, strict=True)}


def _fields(columns: MessageColumns, units: _Units, prefix: str) -> list[pa.Field]:
    pa, fields = arrow(), []
    for name in columns.fields.dtype.names or ():
        kind = pa.string() if name in columns.text_fields else pa.from_numpy_dtype(columns.fields.dtype[name].base)
        unit = units.of(columns.name, name)
        metadata = {"unit": unit} if unit else None
        fields += [pa.field(prefix + label, kind, metadata=metadata) for label in _labels(columns, name)]
    return fields


def _labels(columns: MessageColumns, name: str) -> list[str]:
    shape = columns.fields.dtype[name].shape
    if name in columns.text_fields or not shape:
        return [name]
    return [f"{name}[{i}]" for i in range(shape[0])]


def _values(columns: MessageColumns) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    for name in columns.fields.dtype.names or ():
        if name in columns.text_fields:
            yield name, np.asarray(columns.text(name), dtype=object)
            continue
        table = columns.fields[name].reshape(len(columns), -1)
        for i, label in enumerate(_labels(columns, name)):
            yield label, np.ascontiguousarray(table[:, i])
