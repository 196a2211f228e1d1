"""The parameters that a ground station can list, and those that it can set: stream rates as ArduPilot names them.

All are sent as MAV_PARAM_TYPE_REAL32, which every ground station reads alike.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass

os.environ.setdefault("MAVLINK20", "1")

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.mavlink.message_rates import OFF, SHORTEST_S, Rates
from sim_vehicle.vehicle.vehicle_file import Vehicle

# MAV_DATA_STREAM -> its parameter, its messages.
STREAMS: Mapping[int, tuple[str, tuple[int, ...]]] = {
    mavlink.MAV_DATA_STREAM_RAW_SENSORS: (
        "SR0_RAW_SENS",
        (
            mavlink.MAVLINK_MSG_ID_HIGHRES_IMU,
            mavlink.MAVLINK_MSG_ID_AIRSPEED,
            mavlink.MAVLINK_MSG_ID_DEBUG_FLOAT_ARRAY,
        ),
    ),
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: ("SR0_EXT_STAT", (mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,)),
    mavlink.MAV_DATA_STREAM_RC_CHANNELS: ("SR0_RC_CHAN", (mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,)),
    mavlink.MAV_DATA_STREAM_POSITION: (
        "SR0_POSITION",
        (mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED),
    ),
    mavlink.MAV_DATA_STREAM_EXTRA1: (
        "SR0_EXTRA1",
        (mavlink.MAVLINK_MSG_ID_ATTITUDE, mavlink.MAVLINK_MSG_ID_AOA_SSA),
    ),
    mavlink.MAV_DATA_STREAM_EXTRA2: ("SR0_EXTRA2", (mavlink.MAVLINK_MSG_ID_VFR_HUD,)),
    mavlink.MAV_DATA_STREAM_EXTRA3: (
        "SR0_EXTRA3",
        (
            mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT,
            mavlink.MAVLINK_MSG_ID_RPM,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        ),
    ),
}
LARGEST_HZ = 50.0


@dataclass(frozen=True)
class Parameter:
    """One entry of the list; `index` is its place in it."""

    name: str
    value: float
    index: int


class Onboard:
    """The parameters of one vehicle: what it is (read only), and its stream rates, Hz, which act on `rates`."""

    def __init__(self, vehicle: Vehicle, system: int, rates: Rates) -> None:
        self._rates = rates
        self._fixed = {
            "SYSID_THISMAV": float(system),
            "SIM_MASS": vehicle.mass.mass,
            "SIM_IXX": vehicle.mass.Ixx,
            "SIM_IYY": vehicle.mass.Iyy,
            "SIM_IZZ": vehicle.mass.Izz,
            "SIM_IXZ": vehicle.mass.Ixz,
            "SIM_WING_AREA": vehicle.geometry.S,
            "SIM_WING_SPAN": vehicle.geometry.b,
            "SIM_WING_CHORD": vehicle.geometry.c,
            "SIM_AIRSPEED": vehicle.flight.airspeed,
            "SIM_ALTITUDE": vehicle.flight.altitude,
        }
        self._streams = {name: stream for stream, (name, _) in STREAMS.items()}
        self._names = (*self._fixed, *self._streams)

    def __len__(self) -> int:
        return len(self._names)

    def get(self, name: str) -> Parameter | None:
        """A parameter by its name, None where there is none."""
        if name in self._fixed:
            return Parameter(name, self._fixed[name], self._names.index(name))
        if name in self._streams:
            return Parameter(name, self._stream_hz(self._streams[name]), self._names.index(name))
        return None

    def all(self) -> list[Parameter]:
        """Every parameter, in order."""
        return [found for name in self._names if (found := self.get(name))]

    def at(self, index: int) -> Parameter | None:
        """A parameter by its place, None where there is none."""
        return self.get(self._names[index]) if 0 <= index < len(self._names) else None

    def set(self, name: str, value: float) -> Parameter | None:
        """Set a stream rate, 0 to LARGEST_HZ; what is read only, or out of range, stays. The parameter as it now is."""
        if name in self._streams and math.isfinite(value) and 0.0 <= value <= LARGEST_HZ:
            self.stream(self._streams[name], value)
        return self.get(name)

    def stream(self, number: int, hz: float) -> None:
        """Send the messages of a MAV_DATA_STREAM at `hz`, 0 to stop them; MAV_DATA_STREAM_ALL means every stream."""
        chosen = STREAMS if number == mavlink.MAV_DATA_STREAM_ALL else {number} & set(STREAMS)
        for stream in chosen:
            for message_id in STREAMS[stream][1]:
                self._rates.set(message_id, 1.0 / hz if hz > 0.0 else OFF)

    def _stream_hz(self, stream: int) -> float:
        """The rate of a stream's first message."""
        interval = self._rates.interval(STREAMS[stream][1][0])
        return 0.0 if interval is None or interval < 0.0 else 1.0 / max(interval, min(SHORTEST_S.values()))
