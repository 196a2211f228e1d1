"""Compiled loops of the reader: records of a file or chunk, columns of one message type, and the wire as it was."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink.crc import Int, crc_accumulate, crc_step
from gcs.mavlink.framing import MAGIC_V1, MAGIC_V2, SIGNATURE_LENGTH, SIGNED
from gcs.mavlink.payload import copy_8, get, get_4, put
from gcs.recording.build import FORM_EXPLICIT, FORM_V1, RUN_EXPLICIT
from sim_vehicle.jit import jit, jit_arrays

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

# Columns of a channel's row for `rebuild`.
MESSAGE_ID, SYSTEM, COMPONENT, SEED, BASE, WIRE, RUN_COUNT, RUNS = range(8)
#: Runs of bytes between wire and CDR, and bytes of payload, that a MAVLink message can have at most.
LARGEST_RUN_COUNT = 8
LARGEST_PAYLOAD = 255
ROW_WIDTH = RUNS + 3 * LARGEST_RUN_COUNT

_MESSAGE = 5
_DATA_END = 15
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _CHUNK, _MESSAGE_INDEX, _ATTACHMENT, _METADATA = 1, 2, 3, 4, 6, 7, 9, 12
_ZSTD = 0x6474737A
_LZ4 = 0x347A6C


@jit
def walk_records(data: Bytes, start: Int, stop: Int, places: Ints, n: Int) -> tuple[Int, Int]:
    """Note (opcode, content offset, content length) of records from `start` on.

    Returns the number of rows in use, and where the walk ended: at `stop`, at a record that cannot be one, or
    at the first record that does not fit any more into `places`.
    """
    p = start
    while p + 9 <= stop and n < places.shape[0]:
        opcode = np.int64(data[p])
        length = get(data, p + 1, 8)
        if opcode == 0 or (_DATA_END < opcode < 128) or length < 0 or length > stop - p - 9:
            break
        places[n, 0], places[n, 1], places[n, 2] = opcode, p + 9, length
        n += 1
        p += 9 + length
    return n, p


@jit
def _chunk_length(data: Bytes, p: Int, stop: Int) -> Int:
    """Length that the chunk record at `p` has by the lengths inside it; -1 if there is no chunk's head."""
    q = p + 9
    if q + 40 > stop:
        return -1
    name = get_4(data, q + 28)
    if name == 4:
        named = q + 44 <= stop and get_4(data, q + 32) == _ZSTD
    elif name == 3:
        named = q + 43 <= stop and get_4(data, q + 32) & 0xFFFFFF == _LZ4
    else:
        named = name == 0
    if not named:
        return -1
    stored = get(data, q + 32 + name, 8)
    if stored < 0 or stored > stop:
        return -1
    return 40 + name + stored


@jit
def next_chunk_head(data: Bytes, start: Int, stop: Int, largest: Int) -> Int:
    """The first place from `start` on where a chunk's record may begin that ends before `stop`; -1 if there is none.

    Only the lengths in the chunk's own head are looked at; largest: bytes that it may hold uncompressed.
    """
    for p in range(start, stop - 49):
        # Bytes of the name's length that are zero in every chunk: most places end here.
        if data[p + 38] | data[p + 39] | data[p + 40] or data[p + 37] > 4:
            continue
        length = _chunk_length(data, p, stop)
        if length < 0 or p + 9 + length > stop:
            continue
        size = get(data, p + 25, 8)
        stored = length - 40 - np.int64(data[p + 37])
        if 0 < size <= largest and stored > 0 and (data[p + 37] != 0 or stored == size):
            return p
    return -1


@jit
def _fits(data: Bytes, opcode: Int, q: Int, length: Int) -> bool:
    """Whether the lengths inside a record of the data section, content at `q`, agree with the record's own."""
    if opcode == _CHUNK:
        return _chunk_length(data, q - 9, q + length) == length
    if opcode == _MESSAGE_INDEX:
        return bool(length >= 6 and get_4(data, q + 2) == length - 6)
    if opcode == _DATA_END:
        return length == 4
    if opcode == _FOOTER:
        return length == 20
    if opcode > _DATA_END:
        return _chunk_length(data, q - 9, q + length) != length
    at: Int = 0
    texts = 2
    if opcode == _SCHEMA:
        at, texts = 2, 3
    elif opcode == _CHANNEL:
        at, texts = 4, 3
    elif opcode == _ATTACHMENT:
        at = 16
    elif opcode == _MESSAGE:
        return bool(length >= 22)
    elif opcode != _HEADER and opcode != _METADATA:
        return False
    for _ in range(texts):
        if at + 4 > length:
            return False
        at += 4 + get_4(data, q + at)
    if opcode == _ATTACHMENT:
        return bool(at + 12 <= length and get(data, q + at, 8) == length - at - 12)
    return bool(at <= length)


@jit
def first_unfit(data: Bytes, places: Ints) -> Int:
    """Number of records in front of the first that cannot be one of the data section; all if there is none.

    places: as `walk_records` fills them. What follows the end of the data is not looked at.
    """
    n: Int = 0
    while n < len(places) and _fits(data, places[n, 0], places[n, 1], places[n, 2]):
        if places[n, 0] == _DATA_END:
            return len(places)
        n += 1
    return n


@jit
def list_messages(data: Bytes, start: Int, stop: Int, rows: Ints, n: Int) -> Int:
    """Note (channel, sequence, log time, publish time, data offset, data length) of every message record."""
    p = start
    while p + 9 <= stop:
        length = get_4(data, p + 1) | get_4(data, p + 5) << 32
        if length < 0 or length > stop - p - 9:
            break
        if data[p] == _MESSAGE and length >= 22:
            rows[n, 0] = np.int64(data[p + 9]) | np.int64(data[p + 10]) << 8
            rows[n, 1] = get_4(data, p + 11)
            rows[n, 2] = get_4(data, p + 15) | get_4(data, p + 19) << 32
            rows[n, 3] = get_4(data, p + 23) | get_4(data, p + 27) << 32
            rows[n, 4] = p + 31
            rows[n, 5] = length - 22
            n += 1
        p += 9 + length
    return n


@jit
def gather(data: Bytes, rows: Ints, picked: Ints, size: Int, bodies: Bytes, heads: Ints) -> None:
    """Copy the messages rows[picked] into columns.

    bodies: the CDR bodies behind one another, `size` bytes each, zero-extended. heads: (3, N) sequence, log time and
    publish time.
    """
    for i in range(picked.size):
        row = picked[i]
        heads[0, i], heads[1, i], heads[2, i] = rows[row, 1], rows[row, 2], rows[row, 3]
        at = rows[row, 4] + 4
        have = min(rows[row, 5] - 4, size)
        to = i * size
        k = 0
        if at + have + 8 <= data.size and to + have + 8 <= bodies.size:
            # Writes up to 7 bytes into the next body, which comes next.
            while k < have:
                copy_8(data, at + k, bodies, to + k)
                k += 8
            k = max(have, 0)
        while k < have:
            bodies[to + k] = data[at + k]
            k += 1
        while k < size:
            bodies[to + k] = 0
            k += 1


@jit
def hash_bodies(bodies: Bytes, size: Int, counters: Ints, keys: NDArray[np.uint64]) -> None:
    """A 64-bit FNV-1a hash of each body and its 8-bit counter."""
    for i in range(keys.size):
        value = np.uint64(14695981039346656037)
        value = (value ^ np.uint64(counters[i] & 0xFF)) * np.uint64(1099511628211)
        for k in range(size):
            value = (value ^ np.uint64(bodies[i * size + k])) * np.uint64(1099511628211)
        keys[i] = value


@jit
def keep_first(keys: NDArray[np.uint64], links: Ints, times: Ints, order: Ints, window: Int, keep: Bytes) -> None:
    """Clear `keep` where the same message came over another link at most `window` ns before.

    order: positions sorted by key and then time.
    """
    kept = -1
    for n in range(order.size):
        i = order[n]
        same = kept >= 0 and keys[kept] == keys[i] and times[i] - times[kept] <= window
        if same and links[kept] != links[i]:
            keep[i] = 0
        else:
            kept = i


@jit_arrays
def _frame(
    data: Bytes,
    body: Int,
    available: Int,
    counter: Int,
    row: Ints,
    form: Int,
    explicit: Bytes,
    at: Int,
    out: Bytes,
    p: Int,
    crc_tables: NDArray[np.uint16],
) -> Int:
    """Write one frame at out[p:]; its length."""
    start = p
    payload = np.zeros(255, np.uint8)
    for run in range(row[RUN_COUNT]):
        wire, cdr, length = row[RUNS + 3 * run], row[RUNS + 3 * run + 1], row[RUNS + 3 * run + 2]
        for k in range(min(length, available - cdr)):
            payload[wire + k] = data[body + cdr + k]
    magic: Int = MAGIC_V2
    incompat: Int = 0
    compat: Int = 0
    sent: Int = row[WIRE]
    if form == FORM_EXPLICIT:
        magic = np.int64(explicit[at])
        sent = np.int64(explicit[at + 1])
        incompat = np.int64(explicit[at + 2])
        compat = np.int64(explicit[at + 3])
        at += 4
        for k in range(row[WIRE], sent):
            payload[k] = explicit[at]
            at += 1
    elif form == FORM_V1:
        magic, sent = MAGIC_V1, row[BASE]
    else:
        while sent > 1 and payload[sent - 1] == 0:
            sent -= 1
    out[p] = magic
    out[p + 1] = sent
    if magic == MAGIC_V2:
        out[p + 2] = incompat
        out[p + 3] = compat
        out[p + 4] = counter & 0xFF
        out[p + 5] = row[SYSTEM]
        out[p + 6] = row[COMPONENT]
        put(out, p + 7, row[MESSAGE_ID], 3)
        p += 10
    else:
        out[p + 2] = counter & 0xFF
        out[p + 3] = row[SYSTEM]
        out[p + 4] = row[COMPONENT]
        out[p + 5] = row[MESSAGE_ID]
        p += 6
    for k in range(sent):
        out[p + k] = payload[k]
    p += sent
    crc = crc_step(crc_accumulate(out, start + 1, p, 0xFFFF, crc_tables), row[SEED], crc_tables)
    put(out, p, crc, 2)
    p += 2
    if magic == MAGIC_V2 and incompat & SIGNED:
        for k in range(SIGNATURE_LENGTH):
            out[p + k] = explicit[at + k]
        p += SIGNATURE_LENGTH
    return p - start


@jit
def runs_fit(
    wire_sizes: Ints, form: Bytes, run_frame: Ints, run_kind: Ints, run_length: Ints, run_bytes: Bytes
) -> bool:
    """Whether `rebuild` finds for each frame what its form says, and uses every run.

    wire_sizes: (frames,) payload length that the dialect knows. The lengths of the runs add up to `run_bytes`.
    """
    run = 0
    at: Int = 0
    for i in range(form.size + 1):
        while run < run_frame.size and run_frame[run] == i and run_kind[run] != RUN_EXPLICIT:
            at += run_length[run]
            run += 1
        if i == form.size or form[i] != FORM_EXPLICIT:
            continue
        if run >= run_frame.size or run_frame[run] != i or run_length[run] < 4:
            return False
        needed = 4 + max(np.int64(run_bytes[at + 1]) - wire_sizes[i], 0)
        if run_bytes[at] == MAGIC_V2 and run_bytes[at + 2] & SIGNED:
            needed += SIGNATURE_LENGTH
        if run_length[run] < needed:
            return False
        at += run_length[run]
        run += 1
    return run == run_frame.size


@jit_arrays
def rebuild(
    data: Bytes,
    rows: Ints,
    picked: Ints,
    channel_rows: Ints,
    form: Bytes,
    run_frame: Ints,
    run_kind: Ints,
    run_length: Ints,
    run_time: Ints,
    run_bytes: Bytes,
    start_ns: Int,
    crc_tables: NDArray[np.uint16],
    out: Bytes,
    pieces: Ints,
) -> Int:
    """One link's byte stream of one chunk, as it came.

    picked: the link's messages among `rows`, in file order, one per entry of `form`.
    pieces: (frames + runs, 4) filled with time in ns, offset and length in `out`, kind (-1 a frame of known id,
    else the run's).
    Returns the number of pieces.
    """
    p: Int = 0
    n = 0
    run = 0
    at: Int = 0
    frames = form.size
    for i in range(frames + 1):
        while run < run_frame.size and run_frame[run] == i and run_kind[run] != RUN_EXPLICIT:
            for k in range(run_length[run]):
                out[p + k] = run_bytes[at + k]
            pieces[n, 0], pieces[n, 1], pieces[n, 2] = start_ns + run_time[run], p, run_length[run]
            pieces[n, 3] = run_kind[run]
            p += run_length[run]
            at += run_length[run]
            n += 1
            run += 1
        if i == frames:
            break
        message = rows[picked[i]]
        length = _frame(
            data,
            message[4] + 4,
            message[5] - 4,
            message[1],
            channel_rows[message[0]],
            np.int64(form[i]),
            run_bytes,
            at,
            out,
            p,
            crc_tables,
        )
        if form[i] == FORM_EXPLICIT:
            at += run_length[run]
            run += 1
        pieces[n, 0], pieces[n, 1], pieces[n, 2], pieces[n, 3] = message[2], p, length, -1
        p += length
        n += 1
    return n
