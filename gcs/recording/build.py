"""Compiled loops of the writer: frames in a byte buffer become MCAP message records, without decoding anything.

The record layout is that of the MCAP specification (mcap.dev/spec, "Message (op=0x05)" and "Message Index (op=0x07)").
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink.crc import Int
from gcs.mavlink.dialect import (
    BASE_LENGTH,
    CDR_SIZE,
    STAMP_OFFSET,
    STAMP_SCALE,
    STAMP_SIZE,
    WIRE_SIZE,
)
from gcs.mavlink.framing import MAGIC_V2, SIGNATURE_LENGTH, UNKNOWN
from gcs.mavlink.payload import copy_payload, get_4, put, put_8
from gcs.mavlink.sequence import number_of
from sim_vehicle.jit import jit, jit_arrays, jit_inlined

#: Bytes of a message record in front of the CDR body: opcode, length, channel, sequence, two times, CDR header.
RECORD_HEADER = 9 + 22 + 4

# Places in the chunk's state array.
OUT_POS, INDEX_COUNT, LAST_LOG, CHUNK_START, PERIOD, BUFFER_POS, FRAME, MESSAGE_BYTES = range(8)
CHUNK_STATE = 8

# Places in a link's state array.
FORM_COUNT, RUN_COUNT_, RUN_BYTES, RAW_BYTES, UNKNOWN_FRAMES, STREAM_BYTES = range(6)
LINK_STATE = 6

# Columns of a channel's state.
LAST_STAMP, STAMP_EPOCH, LAST_SEEN, MESSAGE_COUNT = range(4)

# What stopped the loop.
DONE, CHUNK_FULL, CHANNEL_NEEDED = range(3)

# How a frame went over the wire, and what a run of bytes is (documented in gcs.recording.wire).
FORM_V2, FORM_V1, FORM_EXPLICIT = range(3)
# In place of a component's number or a channel: has none, and gets none; its frames are kept as bytes.
KEPT_AS_BYTES = -2
RUN_NOISE, RUN_UNKNOWN, RUN_EXPLICIT = range(3)

_WRAP = 1 << 32
_WRAP_TOLERANCE_NS = 60_000_000_000

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


@jit
def publish_time(out: Bytes, body: Int, table: Ints, m: Int, channel_state: Ints, channel: Int, log: Int) -> Int:
    """The message's own stamp in ns, 32-bit ones unwrapped, or the log time where it has none.

    A 32-bit stamp that steps back has wrapped if the step, taken forward, agrees with the time that went by; else
    the vehicle was restarted and counts anew.
    """
    if table[m, STAMP_OFFSET] < 0:
        return log
    at = body + table[m, STAMP_OFFSET]
    stamp = get_4(out, at)
    if table[m, STAMP_SIZE] == 8:
        stamp |= get_4(out, at + 4) << 32
    scale = table[m, STAMP_SCALE]
    if table[m, STAMP_SIZE] == 8:
        return log if stamp < 0 or stamp > np.int64(9_000_000_000_000_000_000) // scale else stamp * scale
    if channel_state[channel, MESSAGE_COUNT] > 0 and stamp < channel_state[channel, LAST_STAMP]:
        forward = (stamp + _WRAP - channel_state[channel, LAST_STAMP]) * scale
        if forward <= log - channel_state[channel, LAST_SEEN] + _WRAP_TOLERANCE_NS:
            channel_state[channel, STAMP_EPOCH] += _WRAP
        elif (channel_state[channel, LAST_STAMP] - stamp) * scale > _WRAP_TOLERANCE_NS:
            channel_state[channel, STAMP_EPOCH] = 0
    channel_state[channel, LAST_STAMP] = stamp
    channel_state[channel, LAST_SEEN] = log
    return np.int64((stamp + channel_state[channel, STAMP_EPOCH]) * scale)


@jit
def add_run(
    frame: Int, kind: Int, time: Int, data: Bytes, start: Int, stop: Int, runs: Ints, run_bytes: Bytes, link: Ints
) -> None:
    """Note bytes that no CDR message holds; the caller has made sure that there is room."""
    n = link[RUN_COUNT_]
    runs[n, 0], runs[n, 1], runs[n, 2], runs[n, 3] = frame, kind, stop - start, time
    at = link[RUN_BYTES]
    for k in range(stop - start):
        run_bytes[at + k] = data[start + k]
    link[RUN_COUNT_] = n + 1
    link[RUN_BYTES] = at + stop - start


@jit
def note_explicit(
    buffer: Bytes,
    at: Int,
    header: Int,
    length: Int,
    sent: Int,
    since: Int,
    table: Ints,
    m: Int,
    form: Bytes,
    runs: Ints,
    run_bytes: Bytes,
    link: Ints,
) -> None:
    """Note what neither the CDR message nor one of the two usual forms says about a frame."""
    number = link[FORM_COUNT]
    link[FORM_COUNT] = number + 1
    form[number] = FORM_EXPLICIT
    start = link[RUN_BYTES]
    add_run(number, RUN_EXPLICIT, since, buffer, at, at + 4, runs, run_bytes, link)
    if header == 6:
        run_bytes[start + 2] = 0
        run_bytes[start + 3] = 0
    tail = at + header + min(sent, table[m, WIRE_SIZE])
    extra = link[RUN_BYTES]
    for k in range(at + header + sent - tail):
        run_bytes[extra + k] = buffer[tail + k]
    extra += at + header + sent - tail
    signature = at + header + sent + 2
    if at + length > signature:
        for k in range(SIGNATURE_LENGTH):
            run_bytes[extra + k] = buffer[signature + k]
        extra += SIGNATURE_LENGTH
    runs[link[RUN_COUNT_] - 1, 2] = extra - start
    link[RUN_BYTES] = extra


@jit
def note_noise(
    buffer: Bytes, at: Int, end: Int, since: Int, runs: Ints, run_bytes: Bytes, chunk: Ints, link: Ints
) -> None:
    """Note bytes that belong to no frame, as many as there is room for."""
    stop = min(end, at + run_bytes.size - link[RUN_BYTES])
    add_run(link[FORM_COUNT], RUN_NOISE, since, buffer, at, stop, runs, run_bytes, link)
    link[RAW_BYTES] += stop - at
    link[STREAM_BYTES] += stop - at
    chunk[BUFFER_POS] = stop


@jit_inlined
def write_message(
    buffer: Bytes,
    at: Int,
    log: Int,
    channel: Int,
    number: Int,
    table: Ints,
    m: Int,
    channel_state: Ints,
    out: Bytes,
    index: Ints,
    chunk: Ints,
) -> None:
    """Append the record of the frame at buffer[at] and its index entry; the caller has made sure that there is room."""
    p = chunk[OUT_POS]
    body = p + RECORD_HEADER
    payload = at + (10 if buffer[at] == MAGIC_V2 else 6)
    copy_payload(buffer, payload, np.int64(buffer[at + 1]), table, m, out, body)
    published = publish_time(out, body, table, m, channel_state, channel, log)
    channel_state[channel, MESSAGE_COUNT] += 1
    out[p] = 5
    put_8(out, p + 1, RECORD_HEADER - 9 + table[m, CDR_SIZE])
    # Channel and sequence; the byte behind each run of eight is written again by the next.
    put_8(out, p + 9, channel | number << 16)
    put_8(out, p + 15, log)
    put_8(out, p + 23, published)
    out[p + 31] = 0
    out[p + 32] = 1
    out[p + 33] = 0
    out[p + 34] = 0
    entry = chunk[INDEX_COUNT]
    index[entry, 0], index[entry, 1], index[entry, 2] = channel, log, p
    chunk[INDEX_COUNT] = entry + 1
    chunk[OUT_POS] = body + table[m, CDR_SIZE]
    chunk[MESSAGE_BYTES] += table[m, CDR_SIZE] + 4


@jit_inlined
def note_form(
    buffer: Bytes,
    at: Int,
    length: Int,
    since: Int,
    table: Ints,
    m: Int,
    form: Bytes,
    runs: Ints,
    run_bytes: Bytes,
    link: Ints,
) -> None:
    """Note how the frame at buffer[at] went over the wire: in one of the two usual forms, or in every detail."""
    sent = np.int64(buffer[at + 1])
    v2 = buffer[at] == MAGIC_V2
    usual = v2 and buffer[at + 2] == 0 and buffer[at + 3] == 0 and 1 <= sent <= table[m, WIRE_SIZE]
    if usual and (sent == 1 or buffer[at + 9 + sent] != 0):
        form[link[FORM_COUNT]] = FORM_V2
        link[FORM_COUNT] += 1
    elif not v2 and sent == table[m, BASE_LENGTH]:
        form[link[FORM_COUNT]] = FORM_V1
        link[FORM_COUNT] += 1
    else:
        note_explicit(buffer, at, 10 if v2 else 6, length, sent, since, table, m, form, runs, run_bytes, link)


@jit
def build(
    buffer: Bytes,
    stop: Int,
    offset: Ints,
    length: NDArray[np.int32],
    message: NDArray[np.int16],
    kind: Bytes,
    times: Ints,
    table: Ints,
    channels: NDArray[np.int32],
    component_of: NDArray[np.int32],
    sequences: Ints,
    channel_state: Ints,
    out: Bytes,
    index: Ints,
    form: Bytes,
    runs: Ints,
    run_bytes: Bytes,
    chunk: Ints,
    link: Ints,
) -> Int:
    """Append frames from chunk[FRAME] on, and the bytes between them, to the chunk and to the link's account.

    times: (1,) one time of reception for all, or (frames + 1,), the last for bytes behind the last frame; UTC, ns.
    Returns DONE, CHUNK_FULL (close the chunk and call again) or CHANNEL_NEEDED (for frame chunk[FRAME]).
    """
    n = offset.size
    while True:
        i = chunk[FRAME]
        log = max(times[i] if times.size > 1 else times[0], chunk[LAST_LOG])
        since = log - chunk[CHUNK_START] if chunk[CHUNK_START] >= 0 else 0
        at = chunk[BUFFER_POS]
        end = offset[i] if i < n else stop
        if chunk[CHUNK_START] >= 0 and since >= chunk[PERIOD]:
            return CHUNK_FULL
        if i == n and at == end:
            return DONE
        if link[RUN_COUNT_] + 2 > runs.shape[0] or link[RUN_BYTES] + 1024 > run_bytes.size:
            return CHUNK_FULL
        if at < end:
            note_noise(buffer, at, end, since, runs, run_bytes, chunk, link)
        else:
            component, channel, m = np.int64(KEPT_AS_BYTES), np.int64(KEPT_AS_BYTES), np.int64(message[i])
            identity = at + (4 if buffer[at] == MAGIC_V2 else 2)
            if kind[i] != UNKNOWN:
                component = component_of[np.int64(buffer[identity + 1]) << 8 | np.int64(buffer[identity + 2])]
                if component >= 0:
                    channel = np.int64(channels[component, m])
                if component == -1 or (component >= 0 and channel == -1):
                    return CHANNEL_NEEDED
            if channel == KEPT_AS_BYTES:
                add_run(link[FORM_COUNT], RUN_UNKNOWN, since, buffer, at, at + length[i], runs, run_bytes, link)
                link[UNKNOWN_FRAMES] += 1
            else:
                needed = chunk[OUT_POS] + RECORD_HEADER + table[m, CDR_SIZE]
                if needed > out.size or chunk[INDEX_COUNT] == index.shape[0] or link[FORM_COUNT] == form.size:
                    return CHUNK_FULL
                number, _ = number_of(sequences[component], np.int64(buffer[identity]))
                write_message(buffer, at, log, channel, number, table, m, channel_state, out, index, chunk)
                note_form(buffer, at, length[i], since, table, m, form, runs, run_bytes, link)
            link[STREAM_BYTES] += length[i]
            chunk[BUFFER_POS] = at + length[i]
            chunk[FRAME] = i + 1
        chunk[LAST_LOG] = log
        if chunk[CHUNK_START] < 0:
            chunk[CHUNK_START] = log


@jit_arrays
def index_records(index: Ints, entries: Int, channel_count: Int, starts: Ints, out: Bytes) -> Int:
    """Message index records of a chunk, one per channel in use, into `out`; returns their total length.

    starts: (channel_count,) filled with each record's place in `out`, -1 for channels not in the chunk.
    """
    counts = np.zeros(channel_count, np.int64)
    for i in range(entries):
        counts[index[i, 0]] += 1
    p = 0
    fill = np.zeros(channel_count, np.int64)
    for channel in range(channel_count):
        starts[channel] = -1
        if counts[channel] == 0:
            continue
        starts[channel] = p
        out[p] = 7
        put(out, p + 1, 6 + 16 * counts[channel], 8)
        put(out, p + 9, channel, 2)
        put(out, p + 11, 16 * counts[channel], 4)
        fill[channel] = p + 15
        p += 15 + 16 * counts[channel]
    for i in range(entries):
        at = fill[index[i, 0]]
        put_8(out, at, index[i, 1])
        put_8(out, at + 8, index[i, 2])
        fill[index[i, 0]] = at + 16
    return p
