"""The compiled pass over frames that keeps, per sender, each second's quickest message and the last round trips."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink.crc import Int
from gcs.mavlink.frame_counts import MOST_SENDERS
from gcs.mavlink.framing import MAGIC_V2
from sim_vehicle.jit import jit

KEPT = 600  # seconds, and round trips
FRESH_WIDTH = 2
SECOND_NS = 1_000_000_000
RESET_NS = 2 * SECOND_NS  # datagrams that overtake one another make a stamp go back by less
LEAP_NS, FASTEST = (
    10 * SECOND_NS,
    100,
)  # a stamp is not ahead of one before by more than this and so many times the pace
# That many in a row, for that long, must agree that the clock was set or restarted: a held-up link may bring messages
# out of order all at once.
RESET_MESSAGES, RESET_LASTS_NS = 3, SECOND_NS // 5
SMALLEST_EPOCH_NS = 500_000_000 * SECOND_NS  # stamps beyond count from 1970
WRAP_NS = (1 << 32) * 1_000_000
# A request of this station has these last digits in ts1: whole microseconds, and the station's system number.
TAG_NS, TAG_PERIOD_NS = 255, 1000
LONGEST_NS = 10 * SECOND_NS  # a reply that takes longer is of no use
# What is read of a message: nothing, a stamp in ms since boot (32 bits), in us (64 bits), or a TIMESYNC reply.
NOTHING, STAMP_MS, STAMP_US, REPLY = range(4)

# Columns of the state of a sender. AT: reception of the first message of the second under way. LAST, LAST_AT: newest
# stamp and its reception. TRANSIT: reception less stamp of the message before. ODD: messages in a row whose stamp
# cannot be of this clock, ODD_AT reception of the first and ODD_STAMP the last of them. TO_SAVE: 1 where the record is
# about to start anew, 2 once it has been saved.
SENDER, COUNT, AT, LAST, LAST_AT, TRANSIT, JITTER, WRAPS, ODD, ODD_AT, ODD_STAMP, RESETS, TRIPS, LAST_ASKED, TO_SAVE = (
    range(15)
)
STATE_WIDTH = 15
SAVE, SAVED = 1, 2

Ints = NDArray[np.int64]


@jit
def _read(buffer: NDArray[np.uint8], payload: Int, length: Int, at: Int, size: int) -> Int:
    """Little-endian number of a payload whose trailing zeros were not sent."""
    value: Int = np.int64(0)
    for k in range(size):
        if at + k < length:
            value |= np.int64(buffer[payload + at + k]) << (8 * k)
    return value


@jit
def _follows(stamp: Int, last: Int, passed: Int) -> bool:
    """Whether a stamp can be of the clock that showed `last` so long ago."""
    return bool(last - stamp <= RESET_NS and stamp - last <= LEAP_NS + FASTEST * max(passed, 0))


@jit
def _is_of_this_clock(state: Ints, received: Int, stamp: Int) -> bool:
    """False for a stray stamp. Where several in a row agree on another clock, the record starts anew with it."""
    if state[COUNT] == 0 or _follows(stamp, state[LAST], received - state[LAST_AT]):
        state[ODD] = 0
        return True
    agrees = state[ODD] > 0 and _follows(stamp, state[ODD_STAMP], 0)
    state[ODD] = state[ODD] + 1 if agrees else 1
    state[ODD_STAMP] = stamp
    if state[ODD] == 1:
        state[ODD_AT] = received
    if state[ODD] < RESET_MESSAGES or received - state[ODD_AT] < RESET_LASTS_NS:
        return False
    if state[TO_SAVE] != SAVED:
        state[TO_SAVE] = SAVE
        state[ODD] -= 1
        return False
    state[RESETS] += 1
    state[TO_SAVE] = state[ODD] = state[COUNT] = state[TRIPS] = state[LAST] = state[WRAPS] = state[JITTER] = 0
    return True


@jit
def _take_stamp(state: Ints, seconds: Ints, received: Int, stamp: Int) -> None:
    if not _is_of_this_clock(state, received, stamp):
        return
    if stamp >= state[LAST]:
        state[LAST], state[LAST_AT] = stamp, received
    transit = received - stamp
    if state[COUNT] > 0:
        state[JITTER] += (abs(transit - state[TRANSIT]) - state[JITTER]) // 16
    state[TRANSIT] = transit
    if state[COUNT] > 0 and received < state[AT] - RESET_NS:
        state[COUNT] = state[TRIPS] = 0  # the receiver's own clock was set back
    place = (state[COUNT] - 1) % KEPT
    if state[COUNT] == 0 or received - state[AT] >= SECOND_NS:
        state[COUNT] += 1
        state[AT] = received
        place = (state[COUNT] - 1) % KEPT
    elif transit >= seconds[place, 0] - seconds[place, 1]:
        return
    seconds[place, 0] = received
    seconds[place, 1] = stamp


@jit
def _reading(buffer: NDArray[np.uint8], at: Int, what: Int, where: Int, received: Int) -> tuple[Int, Int]:
    """The stamp in the frame at buffer[at] and, of a reply, when it was asked for, ns; stamp 0 where none counts."""
    payload, length = at + (10 if buffer[at] == MAGIC_V2 else 6), np.int64(buffer[at + 1])
    none = np.int64(0)
    if what == STAMP_MS:
        return _read(buffer, payload, length, where, 4) * 1_000_000, none
    if what != REPLY:
        stamp = _read(buffer, payload, length, where, 8)
        return stamp * 1000 if 0 <= stamp <= SMALLEST_EPOCH_NS // 1000 else none, none
    stamp, asked = _read(buffer, payload, length, 0, 8), _read(buffer, payload, length, 8, 8)
    counts = asked % TAG_PERIOD_NS == TAG_NS and 0 <= received - asked < LONGEST_NS
    return stamp if counts else none, asked


@jit
def take_stamps(
    buffer: NDArray[np.uint8],
    offset: Ints,
    message: NDArray[np.int16],
    received: Ints,
    wanted: Ints,
    row_of: NDArray[np.int32],
    state: Ints,
    seconds: Ints,
    trips: Ints,
    rows: Int,
    start: Int,
) -> tuple[Int, Int]:
    """Take frames from `start` on; (rows in use, the frame to go on with, or the number of frames when all are taken).

    It stops where there is no row left, and where a record is to be saved before it starts anew. Of senders beyond
    MOST_SENDERS nothing is kept.

    wanted: (messages, 2) what to read of each message and where. row_of: (65536,) row + 1 of a sender. state:
    (R, STATE_WIDTH). seconds: (R, KEPT, 2) reception and stamp. trips: (R, KEPT, 3) reception, tc1 and ts1. All ns.
    """
    for i in range(start, offset.size):
        if message[i] < 0 or wanted[message[i], 0] == NOTHING:
            continue
        at = offset[i]
        second = buffer[at] == MAGIC_V2
        sender = np.int64(buffer[at + (5 if second else 3)]) << 8 | np.int64(buffer[at + (6 if second else 4)])
        what = wanted[message[i], 0]
        stamp, asked = _reading(buffer, at, what, wanted[message[i], 1], received[i])
        if stamp == 0:
            continue
        row = row_of[sender] - 1
        if row < 0:
            if rows == MOST_SENDERS:
                continue
            if rows == state.shape[0]:
                return rows, i
            row = rows
            rows += 1
            row_of[sender] = row + 1
            state[row, SENDER] = sender
        if what == REPLY:
            if asked > state[row, LAST_ASKED]:  # the same reply may come twice
                place = state[row, TRIPS] % KEPT
                trips[row, place, 0], trips[row, place, 1], trips[row, place, 2] = received[i], stamp, asked
                state[row, TRIPS] += 1
                state[row, LAST_ASKED] = asked
            continue
        if what == STAMP_MS:
            stamp += state[row, WRAPS] * WRAP_NS
            if state[row, COUNT] > 0 and state[row, LAST] - stamp > WRAP_NS // 2:
                state[row, WRAPS] += 1
                stamp += WRAP_NS
        _take_stamp(state[row], seconds[row], received[i], stamp)
        if state[row, TO_SAVE] == SAVE:
            return rows, i
    return rows, offset.size
