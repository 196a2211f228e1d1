"""PX4's onboard logs (.ulg), read with pyulog, onto standard messages.

Topics and units: docs.px4.io, "uORB Message Reference".
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gcs.importers import messages as make
from gcs.importers.synthesis import (
    ImportedLog,
    Ints,
    Progress,
    Series,
    utc_offset,
    whole,
    without_strays,
    write_recording,
)
from gcs.importers.ulogfile import Topic, Values, read_ulog

FORMAT = "ulog"
AUTOPILOT = 12  # MAV_AUTOPILOT_PX4
REAL32, INT32 = 9, 6  # MAV_PARAM_TYPE
ARMED = 2  # vehicle_status.arming_state
FIX_3D = 3
LARGEST_SERVO_COUNT = 16
NO_LEVEL = 6
_FORCES, _RATES = ("xacc", "yacc", "zacc"), ("xgyro", "ygyro", "zgyro")
_SENSORS = range(1, 4)  # selected_airspeed_index of a sensor; others are estimates
_SLOWEST_SPEED = 5.0  # m/s, below which the ratio of two airspeeds is mostly noise
_EARLIEST_UTC_US = 946_684_800_000_000  # the year 2000; a receiver without a fix may say 1980


#: Topics that are read, by name; of files whose names end in them.
TOPICS = (
    *("vehicle_status", "vtol_vehicle_status", "actuator_armed", "sensor_combined", "vehicle_acceleration"),
    *("vehicle_angular_velocity", "vehicle_magnetometer", "vehicle_air_data", "differential_pressure", "airspeed"),
    *("airspeed_validated", "vehicle_attitude", "vehicle_gps_position", "sensor_gps", "vehicle_local_position"),
    *("distance_sensor", "rpm", "esc_status", "battery_status", "actuator_outputs", "input_rc"),
)


def import_ulog(source: Path, target: Path, progress: Progress = lambda share: None, name: str = "") -> None:
    """Write a .ulg log as a recording, called `name` there. ImportFileError where there is nothing in it to use."""
    write_recording(mapped(read_ulog(source)), source, target, progress, name)


def mapped(log: Any) -> ImportedLog:
    """A log's topics as standard messages.

    log: as pyulog reads it: data_list (name, multi_id and data, field -> (N,) values), parameters, messages, dropouts.
    """
    return _Mapping(log).log()


class _Mapping:
    """One log on its way to MAVLink."""

    def __init__(self, log: Any) -> None:
        self._file = log
        self._topics: dict[str, dict[int, Topic]] = {}
        for entry in log.data_list:
            if "timestamp" not in entry.data:
                continue  # a damaged definition
            topic = Topic(entry.data)
            if len(topic):
                self._topics.setdefault(entry.name, {})[int(entry.multi_id)] = topic
        self._used: set[tuple[str, int]] = set()
        self._notes: dict[str, str] = {}

    def log(self) -> ImportedLog:
        """All series of the log, and notes of what has no counterpart."""
        series: list[Series] = []
        steps: tuple[Callable[[], list[Series]], ...] = (
            self._parameters,
            self._texts,
            self._imu,
            self._magnetometer,
            self._barometer,
            self._airspeed,
            self._attitude,
            self._gps,
            self._local_position,
            self._range,
            self._rpm,
            self._battery,
            self._servos,
            self._rc,
            self._vtol,
        )
        for step in steps:
            series += step()
        status = self._topic("vehicle_status", "arming_state") or self._topic("vehicle_status")
        series, strays = without_strays(series)
        if any(entry.time_us.size for entry in series):
            series.append(self._heartbeats(series, status))
        rest = sorted((name, number) for name, group in self._topics.items() for number in group)
        names = [f"{name}[{number}]" if number else name for name, number in rest if (name, number) not in self._used]
        missed_ms = sum(dropout.duration for dropout in self._file.dropouts)
        notes = {
            **self._notes,
            "not_mapped": " ".join(names),
            "damaged": "yes, part of the log cannot be read" if self._file.file_corruption else "no",
            "odd_stamps": str(strays),
            "dropouts": f"{len(self._file.dropouts)}, {missed_ms} ms in all",
            **({} if self._armed() is not None else {"armed": "not in the log; HEARTBEAT says disarmed"}),
        }
        return ImportedLog(FORMAT, self._system(status), series, self._utc_offset(), notes)

    def _topic(self, name: str, *fields: str, number: int = 0) -> Topic | None:
        """That instance of a topic, else the lowest, if the log has it with these fields."""
        group = self._topics.get(name)
        if not group:
            return None
        number = number if number in group else min(group)
        if any(field not in group[number] for field in fields):
            return None
        self._used.add((name, number))
        return group[number]

    def _system(self, status: Topic | None) -> int:
        given = self._file.initial_parameters.get("MAV_SYS_ID")
        if given is None and status is not None and "system_id" in status:
            given = status.values("system_id")[0]
        known = isinstance(given, int | float) and 1 <= given <= 255
        return int(given) if known else 1

    def _parameters(self) -> list[Series]:
        start = int(self._file.start_timestamp)
        entries = [(start, name, value) for name, value in self._file.initial_parameters.items()]
        entries += [(int(time), name, value) for time, name, value in self._file.changed_parameters]
        entries = [entry for entry in entries if isinstance(entry[2], int | float)]
        # PX4 sends the bytes of a whole number in place of the float.
        values = [
            np.array([value]).astype(np.int32).view(np.float32)[0] if isinstance(value, int) else np.float32(value)
            for _, _, value in entries
        ]
        kinds = [INT32 if isinstance(value, int) else REAL32 for _, _, value in entries]
        times, names = [time for time, _, _ in entries], [name for _, name, _ in entries]
        return [make.parameters(times, names, np.array(values, np.float32), kinds)] if entries else []

    def _texts(self) -> list[Series]:
        entries = []
        for message in self._file.logged_messages:
            level = int(message.log_level) - ord("0")
            severity = level if 0 <= level <= 7 else NO_LEVEL
            entries.append((int(message.timestamp), severity, str(message.message)))
        return [make.status_texts(entries)] if entries else []

    def _imu(self) -> list[Series]:
        topic = self._topic("sensor_combined", "gyro_rad[0]", "accelerometer_m_s2[0]")
        if topic is not None:
            given = dict(zip(_FORCES, topic.vector("accelerometer_m_s2", 3), strict=True))
            given |= dict(zip(_RATES, topic.vector("gyro_rad", 3), strict=True))
            return [make.highres_imu(topic.time_us, make.ACCELERATION | make.ROTATION, 0, **given)]
        # Logs without it have what its filters made of the same sensors.
        series = []
        for name, bits, fields in (
            ("vehicle_acceleration", make.ACCELERATION, _FORCES), ("vehicle_angular_velocity", make.ROTATION, _RATES),
        ):  # fmt: skip
            topic = self._topic(name, "xyz[0]")
            if topic is not None:
                given = dict(zip(fields, topic.vector("xyz", 3), strict=True))
                series.append(make.highres_imu(topic.time_us, bits, 0, **given))
        return series

    def _magnetometer(self) -> list[Series]:
        topic = self._topic("vehicle_magnetometer", "magnetometer_ga[0]")
        if topic is None:
            return []
        given = dict(zip(("xmag", "ymag", "zmag"), topic.vector("magnetometer_ga", 3), strict=True))
        return [make.highres_imu(topic.time_us, make.MAGNETISM, 0, **given)]

    def _barometer(self) -> list[Series]:
        topic = self._topic("vehicle_air_data", "baro_pressure_pa")
        if topic is None:
            return []
        temperature = self._air_temperature(topic.time_us)
        own = make.celsius(topic.values("baro_temp_celcius"))
        if not np.isfinite(temperature).any() and np.isfinite(own).any():
            temperature = own
            self._notes["temperature"] = make.OF_THE_BAROMETER
        pressure, altitude = topic.values("baro_pressure_pa"), topic.values("baro_alt_meter")
        return make.static_pressure(topic.time_us, pressure, temperature, altitude)

    def _air_temperature(self, time_us: Ints) -> Values:
        """(N,) degC outside the aircraft at these times, as far as a sensor measures it; else NaN."""
        for name, field in (
            ("airspeed", "air_temperature_celsius"),
            ("vehicle_air_data", "ambient_temperature"),
            ("differential_pressure", "temperature"),
        ):
            topic = self._topic(name, field)
            if topic is None:
                continue
            if "temperature_source" in topic:
                topic = topic.only(topic.values("temperature_source") > 0.0)  # 0: a standard day's, not measured
            known = make.celsius(topic.values(field))
            if np.isfinite(known).any():
                return make.at_times(time_us, topic.time_us, known)
        return np.full(time_us.size, np.nan)

    def _airspeed(self) -> list[Series]:
        pressure = self._topic("differential_pressure")
        series = []
        if pressure is not None:
            reading = pressure.values("differential_pressure_raw_pa", "differential_pressure_pa")
            bits = make.DIFFERENTIAL_PRESSURE
            series.append(make.highres_imu(pressure.time_us, bits, 0, diff_pressure=reading / 100.0))
        times, speed = self._calibrated_airspeed()
        if times.size:
            unknown, healthy = np.full(times.size, np.nan), np.ones(times.size, bool)
            series.append(make.airspeed(times, speed, unknown, self._air_temperature(times), healthy))
        return series

    def _calibrated_airspeed(self) -> tuple[Ints, Values]:
        """Times in us and airspeed in m/s, from the validated topic or the sensor's own, whichever is denser.

        The sensor's is indicated; the median ratio of both in the validated topic makes it calibrated.
        """
        source, times, speed, ratio = self._validated_airspeed()
        raw = self._topic("airspeed", "indicated_airspeed_m_s", number=source - 1)
        if raw is None:
            return times, speed
        indicated = raw.values("indicated_airspeed_m_s")
        known = np.isfinite(indicated)
        if times.size and times.size >= np.count_nonzero(known):
            return times, speed
        if not np.isfinite(ratio):
            self._notes["airspeed"] = "indicated: the log does not calibrate it"
            return raw.time_us[known], indicated[known]
        self._notes["airspeed"] = (
            f"indicated, times {ratio:.4f}, the median calibrated / indicated of airspeed_validated"
        )
        return raw.time_us[known], ratio * indicated[known]

    def _validated_airspeed(self) -> tuple[int, Ints, Values, float]:
        """Of the samples from a sensor: its number from 1, times in us, m/s calibrated, median calibrated/indicated."""
        topic = self._topic("airspeed_validated")
        if topic is None:
            return 1, np.empty(0, np.int64), np.empty(0), np.nan
        sources = topic.values("airspeed_source", "selected_airspeed_index")
        speed = topic.values("calibrated_airspeed_m_s", "equivalent_airspeed_m_s", "indicated_airspeed_m_s")
        keep = np.isin(sources, _SENSORS) & np.isfinite(speed)
        topic, sources, speed = topic.only(keep), sources[keep], speed[keep]
        indicated = topic.values("indicated_airspeed_m_s")
        fast = (indicated > _SLOWEST_SPEED) & (speed > _SLOWEST_SPEED)
        ratio = float(np.median(speed[fast] / indicated[fast])) if fast.any() else np.nan
        source = int(np.bincount(sources.astype(np.int64)).argmax()) if sources.size else 1
        return source, topic.time_us, speed, ratio

    def _attitude(self) -> list[Series]:
        topic = self._topic("vehicle_attitude", "q[0]")
        if topic is None:
            return []
        w, x, y, z = topic.vector("q", 4)
        roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
        yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        return [make.attitude(topic.time_us, roll, pitch, yaw)]

    def _gps_topic(self) -> Topic | None:
        return self._topic("vehicle_gps_position") or self._topic("sensor_gps")

    def _gps(self) -> list[Series]:
        topic = self._gps_topic()
        if topic is None:
            return []
        newer = "latitude_deg" in topic
        fixes = make.gps(
            topic.time_us,
            fix=topic.values("fix_type"),
            latitude=topic.values("latitude_deg") if newer else 1e-7 * topic.values("lat"),
            longitude=topic.values("longitude_deg") if newer else 1e-7 * topic.values("lon"),
            altitude=topic.values("altitude_msl_m") if newer else 1e-3 * topic.values("alt"),
            speed=topic.values("vel_m_s"),
            course=topic.values("cog_rad"),
            hdop=topic.values("hdop"),
            vdop=topic.values("vdop"),
            satellites=topic.values("satellites_used"),
        )
        times, utc = self._gps_time()
        return [fixes, make.system_time(times, utc)]

    def _gps_time(self) -> tuple[Ints, Ints]:
        """Times in us at which the GPS knew UTC, and that UTC in us."""
        topic = self._gps_topic()
        if topic is None or "time_utc_usec" not in topic:
            return np.empty(0, np.int64), np.empty(0, np.int64)
        utc = whole(topic.values("time_utc_usec"), "int64")
        known = (topic.values("fix_type") >= FIX_3D) & (utc > _EARLIEST_UTC_US)
        return topic.time_us[known], utc[known]

    def _utc_offset(self) -> int | None:
        return utc_offset(*self._gps_time())

    def _local_position(self) -> list[Series]:
        names = ("x", "y", "z", "vx", "vy", "vz")
        topic = self._topic("vehicle_local_position", *names)
        if topic is None:
            return []
        values = [topic.values(name) for name in names]
        return [make.local_position(topic.time_us, values[:3], values[3:])]

    def _range(self) -> list[Series]:
        topic = self._topic("distance_sensor", "current_distance", "orientation")
        if topic is None:
            return []
        low, high = topic.values("min_distance"), topic.values("max_distance")
        return [make.distance(topic.time_us, topic.values("current_distance"), low, high, topic.values("orientation"))]

    def _rpm(self) -> list[Series]:
        topic = self._topic("rpm") or self._topic("esc_status", "esc[0].esc_rpm")
        if topic is None:
            return []
        speed = topic.values("rpm_estimate", "indicated_frequency_rpm", "esc[0].esc_rpm")
        return [Series("RPM", topic.time_us, {"rpm1": speed.astype(np.float32)})]

    def _battery(self) -> list[Series]:
        topic = self._topic("battery_status", "voltage_v", "current_a")
        return (
            [] if topic is None else [make.battery(topic.time_us, topic.values("voltage_v"), topic.values("current_a"))]
        )

    def _servos(self) -> list[Series]:
        series = []
        for number, topic in self._topics.get("actuator_outputs", {}).items():
            self._used.add(("actuator_outputs", number))
            in_use = topic.values("noutputs")
            pulses = [
                np.where(in_use > i, values, 0.0)
                for i, values in enumerate(topic.vector("output", LARGEST_SERVO_COUNT))
            ]
            series.append(make.servo_outputs(topic.time_us, pulses, number))
        return series

    def _rc(self) -> list[Series]:
        topic = self._topic("input_rc", "values[0]", "channel_count")
        if topic is None:
            return []
        count = int(np.nanmax(topic.values("channel_count")))
        return [make.rc_channels(topic.time_us, topic.vector("values", min(count, 18)))]

    def _armed(self) -> list[tuple[int, int]] | None:
        """(time in us, 1 or 0) from then on, changes only; None where the log does not say."""
        for name, field, armed in (("vehicle_status", "arming_state", ARMED), ("actuator_armed", "armed", 1)):
            topic = self._topic(name, field)
            if topic is None:
                continue
            states = (topic.values(field) == armed).astype(np.int64)
            changes = np.diff(states, prepend=-1) != 0
            return list(zip(topic.time_us[changes].tolist(), states[changes].tolist(), strict=True))
        return None

    def _vtol(self) -> list[Series]:
        """Whether it hovers, is in transition or flies on its wing: numbers are MAV_VTOL_STATE's."""
        topic = self._topic("vtol_vehicle_status")
        if topic is None:
            return []
        if "vehicle_vtol_state" in topic:
            state = topic.values("vehicle_vtol_state")
        elif "vtol_in_rw_mode" in topic and "vtol_in_trans_mode" in topic:
            hovers, changes = topic.values("vtol_in_rw_mode") > 0.0, topic.values("vtol_in_trans_mode") > 0.0
            state = np.where(changes, 1.0, np.where(hovers, 3.0, 4.0))
        else:
            return []
        return [Series("EXTENDED_SYS_STATE", topic.time_us, {"vtol_state": whole(state, "uint8")})]

    def _heartbeats(self, series: list[Series], status: Topic | None) -> Series:
        times = np.concatenate([entry.time_us for entry in series])
        kind = status.values("system_type") if status is not None and "system_type" in status else np.zeros(1)
        return make.heartbeats(
            times,
            vehicle=int(whole(kind[-1:], "uint8")[0]),
            autopilot=AUTOPILOT,
            armed=self._armed() or [],
            mode=[],
        )


__all__ = ["import_ulog"]
