"""Recordings as tables: one long table of text, one wide Parquet table, or a table for each message."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
import pyarrow.parquet as parquet

from gcs.errors import DialectError, RecordingError
from gcs.mavlink.dialect import Dialect
from gcs.recording.joined import all_parts
from gcs.recording.reader import MessageColumns, Recording

_BLOCK_ROWS = 4096
_HEAD = (
    ("log_time_ns", pa.int64(), "ns"),
    ("publish_time_ns", pa.int64(), "ns"),
    ("system", pa.uint8(), ""),
    ("component", pa.uint8(), ""),
    ("sequence", pa.int64(), ""),
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
    source = Recording(all_parts(recording))
    units = _Units(source)
    fields = [pa.field("message", pa.string())]
    for name in source.messages():
        # Every part has the same fields; a damaged file may lack all messages of a name.
        for columns in itertools.islice(source.iter_columns(name), 1):
            fields += _fields(columns, units, f"{name}.")
    schema = pa.schema([*_head_fields(), *fields])
    try:
        with parquet.ParquetWriter(target, schema, compression="zstd") as writer:
            for name in source.messages():
                for columns in source.iter_columns(name):
                    writer.write_table(_wide(columns, schema))
    except OSError as error:
        raise RecordingError(f"{target} cannot be written: {error.strerror or error}") from None


def _wide(columns: MessageColumns, schema: pa.Schema) -> pa.Table:
    given = {**_head(columns), "message": pa.array([columns.name] * len(columns), pa.string())}
    given |= {f"{columns.name}.{label}": values for label, values in _values(columns)}
    arrays = [given.get(field.name, pa.nulls(len(columns), field.type)) for field in schema]
    return pa.Table.from_arrays(arrays, schema=schema)


def export_messages(recording: Path, folder: Path, ending: str) -> list[Path]:
    """Write a table for each message into a new folder; the files.

    ending: csv or parquet. Columns: log_time_ns, publish_time_ns, system, component, sequence and the message's
    fields. RecordingError if the folder is there already, or cannot be written.
    """
    source = Recording(all_parts(recording))
    units = _Units(source)
    written = []
    try:
        folder.mkdir(parents=True)
        for name in source.messages():
            target = folder / f"{name}.{ending}"
            parts = source.iter_columns(name)
            first = next(parts, None)
            if first is None:
                continue
            schema = pa.schema([*_head_fields(), *_fields(first, units, "")])
            with _writer(target, schema, ending) as writer:
                for columns in itertools.chain((first,), parts):
                    arrays = [*_head(columns).values(), *(values for _, values in _values(columns))]
                    writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
            written.append(target)
    except FileExistsError:
        raise RecordingError(f"{folder} exists already; choose another name, or remove it first") from None
    except OSError as error:
        raise RecordingError(f"{folder} cannot be written: {error.strerror or error}") from None
    return written


def _writer(target: Path, schema: pa.Schema, ending: str) -> Any:
    if ending == "csv":
        return arrow_csv.CSVWriter(target, schema)
    return parquet.ParquetWriter(target, schema, compression="zstd")


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
    return [pa.field(name, kind, metadata={"unit": unit} if unit else None) for name, kind, unit in _HEAD]


def _head(columns: MessageColumns) -> dict[str, pa.Array]:
    count = len(columns)
    values = (
        columns.log_time,
        columns.publish_time,
        np.full(count, columns.system, np.uint8),
        np.full(count, columns.component, np.uint8),
        columns.sequence,
    )
    return {name: pa.array(part, kind) for (name, kind, _), part in zip(_HEAD, values, strict=True)}


def _fields(columns: MessageColumns, units: _Units, prefix: str) -> list[pa.Field]:
    fields = []
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


def _values(columns: MessageColumns) -> Iterator[tuple[str, pa.Array]]:
    for name in columns.fields.dtype.names or ():
        if name in columns.text_fields:
            yield name, pa.array(columns.text(name).tolist(), pa.string())
            continue
        table = columns.fields[name].reshape(len(columns), -1)
        for i, label in enumerate(_labels(columns, name)):
            yield label, pa.array(np.ascontiguousarray(table[:, i]))
