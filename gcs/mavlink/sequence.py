"""The 8-bit counter in every frame as a growing number: what is new, late, or there a second time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.jit import jit

Ints = NDArray[np.int64]
Int = int | np.int64

#: Columns of a sender's state: the newest number, -1 before the first, and whether each counter value was heard in
#: the last 256 numbers.
NEWEST, HEARD = 0, 1
STATE = HEARD + 256

#: What a counter value is, besides its number.
NEW, LATE, DUPLICATE = 0, 1, 2
# A value that was heard already comes a second time within this many frames, or else after a long gap.
_REPEATED_WITHIN = 32
# A missing frame arrives delayed by no more than this many; else it is the next ones that came.
_LATE_WITHIN = 200


def sequence_states(count: int) -> Ints:
    """States (count, STATE) of senders not heard yet."""
    states = np.ones((count, STATE), np.int64)
    states[:, NEWEST] = -1
    return states


@jit
def number_of(state: Ints, counter: Int) -> tuple[Int, Int]:
    """The number of a frame by its counter, and whether it is NEW, LATE or a DUPLICATE.

    A value that is missing among the last 200 is late. This distinguishes a long gap from a delayed frame; a fixed
    limit alone would confuse the two.
    """
    newest = state[NEWEST]
    if newest < 0:
        state[NEWEST] = counter
        return counter, NEW
    step = (counter - newest) & 0xFF
    if step == 0:
        return newest, DUPLICATE
    number = newest + step - 256
    behind = 256 - step
    if number >= 0 and behind <= _LATE_WITHIN and state[HEARD + counter] == 0:
        state[HEARD + counter] = 1
        return number, LATE
    if number >= 0 and behind <= _REPEATED_WITHIN:
        return number, DUPLICATE
    for k in range(1, step):
        state[HEARD + ((counter - k) & 0xFF)] = 0
    state[HEARD + counter] = 1
    state[NEWEST] = newest + step
    return newest + step, NEW
