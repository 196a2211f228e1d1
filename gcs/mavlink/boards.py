"""Which autopilot board it is: AUTOPILOT_VERSION carries a number that no other board has. Kept is a hash of it."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common

from gcs.mavlink.frameparts import AUTOPILOT
from gcs.mavlink.framing import Frames

#: AUTOPILOT_VERSION's number, by which it is asked for too.
AUTOPILOT_VERSION = common.MAVLINK_MSG_ID_AUTOPILOT_VERSION
# In the order of the wire (mavlink.io/en/guide/serialization.html): the 64-bit number, and the longer one behind all.
_UID, _UID2, _WHOLE = slice(8, 16), slice(60, 78), 78


def board_of(uid: bytes, uid2: bytes) -> str | None:
    """A name for the board of these numbers, the longer one first; None where both are zero: it does not say."""
    number = next((one for one in (uid2, uid) if any(one)), None)
    return None if number is None else hashlib.sha256(b"autopilot board " + number).hexdigest()[:16]


def boards(frames: Frames) -> dict[int, str]:
    """By system the boards that autopilots among the senders say they are."""
    said = np.flatnonzero(frames.msgid == AUTOPILOT_VERSION)
    found = {}
    for i in said.tolist():
        if frames.compid[i] != AUTOPILOT or frames.message[i] < 0:
            continue
        start = int(frames.payload_offset[i])
        sent = frames.buffer[start : start + int(frames.payload_length[i])].tobytes()
        whole = sent.ljust(_WHOLE, b"\0")  # MAVLink 2 does not send trailing zeros
        if board := board_of(whole[_UID], whole[_UID2]):
            found[int(frames.sysid[i])] = board
    return found


def version_request(system: int) -> Any:
    """pymavlink's command that asks a vehicle for its AUTOPILOT_VERSION."""
    return common.MAVLink_command_long_message(
        system, AUTOPILOT, common.MAV_CMD_REQUEST_MESSAGE, 0, AUTOPILOT_VERSION, 0, 0, 0, 0, 0, 0
    )
