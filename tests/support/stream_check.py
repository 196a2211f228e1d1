"""What must hold of framing and recording for any byte stream, judged without their help.

Checksums are computed bit by bit here, as the CRC-16/MCRF4XX of the MAVLink serialisation guide, and the seeds come
from pymavlink; the other judge is pymavlink's own robust parser.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mutated_streams import Stream
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from wire_streams import wire_streams

from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import UNKNOWN, Framer, Frames, scan
from gcs.recording.reader import Recording
from gcs.recording.writer import McapWriter

Ints = NDArray[np.int64]
START_NS = 1_760_000_000_000_000_000
_SEEDS = np.full(1 << 24, -1, np.int16)
_SEEDS[list(mavlink.mavlink_map)] = [kind.crc_extra for kind in mavlink.mavlink_map.values()]


@dataclass(frozen=True)
class Verdict:
    """Figures of one stream that passed.

    found: frames of known id. unknown: of unknown id. overlapped: frames placed whole that begin inside another frame
    whose checksum is right too. peer: frames of known id that pymavlink found. lost_by_peer: placed whole, of known id,
    found here and not by pymavlink.
    """

    bytes: int
    placed: int
    found: int
    unknown: int
    overlapped: int
    peer: int
    lost_by_peer: int


def _crc(rows: NDArray[np.uint8], lengths: Ints) -> NDArray[np.uint16]:
    """Checksum of the first `lengths` bytes of each row."""
    crc = np.full(lengths.size, 0xFFFF, np.uint16)
    for k in range(int(lengths.max(initial=0))):
        step = crc ^ rows[:, k]
        for _ in range(8):
            step = np.where(step & 1, (step >> 1) ^ np.uint16(0x8408), step >> 1)
        crc = np.where(k < lengths, step, crc)
    return crc


def check_frames(data: NDArray[np.uint8], frames: Frames) -> None:
    """Every frame's length is what its header says, its checksum is right, none overlaps another, no byte is left."""
    offset, length = frames.offset, frames.length.astype(np.int64)
    two = data[offset] == 0xFD
    assert np.all(two | (data[offset] == 0xFE))
    signed = two & (data[np.minimum(offset + 2, data.size - 1)] == 1)
    covered = np.where(two, 9, 5) + data[offset + 1]
    assert np.array_equal(length, covered + 3 + 13 * signed)
    assert np.all(offset[1:] >= offset[:-1] + length[:-1])
    assert frames.consumed == data.size
    assert int(length.sum()) + frames.raw == data.size
    identity = np.where(
        two,
        data[np.minimum(offset + 7, data.size - 1)]
        | data[np.minimum(offset + 8, data.size - 1)].astype(np.int64) << 8
        | data[np.minimum(offset + 9, data.size - 1)].astype(np.int64) << 16,
        data[offset + 5],
    )
    assert np.array_equal(frames.msgid, identity)
    seeds = _SEEDS[identity]
    assert np.array_equal(seeds >= 0, frames.kind != UNKNOWN)
    order = np.flatnonzero(seeds >= 0)
    padded = np.concatenate((data, np.zeros(300, np.uint8)))
    for part in np.array_split(order[np.argsort(covered[order])], max(order.size // 2000, 1)):
        if part.size == 0:
            continue
        span = int(covered[part].max())
        rows = padded[offset[part][:, None] + 1 + np.arange(span + 1)]
        rows[np.arange(part.size), covered[part]] = seeds[part]
        sent = data[offset[part] + 1 + covered[part]] | data[offset[part] + 2 + covered[part]].astype(np.uint16) << 8
        assert np.array_equal(_crc(rows, covered[part] + 1), sent)


def missing(stream: Stream, frames: Frames) -> Ints:
    """Placed frames (index) that were not found and for which no accepted frame stands in their place.

    One of known id can only give way to another of known id that begins in front of it and reaches into it; one of
    unknown id also to one that begins inside it.
    """
    found = set(zip(frames.offset.tolist(), frames.length.tolist(), strict=True))
    lost = [i for i, place in enumerate(map(tuple, stream.placed.tolist())) if place not in found]
    kept = []
    for i in lost:
        start, size = (int(value) for value in stream.placed[i])
        before = int(np.searchsorted(frames.offset, start)) - 1
        reaches = before >= 0 and int(frames.offset[before] + frames.length[before]) > start
        if reaches and (not stream.known[i] or frames.kind[before] != UNKNOWN):
            continue
        inside = before + 1
        hidden = inside < len(frames) and int(frames.offset[inside]) < start + size
        if not stream.known[i] and hidden and frames.kind[inside] != UNKNOWN:
            continue
        kept.append(i)
    return np.array(kept, np.int64)


def peer_frames(data: NDArray[np.uint8]) -> set[tuple[int, int]]:
    """(offset, length) of every frame of known id that pymavlink's robust parser finds."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    found: set[tuple[int, int]] = set()
    at = 0
    raw = data.tobytes()
    for start in range(0, len(raw), 4096):
        for message in parser.parse_buffer(raw[start : start + 4096]) or []:
            bad = isinstance(message, mavlink.MAVLink_bad_data)
            size = len(message.data if bad else message.get_msgbuf())
            if not bad and not isinstance(message, mavlink.MAVLink_unknown):
                found.add((at, size))
            at += size
    return found


def record(data: NDArray[np.uint8], cuts: Iterable[int], path: Path, dialect: Dialect, whole: Frames) -> None:
    """Through the framer in pieces and into a recording: the same frames, and each byte in its place again."""
    framer = Framer(dialect)
    raw = data.tobytes()
    offsets: list[Ints] = []
    taken = 0
    with McapWriter(path, dialect) as writer:
        edges = [0, *cuts, len(raw)]
        for number, (start, stop) in enumerate(itertools.pairwise(edges)):
            buffer, frames = framer.feed(raw[start:stop], final=stop == len(raw))
            assert buffer.size == frames.consumed
            offsets.append(frames.offset + taken)
            taken += buffer.size
            writer.write("fuzz", buffer, frames, START_NS + number * 1_000_000)
        counts = writer.counts
    assert np.array_equal(np.concatenate(offsets), whole.offset)
    assert counts.bytes == taken == len(raw)
    assert counts.raw_bytes == whole.raw
    assert counts.unknown_frames == whole.unknown
    assert counts.messages == len(whole) - whole.unknown
    recording = Recording(path)
    streams = {link: b"".join(piece for _, piece in pieces) for link, pieces in wire_streams(recording).items()}
    assert streams == {"fuzz": raw}
    assert not recording.damage


def judge(stream: Stream, cuts: Iterable[int], path: Path, dialect: Dialect) -> Verdict:
    """Frame and record a stream, and hold the result against everything above; AssertionError where it fails."""
    frames = scan(stream.data, dialect, final=True)
    check_frames(stream.data, frames)
    assert missing(stream, frames).size == 0
    found = set(zip(frames.offset.tolist(), frames.length.tolist(), strict=True))
    peer = peer_frames(stream.data)
    for start, size in peer - found:
        # It begins or ends inside a frame that is whole: pymavlink was led astray by a false header.
        before = int(np.searchsorted(frames.offset, start, side="right")) - 1
        reaches = before >= 0 and int(frames.offset[before] + frames.length[before]) > start
        assert reaches, (start, size)
        assert frames.kind[before] != UNKNOWN, (start, size)
    path.unlink(missing_ok=True)  # of the stream before
    record(stream.data, cuts, path, dialect, frames)
    placed = list(map(tuple, stream.placed.tolist()))
    return Verdict(
        bytes=stream.data.size,
        placed=len(placed),
        found=len(frames) - frames.unknown,
        unknown=frames.unknown,
        overlapped=sum(place not in found for place in placed),
        peer=len(peer),
        lost_by_peer=sum(
            place in found and place not in peer for place, known in zip(placed, stream.known, strict=True) if known
        ),
    )
