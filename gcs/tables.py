"""Recordings as one table of text: every message a row group of its own columns."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from gcs.errors import RecordingError
from gcs.recording.reader import MessageColumns, Recording

_BLOCK_ROWS = 4096


def export_csv(recording: Path, target: Path) -> None:
    """Write a long table: one row per value, in the order of message and time.

    Columns: log_time_ns, system, component, message, field, value. Arrays give one row per element (`data[3]`),
    texts one row.
    """
    source = Recording(recording)
    try:
        with target.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(("log_time_ns", "system", "component", "message", "field", "value"))
            for message in source.messages():
                for columns in source.columns(message):
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
