"""Columns of values become MAVLink 2 frames, and these a recording as if a link had received them."""

from __future__ import annotations

import io
import tarfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.mavlink.cdr import NUMPY_TYPES
from gcs.mavlink.crc import CRC_TABLES, Int, crc_accumulate, crc_step
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import LARGEST_FRAME, MAGIC_V2, scan
from gcs.recording.writer import McapWriter
from sim_vehicle.jit import jit

AUTOPILOT_COMPONENT = 1
NOTE = "the frames were made from the log's messages; the log itself is attached"
_CHUNK_SECONDS = 4.0
_BLOCK_FRAMES = 1 << 16
_STRAY_US = 3_600_000_000
_USUAL_SHARE = 0.01
_WEEK_US = 7 * 24 * 3_600_000_000
_NO_TIME_US = 1 << 53
# From one boot to the next in one log where no UTC says how long that took.
_PAUSE_US = 10_000_000

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Series:
    """N messages of one type.

    time_us: (N,) the log's own clock. fields: name in lower case -> (N,) or (N, array length), in the message's
    units; a field not named is 0. late_us: how much later than by that clock they are received, as those of a later
    boot are.
    """

    message: str
    time_us: Ints
    fields: Mapping[str, NDArray[Any]]
    late_us: int = 0


@dataclass(frozen=True)
class ImportedLog:
    """What an importer made of a log.

    system: MAVLink system number. utc_offset_us: UTC less the log's clock, None where the log does not know UTC.
    notes: what to keep about the import, by name, as text.
    """

    format: str
    system: int
    series: Sequence[Series]
    utc_offset_us: int | None
    notes: Mapping[str, str]


def whole(values: NDArray[Any], kind: str, unknown: float = 0.0) -> NDArray[Any]:
    """(N,) values as integers of a numpy type: rounded, held within its range, `unknown` where they are no number."""
    limits = np.iinfo(kind)
    given = np.asarray(values, np.float64)
    # The largest int64 and uint64 have no float64; the next below does.
    top = np.nextafter(float(limits.max), 0.0) if limits.bits == 64 else float(limits.max)
    filled = np.clip(np.where(np.isfinite(given), np.rint(given), unknown), float(limits.min), top)
    return filled.astype(kind)


def milliseconds(time_us: Ints) -> NDArray[np.uint32]:
    """(N,) time since boot as MAVLink's 32-bit milliseconds, to the nearest."""
    return ((time_us + 500) // 1000 & 0xFFFFFFFF).astype(np.uint32)


def without_strays(series: Sequence[Series]) -> tuple[list[Series], int]:
    """The series without messages whose time is no time of the log, and how many those were.

    Times with more than an hour to their neighbours on both sides are damaged ones, unless there are many of them; so
    are those a week off the middle of the log.
    """
    times = np.concatenate([entry.time_us for entry in series]) if series else np.empty(0, np.int64)
    if times.size == 0:
        return list(series), 0
    ordered = np.sort(_bounded(times))
    starts = np.flatnonzero(np.diff(ordered, prepend=ordered[0] - 2 * _STRAY_US) > _STRAY_US)
    counts = np.diff(starts, append=ordered.size)
    middle = ordered[ordered.size // 2]
    enough = counts >= min(_USUAL_SHARE * ordered.size, counts.max())
    enough &= (np.abs(ordered[starts] - middle) < _WEEK_US) & (ordered[starts] < _NO_TIME_US)
    groups = [np.searchsorted(ordered[starts], _bounded(entry.time_us), "right") - 1 for entry in series]
    kept = [_only(entry, enough[group]) for entry, group in zip(series, groups, strict=True)]
    return kept, times.size - sum(entry.time_us.size for entry in kept)


def _bounded(time_us: Ints) -> Ints:
    """Times with those that are none put behind all others."""
    return np.where((time_us < 0) | (time_us > _NO_TIME_US), _NO_TIME_US, time_us)


def utc_offset(time_us: Ints, utc_us: Ints) -> int | None:
    """UTC less the log's clock, from moments at which a GPS receiver knew UTC; None where it never did."""
    if time_us.size == 0:
        return None
    offset = int(np.median(utc_us.astype(np.float64) - time_us.astype(np.float64)))
    return offset if 0 <= offset < _NO_TIME_US // 2 else None


def one_after_another(logs: Sequence[ImportedLog]) -> ImportedLog:
    """Several boots of one log as one: each is received after the one before, at its own UTC where it knows it."""
    logs = [log for log in logs if any(entry.time_us.size for entry in log.series)] or list(logs[:1])
    first = logs[0]
    if len(logs) == 1:
        return first
    base = first.utc_offset_us or 0
    series: list[Series] = []
    ends = 0
    for number, log in enumerate(logs):
        times = np.concatenate([entry.time_us for entry in log.series])
        late = 0 if log.utc_offset_us is None or first.utc_offset_us is None else log.utc_offset_us - base
        if number and int(times.min()) + late < ends + _PAUSE_US:
            late = ends + _PAUSE_US - int(times.min())
        ends = int(times.max()) + late
        series += [replace(entry, late_us=late) for entry in log.series]
    notes = {
        key: "; ".join(dict.fromkeys(log.notes[key] for log in logs if key in log.notes))
        for key in dict.fromkeys(key for log in logs for key in log.notes)
    }
    notes["boots"] = f"{len(logs)}: the clock of the log goes back; each is a flight of its own"
    return replace(first, series=series, notes=notes)


def _only(series: Series, keep: NDArray[np.bool_]) -> Series:
    if keep.all():
        return series
    kept = {name: part[keep] for name, part in series.fields.items()}
    return replace(series, time_us=series.time_us[keep], fields=kept)


@jit
def _encode(
    order: Ints,
    payload: Bytes,
    start: Ints,
    size: Ints,
    identity: Ints,
    seed: Ints,
    system: Int,
    component: Int,
    counter: Int,
    crc_tables: NDArray[np.uint16],
    out: Bytes,
) -> Int:
    """Frames of the messages `order` behind one another in `out`; their bytes. counter: of the first frame."""
    p: Int = 0
    for n in range(order.size):
        i = order[n]
        sent = size[i]
        while sent > 1 and payload[start[i] + sent - 1] == 0:
            sent -= 1
        out[p] = MAGIC_V2
        out[p + 1] = sent
        out[p + 2] = 0
        out[p + 3] = 0
        out[p + 4] = (counter + n) & 0xFF
        out[p + 5] = system
        out[p + 6] = component
        out[p + 7] = identity[i] & 0xFF
        out[p + 8] = identity[i] >> 8 & 0xFF
        out[p + 9] = identity[i] >> 16 & 0xFF
        for k in range(sent):
            out[p + 10 + k] = payload[start[i] + k]
        end = p + 10 + sent
        crc = crc_step(crc_accumulate(out, p + 1, end, 0xFFFF, crc_tables), seed[i], crc_tables)
        out[end] = crc & 0xFF
        out[end + 1] = crc >> 8 & 0xFF
        p = end + 2
    return p


def _payloads(series: Series, dialect: Dialect) -> Bytes:
    """(N, payload length) the fields as they stand on the wire."""
    layout = dialect.by_name[series.message].layout
    packed = np.dtype(
        [
            (f.name, NUMPY_TYPES[f.type]) if f.count == 0 else (f.name, NUMPY_TYPES[f.type], (f.count,))
            for f in layout.fields
        ]
    )
    rows = np.zeros(series.time_us.size, packed)
    for name, values in series.fields.items():
        rows[name] = values
    return rows.view(np.uint8).reshape(series.time_us.size, packed.itemsize)


def _frames(log: ImportedLog, dialect: Dialect) -> Iterator[tuple[Bytes, Ints]]:
    """Blocks of frames in the order of time: their bytes, and (N,) the time of each in us."""
    series = [entry for entry in log.series if entry.time_us.size]
    payloads = [_payloads(entry, dialect) for entry in series]
    kinds = [dialect.by_name[entry.message] for entry in series]
    times = np.concatenate([entry.time_us + entry.late_us for entry in series])
    counts = [entry.time_us.size for entry in series]
    size = np.repeat([part.shape[1] for part in payloads], counts).astype(np.int64)
    identity = np.repeat([kind.id for kind in kinds], counts).astype(np.int64)
    seed = np.repeat([kind.crc_extra for kind in kinds], counts).astype(np.int64)
    start = np.cumsum(size) - size
    payload = np.concatenate([part.reshape(-1) for part in payloads])
    order = np.argsort(times, kind="stable")
    out = np.empty(min(order.size, _BLOCK_FRAMES) * LARGEST_FRAME, np.uint8)
    for first in range(0, order.size, _BLOCK_FRAMES):
        block = order[first : first + _BLOCK_FRAMES]
        used = _encode(
            block, payload, start, size, identity, seed, log.system, AUTOPILOT_COMPONENT, first, CRC_TABLES, out
        )
        yield out[:used], times[block]


def write_recording(
    log: ImportedLog, source: Path, target: Path, progress: Progress = lambda share: None, name: str = ""
) -> None:
    """Write the recording of an imported log, with the log itself attached; it is called `name` there.

    Raises ImportFileError where the log holds nothing that MAVLink has a message for; nothing is left behind then.
    """
    total = sum(entry.time_us.size for entry in log.series)
    if total == 0:
        raise ImportFileError(f"{source} holds no message that can be read; check that it is a whole {log.format} log")
    dialect = Dialect.load()
    offset_us = 0 if log.utc_offset_us is None else log.utc_offset_us
    name = name or source.name
    done = 0
    with McapWriter(target, dialect, chunk_seconds=_CHUNK_SECONDS) as writer:
        notes = {"source": name, "format": log.format, "note": NOTE, **log.notes}
        writer.metadata("import", {**notes, "utc": "unknown" if log.utc_offset_us is None else "by GPS"})
        for data, times in _frames(log, dialect):
            writer.write(log.format, data, scan(data, dialect, final=True), (times + offset_us) * 1000)
            done += times.size
            progress(done / total)
        whole, ending = (_packed(source), ".tar") if source.is_dir() else (source.read_bytes(), "")
        writer.attach(f"{name}{ending}.zst", "application/zstd", zstandard.compress(whole, 3))


def _packed(folder: Path) -> bytes:
    """The CSV files of a folder as one tar."""
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w") as tar:
        for path in sorted(folder.glob("*.csv")):
            tar.add(path, path.name)
    return packed.getvalue()
