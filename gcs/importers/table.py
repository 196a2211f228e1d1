"""Tables (CSV, Parquet, .mat, .npz, X-Plane's Data.txt) as recordings: a row is one message with every signal in SI.

No standard message holds what tables hold (deflections of surfaces, true airspeed, density), and several would each
have a stamp of their own: a row has one.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.flights.sender import FIXED_WING
from gcs.flights.signal_sources import TABLE_NAMES, TABLE_SIGNALS, TABLE_SIGNALS_EACH
from gcs.flights.signals import IMPORT_WARNING
from gcs.importers import messages as make
from gcs.importers.synthesis import ImportedLog, Progress, Series, write_recording
from sysid.errors import TableError
from sysid.signals.flight import FlightSignals
from sysid.tables.files import read_mapping, read_table
from sysid.tables.flight_table import flight_from_table

FORMAT = "table"
NOTE = "its columns: signals in SI units and radians, one message for each row; the table itself is attached"
_GENERIC_AUTOPILOT = 0
_ELEMENTS, _NAME_LENGTH = 58, 10  # of DEBUG_FLOAT_ARRAY
# A stamp of 0 means "none"; rows begin a second after it.
FIRST_US = 1_000_000
_EARLIEST_UTC_S = 946_684_800.0  # the year 2000


def import_table(
    source: Path,
    target: Path,
    progress: Progress = lambda share: None,
    name: str = "",
    columns: Path | None = None,
) -> None:
    """Write a table as a recording, called `name` there. columns: TOML that says what its columns are.

    Raises ImportFileError in one line where the table cannot be read, or the unit of a column is not known.
    """
    called = name or source.name
    try:
        table = read_table(source, name)
        wanted, units = ({}, {}) if columns is None else read_mapping(columns)
        found, matched = table.matched(wanted, units)
        flight = flight_from_table(called, found, matched, table.warnings)
        start_s = float(np.nanmin(np.asarray(found[matched.time.headers[0]], dtype=np.float64)))
    except TableError as error:
        text = _with_advice(error)
        raise ImportFileError(text if called in text else f"{called}: {text}") from None
    if not flight.signals.keys() & set(TABLE_SIGNALS):
        raise ImportFileError(
            f"{called}: none of its columns is a signal; name them in a file of columns"
            " (--columns FILE.toml; on the page, the box below the file)"
        )
    start_s = matched.time.unit.factor * start_s
    used = "; ".join(use.sentence for use in (matched.time, *matched.uses))
    notes = {"note": NOTE, "columns": used, "unused": ", ".join((*matched.unused, *table.left_out))}
    notes |= {f"{IMPORT_WARNING}{number}": warning for number, warning in enumerate(flight.warnings, 1)}
    utc = round(1e6 * start_s) - FIRST_US if start_s > _EARLIEST_UTC_S else None
    write_recording(ImportedLog(FORMAT, 1, row_series(flight), utc, notes), source, target, progress, name)


def _with_advice(error: TableError) -> str:
    """What is wrong, and how a file of columns says it: in TOML, as it is to be written."""
    where = "(--columns FILE.toml; on the page, the box below the file)"
    if error.units:
        lines = ", ".join(f'"{header}" = "{unit}"' for header, unit in error.units.items())
        return (
            f"{str(error).partition(':')[0]}: say it in a file of columns {where}, [units] and a line for each, as they"
            f' are: {lines}; or units = "SI" alone, where all are in SI units and radians'
        )
    return f"{error}; say it in a file of columns {where}" if " = {" in str(error) else str(error)


def row_series(flight: FlightSignals) -> list[Series]:
    """The signals of a flight that tables hold: messages for each row, and a HEARTBEAT for each second.

    Rows are stamped from a second on; those of signals with other stamps lie between.
    """
    kept = {key: one for key, one in flight.signals.items() if key in TABLE_SIGNALS}
    times = np.unique(np.concatenate([one.time_s for one in kept.values()]))
    time_us = FIRST_US + np.rint(1e6 * times).astype(np.int64)
    series = [make.heartbeats(time_us, vehicle=FIXED_WING, autopilot=_GENERIC_AUTOPILOT, armed=[], mode=[])]
    for number, message in enumerate(TABLE_NAMES):
        names = TABLE_SIGNALS[number * TABLE_SIGNALS_EACH :][:TABLE_SIGNALS_EACH]
        if not kept.keys() & set(names):
            continue
        data = np.full((times.size, _ELEMENTS), np.nan, np.float32)
        for place, name in enumerate(names):
            if name in kept:
                rows, values = np.searchsorted(times, kept[name].time_s), kept[name].values
                data[rows, 2 * place] = high = values.astype(np.float32)
                data[rows, 2 * place + 1] = (values - high).astype(np.float32)
        label = np.zeros((times.size, _NAME_LENGTH), np.uint8)
        label[:, : len(message)] = np.frombuffer(message.encode(), np.uint8)
        fields: dict[str, NDArray[Any]] = {"time_usec": time_us.astype(np.uint64), "name": label, "data": data}
        fields["array_id"] = np.full(times.size, number, np.uint16)
        series.append(Series("DEBUG_FLOAT_ARRAY", time_us, fields))
    return series
