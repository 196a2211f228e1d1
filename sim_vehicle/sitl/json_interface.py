"""ArduPilot's JSON interface of SITL: servo frames in, one line of JSON out.

Source: ArduPilot, libraries/SITL/examples/JSON/readme.md. SITL sends a frame of servo outputs, waits for the answer,
and goes on by the time that the answer says, so that both stay in step whatever the clock does.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass

import numpy as np

from sim_vehicle.sitl.physics import Motion

# Magic number -> number of outputs.
_OUTPUTS = {18458: 16, 29569: 32}
_HEAD = struct.Struct("<HHI")


@dataclass(frozen=True)
class ServoFrame:
    """Pulse widths, us, of outputs 1, 2, ... (0 for none yet). rate_hz: steps a second that SITL asks for."""

    rate_hz: int
    number: int
    pwm: tuple[int, ...]


def read_frame(datagram: bytes) -> ServoFrame | None:
    """A frame of SITL; None for a datagram that is none."""
    if len(datagram) < _HEAD.size:
        return None
    magic, rate, number = _HEAD.unpack_from(datagram)
    count = _OUTPUTS.get(magic, 0)
    if not count or len(datagram) != _HEAD.size + 2 * count or rate == 0:
        return None
    return ServoFrame(rate, number, struct.unpack_from(f"<{count}H", datagram, _HEAD.size))


def answer(motion: Motion, wind_ned: tuple[float, float, float]) -> bytes:
    """The line that SITL reads; its parser wants no spaces between key and value."""

    def numbers(values: object) -> list[float]:
        return [round(float(one), 9) for one in np.asarray(values)]

    fields = {
        "timestamp": round(motion.time_s, 9),
        "imu": {"gyro": numbers(motion.rates), "accel_body": numbers(motion.specific_force)},
        "position": numbers(motion.position),
        "quaternion": numbers(motion.attitude),
        "velocity": numbers(motion.velocity),
        "velocity_wind": numbers(wind_ned),
    }
    return b"\n" + json.dumps(fields, separators=(",", ":")).encode() + b"\n"
