"""The vehicle's voice: one tick of readings and servo outputs as MAVLink 2 frames, as an autopilot sends them."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import Any

os.environ.setdefault("MAVLINK20", "1")

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.flight.sensor_suite import GROUPS, Reading
from sim_vehicle.flight.tick import Tick
from sim_vehicle.mavlink.boot_clock import VehicleClock
from sim_vehicle.mavlink.frame_encoder import Voice
from sim_vehicle.mavlink.message_rates import Rates
from sim_vehicle.vehicle.controls import OUTPUTS, PORTS
from sim_vehicle.vehicle.second_sensors import SECOND_SENSORS

_STANDBY_S = 1.0  # after a restart in flight, before the vehicle says that it is armed
_ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
_MODE = mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
_INT16, _INT32 = 2**15 - 1, 2**31 - 1
_ADC_SLOTS = 58  # length of DEBUG_FLOAT_ARRAY.data
_IMU_FIELDS = 0x1E3F  # accelerometer, gyro, pressures, altitude and temperature are filled; magnetometer is not

_GROUP_OF = {name: group for group, names in GROUPS.items() for name in names}


class Telemetry:
    """Encodes ticks as frames of one component with continuous sequence numbers.

    epoch_us: UTC of the vehicle's boot, us since 1970, sent in SYSTEM_TIME. Stamps count from boot; that of
    SERVO_OUTPUT_RAW has 32 bits and wraps after 71.6 min. Where the clock starts anew, so do the sequence
    numbers and the rates, and the first heartbeats say standby. `latest`: the newest message of each id,
    whether it was due to leave or not.
    """

    def __init__(
        self,
        *,
        epoch_us: int,
        clock: VehicleClock | None = None,
        autopilot: int = 0,
        voice: Voice | None = None,
    ) -> None:
        self.voice = voice or Voice()
        self.clock = clock or VehicleClock()
        self.rates = Rates()
        self.latest: dict[int, Any] = {}
        self.armed = False
        self._link = self.voice.build
        self._epoch_us = epoch_us
        self._autopilot = autopilot
        self._restarts = 0
        self._standby_until = 0.0
        self._now = 0.0

    def frames(self, tick: Tick) -> list[bytes]:
        """Frames of one tick in the order in which they leave."""
        self._now = tick.time_s
        utc_us = self._epoch_us + round((self.clock.boot_s + tick.time_s) * 1e6)
        self.voice.signed_from(utc_us)
        if self.clock.restarts(tick.time_s) > self._restarts:
            self._restart()
        usec = round(self.clock.since_boot(tick.time_s) * 1e6)
        ms = usec // 1000 & 0xFFFFFFFF
        # A change of arming is sent at once, since a recording ends by it.
        armed = tick.armed and tick.time_s + 1e-9 >= self._standby_until
        forced, self.armed = armed != self.armed, armed
        self._heartbeat(utc_us, ms, forced=forced)
        self._sensors(tick.reading, usec, ms)
        self._hud(tick)
        if "gps" in tick.reading.due:
            self._gps(tick.reading.values, usec, ms)
        for port in range(len(PORTS)):
            outputs = [tick.servos.get(OUTPUTS * port + number, 0) for number in range(1, OUTPUTS + 1)]
            if port == 0 or any(outputs):
                self._say(self._link.servo_output_raw_encode(usec & 0xFFFFFFFF, port, *outputs))
        return self.voice.take()

    def _restart(self) -> None:
        self._restarts += 1
        self._standby_until = self._now + _STANDBY_S
        self.voice.restart()
        self.rates.reset()

    def _say(self, message: Any, *, forced: bool = False) -> None:
        number = message.get_msgId()
        self.latest[number] = message
        if self.rates.due(number, self._now, forced=forced):
            self.voice.say(message)

    def _heartbeat(self, utc_us: int, ms: int, *, forced: bool) -> None:
        state = mavlink.MAV_STATE_ACTIVE if self.armed else mavlink.MAV_STATE_STANDBY
        mode = _MODE | (_ARMED if self.armed else 0)
        kind = mavlink.MAV_TYPE_FIXED_WING
        self._say(self._link.heartbeat_encode(kind, self._autopilot, mode, 0, state), forced=forced)
        self._say(self._link.system_time_encode(utc_us, ms), forced=forced)

    def _sensors(self, reading: Reading, usec: int, ms: int) -> None:
        v, link, say = reading.values, self._link, self._say
        if "imu" in reading.due:
            pascal_per_hpa = 100.0
            rates = (v["p"], v["q"], v["r"])
            magnetometer = (0.0, 0.0, 0.0)
            pressures = (v["static_pressure"] / pascal_per_hpa, v["differential_pressure"] / pascal_per_hpa)
            celsius = v["temperature"] - 273.15
            air = (*pressures, v["altitude"], celsius)
            say(link.highres_imu_encode(usec, v["ax"], v["ay"], v["az"], *rates, *magnetometer, *air, _IMU_FIELDS, 0))
        if "attitude" in reading.due:
            say(link.attitude_encode(ms, v["phi"], v["theta"], v["psi"], v["p"], v["q"], v["r"]))
        if "vanes" in reading.due:
            degrees = 57.29577951308232
            say(link.aoa_ssa_encode(usec, v["alpha"] * degrees, v["beta"] * degrees))
        if "air" in reading.due:
            centi_celsius = _whole((v["temperature"] - 273.15) * 100.0, _INT16)
            say(link.airspeed_encode(0, v["airspeed"], centi_celsius, v["differential_pressure"] / 100.0, 0))
        self._named(reading, ms)
        if "engine" in reading.due:
            say(link.rpm_encode(v["rpm"], 0.0))
        if "adc" in reading.due and any(name.startswith("adc") for name in v):
            volts = [v.get(f"adc{index}", 0.0) for index in range(_ADC_SLOTS)]
            say(link.debug_float_array_encode(usec, b"adc", 0, volts))

    def _named(self, reading: Reading, ms: int) -> None:
        """Thrust and second sensors, each with its own group: of one message, so that all leave or none."""
        groups = {"thrust": "engine", **{name: _GROUP_OF[one.of] for name, one in SECOND_SENSORS.items()}}
        names = [name for name, group in groups.items() if name in reading.values and group in reading.due]
        number = mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT
        if not names or not self.rates.due(number, self._now):
            return
        for name in names:
            message = self._link.named_value_float_encode(ms, name.encode(), reading.values[name])
            self.latest[number] = message
            self.voice.say(message)

    def _hud(self, tick: Tick) -> None:
        v = tick.reading.values
        ground_speed = (v["vn"] ** 2 + v["ve"] ** 2) ** 0.5
        heading = round(v["psi"] * 57.29577951308232) % 360
        percent = round(100.0 * min(max(tick.throttle, 0.0), 1.0))
        self._say(self._link.vfr_hud_encode(v["airspeed"], ground_speed, heading, percent, v["altitude"], -v["vd"]))

    def _gps(self, v: Mapping[str, float], usec: int, ms: int) -> None:
        lat, lon = _whole(v["lat"] * 1e7, _INT32), _whole(v["lon"] * 1e7, _INT32)
        altitude_mm = _whole(v["gps_altitude"] * 1000.0, _INT32)
        cm_s = tuple(_whole(v[name] * 100.0, _INT16) for name in ("vn", "ve", "vd"))
        speed = _whole((v["vn"] ** 2 + v["ve"] ** 2) ** 0.5 * 100.0, 0xFFFE)
        course = round(math.degrees(math.atan2(v["ve"], v["vn"])) * 100.0) % 36000
        self._say(self._link.gps_raw_int_encode(usec, 3, lat, lon, altitude_mm, 90, 150, speed, course, 12))
        heading = round(v["psi"] * 5729.577951308232) % 36000
        self._say(self._link.global_position_int_encode(ms, lat, lon, altitude_mm, altitude_mm, *cm_s, heading))
        place = (v["gps_north"], v["gps_east"], -v["gps_altitude"])
        self._say(self._link.local_position_ned_encode(ms, *place, v["vn"], v["ve"], v["vd"]))


def _whole(value: float, largest: int) -> int:
    """The nearest whole number that a field can carry, which stands at its end where a sensor reads beyond."""
    return min(max(round(value), -largest), largest)
