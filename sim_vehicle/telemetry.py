"""The vehicle's voice: one tick of readings and servo outputs as MAVLink 2 frames, as an autopilot sends them."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass

os.environ.setdefault("MAVLINK20", "1")

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.sensors import Reading

SYSTEM, COMPONENT = 1, 1
BOOT_S = 12.0  # s the autopilot has been running when the flight's first sample is taken
_ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
_MODE = mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
_ADC_SLOTS = 58  # length of DEBUG_FLOAT_ARRAY.data
_IMU_FIELDS = 0x1E3F  # accelerometer, gyro, pressures, altitude and temperature are filled; magnetometer is not


@dataclass(frozen=True)
class Tick:
    """One control tick: what was read at `time_s` (s since the flight's first sample), and what then went to
    the servos.

    servos: output number -> pulse width, us. throttle: 0 to 1.
    """

    time_s: float
    reading: Reading
    servos: Mapping[int, int]
    throttle: float
    armed: bool


class _Collector:
    """The file-like object that pymavlink writes whole frames to."""

    def __init__(self) -> None:
        self.frames: list[bytes] = []

    def write(self, frame: bytes) -> None:
        self.frames.append(bytes(frame))


class Telemetry:
    """Encodes ticks as frames of one component with continuous sequence numbers.

    epoch_us: UTC of the vehicle's boot, us since 1970, told by SYSTEM_TIME. Stamps count from boot; that of
    SERVO_OUTPUT_RAW has 32 bits and wraps after 71.6 min.
    """

    def __init__(self, *, epoch_us: int, boot_s: float = BOOT_S, autopilot: int = 0) -> None:
        self._out = _Collector()
        self._link = mavlink.MAVLink(self._out, srcSystem=SYSTEM, srcComponent=COMPONENT)
        self._epoch_us = epoch_us
        self._boot_s = boot_s
        self._autopilot = autopilot
        self._next_slow = 0.0
        self._next_hud = 0.0
        self._armed = False

    def frames(self, tick: Tick) -> list[bytes]:
        """Frames of one tick in the order in which they leave."""
        usec = round((self._boot_s + tick.time_s) * 1e6)
        ms = usec // 1000 & 0xFFFFFFFF
        due = tick.time_s + 1e-6
        # A change of arming is told at once, since a recording ends by it.
        if due >= self._next_slow or tick.armed != self._armed:
            self._heartbeat(tick.armed, usec, ms)
            self._next_slow = tick.time_s + 1.0 if due < self._next_slow else self._next_slow + 1.0
            self._armed = tick.armed
        self._sensors(tick.reading, usec, ms)
        if due >= self._next_hud:
            self._hud(tick)
            self._next_hud += 0.1
        if "gps" in tick.reading.due:
            self._gps(tick.reading.values, usec, ms)
        outputs = [tick.servos.get(number, 0) for number in range(1, 17)]
        self._link.servo_output_raw_send(usec & 0xFFFFFFFF, 0, *outputs)
        frames, self._out.frames = self._out.frames, []
        return frames

    def _heartbeat(self, armed: bool, usec: int, ms: int) -> None:
        state = mavlink.MAV_STATE_ACTIVE if armed else mavlink.MAV_STATE_STANDBY
        mode = _MODE | (_ARMED if armed else 0)
        self._link.heartbeat_send(mavlink.MAV_TYPE_FIXED_WING, self._autopilot, mode, 0, state)
        self._link.system_time_send(self._epoch_us + usec, ms)

    def _sensors(self, reading: Reading, usec: int, ms: int) -> None:
        v, link = reading.values, self._link
        if "imu" in reading.due:
            pascal_per_hpa = 100.0
            rates = (v["p"], v["q"], v["r"])
            magnetometer = (0.0, 0.0, 0.0)
            pressures = (v["static_pressure"] / pascal_per_hpa, v["differential_pressure"] / pascal_per_hpa)
            celsius = v["temperature"] - 273.15
            air = (*pressures, v["altitude"], celsius)
            link.highres_imu_send(usec, v["ax"], v["ay"], v["az"], *rates, *magnetometer, *air, _IMU_FIELDS, 0)
        if "attitude" in reading.due:
            link.attitude_send(ms, v["phi"], v["theta"], v["psi"], v["p"], v["q"], v["r"])
        if "vanes" in reading.due:
            degrees = 57.29577951308232
            link.aoa_ssa_send(usec, v["alpha"] * degrees, v["beta"] * degrees)
        if "air" in reading.due:
            centi_celsius = round((v["temperature"] - 273.15) * 100.0)
            link.airspeed_send(0, v["airspeed"], centi_celsius, v["differential_pressure"] / 100.0, 0)
        if "engine" in reading.due:
            link.named_value_float_send(ms, b"thrust", v["thrust"])
            link.rpm_send(v["rpm"], 0.0)
        if "adc" in reading.due and any(name.startswith("adc") for name in v):
            volts = [v.get(f"adc{index}", 0.0) for index in range(_ADC_SLOTS)]
            link.debug_float_array_send(usec, b"adc", 0, volts)

    def _hud(self, tick: Tick) -> None:
        v = tick.reading.values
        ground_speed = (v["vn"] ** 2 + v["ve"] ** 2) ** 0.5
        heading = round(v["psi"] * 57.29577951308232) % 360
        percent = round(100.0 * min(max(tick.throttle, 0.0), 1.0))
        self._link.vfr_hud_send(v["airspeed"], ground_speed, heading, percent, v["altitude"], -v["vd"])

    def _gps(self, v: Mapping[str, float], usec: int, ms: int) -> None:
        lat, lon = round(v["lat"] * 1e7), round(v["lon"] * 1e7)
        altitude_mm = round(v["gps_altitude"] * 1000.0)
        cm_s = tuple(round(v[name] * 100.0) for name in ("vn", "ve", "vd"))
        speed = round((v["vn"] ** 2 + v["ve"] ** 2) ** 0.5 * 100.0)
        course = round(math.degrees(math.atan2(v["ve"], v["vn"])) * 100.0) % 36000
        self._link.gps_raw_int_send(usec, 3, lat, lon, altitude_mm, 90, 150, speed, course, 12)
        heading = round(v["psi"] * 5729.577951308232) % 36000
        self._link.global_position_int_send(ms, lat, lon, altitude_mm, altitude_mm, *cm_s, heading)
        place = (v["gps_north"], v["gps_east"], -v["gps_altitude"])
        self._link.local_position_ned_send(ms, *place, v["vn"], v["ve"], v["vd"])
