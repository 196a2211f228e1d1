"""Whether a vehicle that is not armed moves all the same, by the speeds that it sends."""

from __future__ import annotations

import numpy as np

from gcs.mavlink.framing import Frames

#: Faster than wind blows through a pitot tube on most fields and than GPS errs.
MOVING_M_S = 8.0
# By message id, where speeds stand in the payload (bytes), their type, and m/s of one: VFR_HUD's airspeed and ground
# speed, GLOBAL_POSITION_INT's vx and vy, GPS_RAW_INT's vel (65535: unknown).
_SPEEDS = {
    74: ((0, "<f4", 1.0), (4, "<f4", 1.0)),
    33: ((20, "<i2", 0.01), (22, "<i2", 0.01)),
    24: ((24, "<u2", 0.01),),
}
_UNKNOWN = 655.35
_FASTEST = 400.0  # what is beyond is no speed of a small aircraft


def fastest(frames: Frames) -> float:
    """The largest speed that one of the frames gives, m/s; 0 where none does."""
    found = 0.0
    for index in np.flatnonzero(np.isin(frames.msgid, list(_SPEEDS))).tolist():
        start, length = int(frames.payload_offset[index]), int(frames.payload_length[index])
        payload = frames.buffer[start : start + length].tobytes().ljust(32, b"\0")  # trailing zeros are not sent
        for offset, kind, unit in _SPEEDS[int(frames.msgid[index])]:
            speed = abs(float(np.frombuffer(payload, kind, 1, offset)[0])) * unit
            if speed < _FASTEST and speed != _UNKNOWN:
                found = max(found, speed)
    return found
