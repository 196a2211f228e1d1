"""How often each telemetry message leaves: the vehicle's defaults, and what a ground station asked for."""

from __future__ import annotations

import os
from collections.abc import Mapping

os.environ.setdefault("MAVLINK20", "1")

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.flight.sensor_suite import RATES_HZ

TICK_S = 0.02
_GPS_S = 1.0 / RATES_HZ["gps"]
OFF = -1.0
LONGEST_S = (2**31 - 1) * 1e-6  # MESSAGE_INTERVAL carries whole us in 32 bits

# The shortest interval at which the vehicle has something new to say, s.
SHORTEST_S: Mapping[int, float] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: TICK_S,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: TICK_S,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 1.0 / RATES_HZ["imu"],
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 1.0 / RATES_HZ["attitude"],
    mavlink.MAVLINK_MSG_ID_AOA_SSA: 1.0 / RATES_HZ["vanes"],
    mavlink.MAVLINK_MSG_ID_AIRSPEED: 1.0 / RATES_HZ["air"],
    mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT: 1.0 / RATES_HZ["engine"],
    mavlink.MAVLINK_MSG_ID_RPM: 1.0 / RATES_HZ["engine"],
    mavlink.MAVLINK_MSG_ID_DEBUG_FLOAT_ARRAY: 1.0 / RATES_HZ["adc"],
    mavlink.MAVLINK_MSG_ID_VFR_HUD: TICK_S,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: _GPS_S,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _GPS_S,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _GPS_S,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: TICK_S,
}
# What leaves less often than it could unless asked for, s.
DEFAULT_S: Mapping[int, float] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 0.1,
}


class Rates:
    """The intervals of one vehicle's messages. A message without one leaves with every sample."""

    def __init__(self) -> None:
        self._interval: dict[int, float] = {}
        self._next: dict[int, float] = {}
        self.reset()

    def reset(self) -> None:
        """Back to the defaults, as after a boot."""
        self._interval = dict(DEFAULT_S)
        self._next = {}

    def set(self, message_id: int, interval_s: float) -> bool:
        """Send a message every `interval_s`, OFF to stop it, 0 for its default; False for one that is not sent.

        An interval shorter than that of the samples behind the message means with every sample; one above LONGEST_S
        counts as that.
        """
        if message_id not in SHORTEST_S:
            return False
        self._next.pop(message_id, None)
        if interval_s == 0.0 and message_id in DEFAULT_S:
            self._interval[message_id] = DEFAULT_S[message_id]
        elif 0.0 <= interval_s <= SHORTEST_S[message_id] + 1e-9:
            self._interval.pop(message_id, None)
        else:
            self._interval[message_id] = min(interval_s, LONGEST_S)
        return True

    def interval(self, message_id: int) -> float | None:
        """The interval in force, s; OFF where stopped, None for a message that the vehicle does not send."""
        if message_id not in SHORTEST_S:
            return None
        return self._interval.get(message_id, SHORTEST_S[message_id])

    def due(self, message_id: int, time_s: float, *, forced: bool = False) -> bool:
        """Whether a message that could leave at flight time `time_s` is to; `forced` also before its time."""
        interval = self._interval.get(message_id)
        if interval is None:
            return True
        if interval < 0.0:
            return forced
        when = self._next.get(message_id, time_s)
        ready = time_s + 1e-6 >= when
        if not (ready or forced):
            return False
        following = when + interval if ready else time_s + interval
        self._next[message_id] = following if following + 1e-6 >= time_s else time_s + interval
        return True
