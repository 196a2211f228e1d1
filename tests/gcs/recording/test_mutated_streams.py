"""Any bytes at all: framed, recorded and rebuilt, with every whole frame among them found."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mavlink_frames import Sender
from mutated_streams import Stream, frame_pool, mutated_stream
from stream_check import judge, missing, peer_frames

from gcs.mavlink.dialect import Dialect
from gcs.mavlink.framing import scan

DIALECT = Dialect.load()
POOL = frame_pool(1)


def _frame(index: int) -> bytes:
    return POOL.data[POOL.starts[index] : POOL.starts[index + 1]].tobytes()


WHOLE = st.integers(0, POOL.known.size - 1).map(lambda index: (_frame(index), bool(POOL.known[index])))
# Bytes that look like the beginning of a frame more often than chance would have it.
NOISE = st.lists(st.sampled_from((0xFD, 0xFE, 0, 1, 0x20, 0xFF)) | st.integers(0, 255), max_size=20).map(bytes)


@st.composite
def _broken(draw: st.DrawFn) -> bytes:
    frame = bytearray(_frame(draw(st.integers(0, POOL.known.size - 1))))
    for _ in range(draw(st.integers(0, 3))):
        frame[draw(st.integers(0, len(frame) - 1))] = draw(st.integers(0, 255))
    start = draw(st.integers(0, min(12, len(frame))))
    return bytes(frame[start : draw(st.integers(start, len(frame)))])


@st.composite
def streams(draw: st.DrawFn) -> Stream:
    """Whole frames, broken ones and noise in any order."""
    data = b""
    placed, known = [], []
    for part in draw(st.lists(WHOLE | _broken() | NOISE, min_size=1, max_size=12)):
        if isinstance(part, tuple):
            placed.append((len(data), len(part[0])))
            known.append(part[1])
            data += part[0]
        else:
            data += part
    return Stream(
        np.frombuffer(data, np.uint8), np.array(placed, np.int64).reshape(-1, 2), np.array(known, bool), np.empty(0)
    )


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(stream=streams(), cuts=st.lists(st.integers(0, 3000), max_size=6))
def test_whatever_comes_is_framed_recorded_and_rebuilt(stream: Stream, cuts: list[int], tmp_path: Path) -> None:
    inside = sorted(cut for cut in cuts if cut < stream.data.size)
    if stream.data.size:
        judge(stream, inside, tmp_path / "fuzz.mcap", DIALECT)


@pytest.mark.parametrize("seed", [1, 2])
def test_thousands_of_whole_and_broken_frames(seed: int, tmp_path: Path) -> None:
    stream = mutated_stream(POOL, 5000, seed)
    cuts = np.sort(np.random.default_rng(seed).integers(0, stream.data.size, 100)).tolist()
    verdict = judge(stream, cuts, tmp_path / "fuzz.mcap", DIALECT)
    assert verdict.found + verdict.unknown + verdict.overlapped >= verdict.placed > 2500
    assert verdict.lost_by_peer > 1000


def test_a_frame_that_is_not_found_is_noticed() -> None:
    sender = Sender(seed=5)
    frames = [sender.send("ATTITUDE").frame for _ in range(3)]
    data = np.frombuffer(b"\xfe\xff".join(frames), np.uint8)
    places = [data.tobytes().index(frame) for frame in frames]
    placed = np.array([(place, len(frame)) for place, frame in zip(places, frames, strict=True)])
    stream = Stream(data, placed, np.ones(3, bool), np.empty(0))
    found = scan(data, DIALECT, final=True)
    assert missing(stream, found).size == 0
    fewer = {name: getattr(found, name)[[0, 2]] for name in ("offset", "length", "msgid", "message", "kind")}
    assert missing(stream, dataclasses.replace(found, **fewer)).tolist() == [1]
    # pymavlink trusts the false header in front and loses what its length covers.
    assert peer_frames(data) < {(int(start), int(size)) for start, size in placed}
