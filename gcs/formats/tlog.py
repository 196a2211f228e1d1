"""Telemetry logs (.tlog): before each MAVLink frame its time of reception, 8 bytes, big-endian, us since 1970.

Mission Planner, QGroundControl and MAVProxy write them. Real ones hold radio noise and torn frames, so the reader
looks for right checksums and takes the stamp in front of a frame only where it lies beside its neighbours.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from gcs.errors import ImportFileError, RecordingError
from gcs.flights.signals import IMPORT_WARNING
from gcs.mavlink.crc import Int
from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import UNKNOWN, Frames, scan
from gcs.recording.joined import all_parts
from gcs.recording.reader import RUN_NOISE, Recording, WirePieces
from gcs.recording.writer import Counts, McapWriter
from sim_vehicle.jit import jit, jit_arrays

LINK_NAME = "tlog"
_STAMP_BYTES = 8
_BLOCK_BYTES = 16 << 20
_CHUNK_SECONDS = 4.0  # nothing is lost if an import breaks off, so a chunk may be longer than a live one
_STAMP_WINDOW = 9  # frames with whose median time an odd stamp is compared
_STAMP_TOLERANCE_US = 3_600_000_000
# A computer's clock that goes back by more than frames of several links overtake one another was set back.
_SET_BACK_US = 1_000_000
_LATEST_US = 4_102_444_800_000_000  # the year 2100; later is no time but noise

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


def _stamps(frames: Frames) -> Ints:
    """(N,) what the eight bytes in front of each frame say, in us; -1 where another frame is nearer than that."""
    ends = np.concatenate(([0], frames.offset[:-1] + frames.length[:-1]))[: len(frames)]
    stamped = frames.offset - ends >= _STAMP_BYTES
    places = frames.offset[stamped, None] + np.arange(-_STAMP_BYTES, 0)
    stamps = np.full(len(frames), -1, np.int64)
    stamps[stamped] = frames.buffer[places].view(">i8")[:, 0]
    return stamps


def _is_time(stamps: Ints) -> NDArray[np.bool_]:
    return np.asarray((stamps > 0) & (stamps < _LATEST_US))


def _believable(stamps: Ints, previous: int) -> Ints:
    """Stamps in us with the missing and the odd ones replaced by their neighbours' time.

    previous: the last stamp before these, -1 if there is none.
    """
    usable = _is_time(stamps)
    if not usable.any():
        return np.full(stamps.shape, max(previous, 0), np.int64)
    places = np.maximum.accumulate(np.where(usable, np.arange(stamps.size), -1))
    first = int(stamps[usable][0])
    filled = np.where(places >= 0, stamps[places], previous if previous >= 0 else first)
    steps = np.diff(filled)
    if steps.size == 0 or (steps.min() >= 0 and steps.max() <= _STAMP_TOLERANCE_US):
        return filled
    middle = median_filter(filled, size=_STAMP_WINDOW, mode="nearest")
    return np.where(np.abs(filled - middle) > _STAMP_TOLERANCE_US, middle, filled)


def _set_back(times: Ints, previous: int) -> Ints:
    """(N,) us by which the computer's clock was set back before each of these frames, beyond what it was before.

    Frames go on coming meanwhile: what is between the last one before and the first one after is no time. One stamp
    that is early by itself is no clock that was set.
    """
    steps = np.diff(times, prepend=times[:1] if previous < 0 else previous)
    found = np.zeros(times.size, np.int64)
    for place in np.flatnonzero(steps < -_SET_BACK_US).tolist():
        after = times[place : place + _STAMP_WINDOW]
        if np.median(after) < times[place] - steps[place] - _SET_BACK_US:
            found[place] -= steps[place]
    return np.cumsum(found)


@jit_arrays
def _drop_stamps(buffer: Bytes, consumed: int, offset: Ints, stamp: Ints, out: Bytes, moved: Ints) -> Int:
    """Copy all but the stamps; the bytes copied. moved: where the frames are in `out`."""
    p: Int = 0
    q: Int = 0
    for i in range(offset.size + 1):
        last = i == offset.size
        stamped = not last and stamp[i] >= 0
        end = consumed if last else (offset[i] - 8 if stamped else offset[i])
        out[q : q + end - p] = buffer[p:end]
        q += end - p
        p = end + 8 if stamped else end
        if not last:
            moved[i] = q
    return q


def _without_stamps(frames: Frames, stamp: Ints) -> tuple[Bytes, Frames]:
    """The block as the link's own bytes: the stamps taken out, frames moved accordingly."""
    out = np.empty(frames.consumed, np.uint8)
    moved = np.empty(len(frames), np.int64)
    size = int(_drop_stamps(frames.buffer, frames.consumed, frames.offset, stamp, out, moved))
    return out[:size], replace(frames, buffer=out[:size], offset=moved, consumed=size)


def import_tlog(
    path: str | os.PathLike[str],
    out_mcap: str | os.PathLike[str],
    dialect: Dialect | None = None,
    progress: Callable[[float], None] = lambda share: None,
    name: str = "",
) -> Counts:
    """Turn a .tlog, called `name` there, into a recording, block by block; what was found.

    Bytes that belong to no frame and no stamp are kept as noise. ImportFileError if the file cannot be read or
    holds no frame. progress: gets the share of the file that is done.
    """
    source = Path(path)
    dialect = dialect or Dialect.load()
    try:
        file = open(source, "rb")  # noqa: SIM115 (closed below)
    except OSError as error:
        raise ImportFileError(f"{source} cannot be read: {error.strerror}") from None
    with file, McapWriter(out_mcap, dialect, chunk_seconds=_CHUNK_SECONDS) as writer:
        total = max(os.fstat(file.fileno()).st_size, 1)
        tail = b""
        previous = -1
        stamped = behind = 0
        while True:
            block = file.read(_BLOCK_BYTES)
            frames = scan(np.frombuffer(tail + block, np.uint8), dialect, final=not block, gap=_STAMP_BYTES)
            stamps = _stamps(frames)
            stamped += int(np.count_nonzero(_is_time(stamps) & (frames.kind != UNKNOWN)))
            tail = frames.buffer[frames.consumed :].tobytes()
            if frames.consumed:
                times = _believable(stamps, previous)
                if times.size:
                    moved_on = behind + _set_back(times, previous)
                    previous, behind, times = int(times[-1]), int(moved_on[-1]), times + moved_on
                data, moved = _without_stamps(frames, stamps)
                writer.write(LINK_NAME, data, moved, times * 1000)
            if not block:
                break
            progress(file.tell() / total)
        notes = {"source": name or source.name, "format": "tlog"}
        if behind:
            notes[f"{IMPORT_WARNING}clock"] = (
                f"the computer's clock was set back by {behind / 1e6:.0f} s while it recorded; what came after counts"
                " as if it had not been"
            )
        writer.metadata("import", notes)
        counts = writer.counts
    if stamped == 0 and 2 * counts.raw_bytes >= counts.bytes:
        # Noise alone looks like a frame now and then, but not like one behind a time.
        Path(out_mcap).unlink()
        raise ImportFileError(f"{source} holds no MAVLink frame; check that it is a .tlog")
    return counts


@jit
def _stamp_frames(data: Bytes, pieces: Ints, out: Bytes) -> int:
    """Copy the frames among `pieces`, each behind its time in us; bytes written."""
    p = 0
    for i in range(pieces.shape[0]):
        time = pieces[i, 0] // 1000
        for k in range(8):
            out[p + k] = np.uint8((time >> (56 - 8 * k)) & 0xFF)
        p += 8
        for k in range(pieces[i, 2]):
            out[p + k] = data[pieces[i, 1] + k]
        p += pieces[i, 2]
    return p


def _frames_in_order(parts: Iterable[WirePieces]) -> tuple[Bytes, Ints]:
    """Bytes of all links of one chunk behind one another, and the frames in them in the order of reception."""
    data, frames = [], []
    size = 0
    for part in parts:
        moved = part.pieces[part.pieces[:, 3] != RUN_NOISE]
        moved[:, 1] += size
        size += part.data.size
        data.append(part.data)
        frames.append(moved)
    pieces = np.concatenate(frames)
    return np.concatenate(data), pieces[np.argsort(pieces[:, 0], kind="stable")]


def export_tlog(mcap: str | os.PathLike[str], path: str | os.PathLike[str]) -> int:
    """Write every frame of a recording, byte for byte as received, behind its log time; the number of frames.

    Frames of several links stand in the order of reception; noise is left out. RecordingError if a file cannot be
    read or written.
    """
    recording = Recording(all_parts(Path(mcap)))
    count = 0
    try:
        with open(path, "wb") as file:
            for _, parts in itertools.groupby(recording.wire_pieces(), key=lambda part: part.chunk):
                data, pieces = _frames_in_order(parts)
                out = np.empty(data.size + _STAMP_BYTES * len(pieces), np.uint8)
                file.write(out[: _stamp_frames(data, pieces, out)].tobytes())
                count += len(pieces)
    except OSError as error:
        raise RecordingError(f"{path} cannot be written: {error.strerror}") from None
    return count
