"""Byte streams of whole and broken MAVLink frames, made fast, with a list of the frames that were placed whole.

The whole frames come from pymavlink; a compiled loop breaks and places them, some 20 million bytes per second.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from mavlink_frames import Sender, message_names
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

from sim_vehicle.jit import jit

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

MUTATIONS = (
    "whole",
    "bits flipped",
    "cut",
    "spliced from two",
    "header of another in front",
    "noise of 0xFD and 0xFE in front",
    "false long header in front",
    "wrong length",
    "other id",
    "other flags",
    "inside another's payload",
    "random bytes",
)
WHOLE, FLIPPED, CUT, SPLICED, HEADER, NOISE, LONG, LENGTH, IDENTITY, FLAGS, NESTED, RANDOM = range(len(MUTATIONS))
_LARGEST = 280
_DRAWS = 10


@dataclass(frozen=True)
class Pool:
    """Whole frames behind one another: (N + 1,) starts in `data`, and (N,) whether the dialect knows the id."""

    data: Bytes
    starts: Ints
    known: NDArray[np.bool_]


@dataclass(frozen=True)
class Stream:
    """`data`, the (offset, length) of each frame that was placed whole, whether its id is known, and what was done.

    mutation: (elements,) index in MUTATIONS of each of the stream's elements.
    """

    data: Bytes
    placed: Ints
    known: NDArray[np.bool_]
    mutation: Ints


@functools.lru_cache(maxsize=2)
def frame_pool(seed: int, rounds: int = 4) -> Pool:
    """Every message of the dialect, as MAVLink 2, signed, and as MAVLink 1; a tenth more of ids unknown to it."""
    frames: list[bytes] = []
    known: list[bool] = []
    for turn in range(rounds):
        plain = Sender(system=1 + turn, component=turn, seed=seed * 1000 + turn)
        signed = Sender(system=1 + turn, component=100, seed=seed * 1000 + 100 + turn)
        signed.sign_from_now()
        for name in message_names():
            plain.version = 2
            frames.append(plain.send(name).frame)
            frames.append(signed.send(name).frame)
            plain.version = 1
            if next(m.id for m in mavlink.mavlink_map.values() if m.msgname == name) < 256:
                frames.append(plain.send(name).frame)
    known += [True] * len(frames)
    chooser = np.random.default_rng(seed)
    strange = [_unknown_frame(chooser) for _ in range(len(frames) // 10)]
    frames += strange
    known += [False] * len(strange)
    starts = np.concatenate(([0], np.cumsum([len(frame) for frame in frames])))
    return Pool(np.frombuffer(b"".join(frames), np.uint8), starts, np.array(known))


def _unknown_frame(chooser: np.random.Generator) -> bytes:
    """A frame of an id outside the dialect: MAVLink 1 or 2, any payload, any CRC_EXTRA."""
    payload = chooser.integers(0, 256, int(chooser.integers(1, 200)), np.uint8).tobytes()
    sequence, system, component, seed = chooser.integers(0, 256, 4, np.uint8).tobytes()
    if chooser.random() < 0.3:
        identity = int(chooser.choice([i for i in range(256) if i not in mavlink.mavlink_map]))
        frame = bytes((0xFE, len(payload), sequence, system, component, identity)) + payload
    else:
        identity = int(chooser.integers(60_000, 1 << 24))
        head = bytes((0xFD, len(payload), 0, 0, sequence, system, component)) + identity.to_bytes(3, "little")
        frame = head + payload
    checksum: Any = x25crc(frame[1:])
    checksum.accumulate(bytes((seed,)))
    return frame + int(checksum.crc).to_bytes(2, "little")


@jit
def _put(source: Bytes, start: int, stop: int, out: Bytes, at: int) -> int:
    """Copy source[start:stop] to out[at:]; where it ends there."""
    for k in range(stop - start):
        out[at + k] = source[start + k]
    return at + stop - start


@jit
def _false_header(draws: Ints, out: Bytes, at: int) -> int:
    """A header whose length reaches over what follows, up to the whole of it."""
    two = draws[5] % 2 == 0
    header = 10 if two else 6
    for k in range(header):
        out[at + k] = (draws[6] >> (2 * k)) & 0xFF
    out[at] = 0xFD if two else 0xFE
    out[at + 1] = 64 + draws[7] % 192
    if two:
        out[at + 2] = draws[8] % 2
    return at + header


@jit
def _lay(
    pool: Bytes, starts: Ints, kinds: Ints, draws: Ints, noise: Bytes, out: Bytes, placed: Ints
) -> tuple[int, int]:
    """Lay all elements behind one another; (bytes, frames placed whole). placed: (.., 3) offset, length, pool index."""
    p = 0
    n = 0
    frames = starts.size - 1
    for i in range(kinds.size):
        d = draws[i]
        kind = kinds[i]
        one, other = d[0] % frames, d[1] % frames
        start, stop = starts[one], starts[one + 1]
        size = stop - start
        at = p
        whole = kind in (WHOLE, HEADER, NOISE, LONG, NESTED)
        if kind == HEADER:
            p = _put(pool, starts[other], starts[other] + 1 + d[2] % 12, out, p)
        elif kind == NOISE:
            for _ in range(1 + d[2] % 40):
                value = noise[(d[3] + p) % noise.size]
                out[p] = 0xFC + value % 4 if value < 96 else value
                p += 1
        elif kind == LONG:
            p = _false_header(d, out, p)
        elif kind == NESTED:
            # A frame whose checksum is wrong and whose payload holds a whole one.
            out[p], out[p + 1], out[p + 2], out[p + 3] = 0xFD, min(size, 255), 0, 0
            p += 4
            for k in range(6):
                out[p + k] = pool[start + 4 + k]
            p += 6
        if whole:
            placed[n, 0], placed[n, 1], placed[n, 2] = p, size, one
            n += 1
        if kind == CUT:
            first = d[2] % size
            p = _put(pool, start + first, start + first + 1 + d[3] % (size - first), out, p)
        elif kind == SPLICED:
            p = _put(pool, start, start + 1 + d[2] % size, out, p)
            p = _put(pool, starts[other] + d[3] % (starts[other + 1] - starts[other]), starts[other + 1], out, p)
        elif kind == RANDOM:
            first = d[2] % (noise.size - 300)
            p = _put(noise, first, first + 1 + d[3] % 280, out, p)
        else:
            p = _put(pool, start, stop, out, p)
        if kind == FLIPPED:
            for k in range(1 + d[2] % 4):
                bit = (d[3 + k] % (8 * size)) if k < 4 else 0
                out[at + bit // 8] ^= 1 << (bit % 8)
        elif kind == LENGTH:
            out[at + 1] = d[2] % 256
        elif kind == IDENTITY:
            out[at + (7 if out[at] == 0xFD else 5)] = d[2] % 256
        elif kind == FLAGS:
            out[at + 2] = d[2] % 256
        elif kind == NESTED:
            out[p], out[p + 1] = d[2] % 256, d[3] % 256
            p += 2
    return p, n


def mutated_stream(pool: Pool, elements: int, seed: int, whole_share: float = 0.4) -> Stream:
    """`elements` frames, `whole_share` of them untouched, the others broken in one of the ways of MUTATIONS."""
    chooser = np.random.default_rng(seed)
    kinds = chooser.integers(1, len(MUTATIONS), elements)
    kinds[chooser.random(elements) < whole_share] = WHOLE
    draws = chooser.integers(0, 1 << 31, (elements, _DRAWS))
    noise = chooser.integers(0, 256, 1 << 16, np.uint8)
    out = np.empty(elements * 2 * _LARGEST, np.uint8)
    placed = np.empty((elements, 3), np.int64)
    size, count = _lay(pool.data, pool.starts, kinds, draws, noise, out, placed)
    return Stream(out[:size].copy(), placed[:count, :2], pool.known[placed[:count, 2]], kinds)
