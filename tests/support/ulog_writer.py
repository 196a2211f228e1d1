"""A writer of PX4's onboard log format, and a log made with it."""

import struct

import numpy as np

BOOT_US = 30_000_000
UTC_US = 1_717_243_200_000_000
TYPES = {"uint64_t": "Q", "float": "f", "uint8_t": "B", "int32_t": "i", "uint32_t": "I", "double": "d", "bool": "?"}


class UlogWriter:
    """Builds the bytes of a log (docs.px4.io, "ULog File Format"); topics have fields without padding."""

    def __init__(self) -> None:
        self.definitions = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", BOOT_US)
        self.data = b""
        self._topics: dict[str, tuple[int, str]] = {}

    @staticmethod
    def _message(kind: str, content: bytes) -> bytes:
        return struct.pack("<HB", len(content), ord(kind)) + content

    def parameter(self, name: str, value: float) -> None:
        key = f"{'int32_t' if isinstance(value, int) else 'float'} {name}".encode()
        packed = struct.pack("<i" if isinstance(value, int) else "<f", value)
        self.definitions += self._message("P", bytes((len(key),)) + key + packed)

    def change(self, name: str, value: int, after_us: int) -> None:
        """A whole parameter set in flight, so long after the start: behind the last sample that is not later."""
        key = f"int32_t {name}".encode()
        change = self._message("P", bytes((len(key),)) + key + struct.pack("<i", value))
        place = 0
        at = len(self.data)
        while place < len(self.data):
            length, kind = struct.unpack_from("<HB", self.data, place)
            if kind == ord("D") and struct.unpack_from("<Q", self.data, place + 5)[0] > BOOT_US + after_us:
                at = place
                break
            place += 3 + length
        self.data = self.data[:at] + change + self.data[at:]

    def topic(self, name: str, *fields: str, instances: int = 1) -> None:
        """Fields as "float x" or "float[3] q"; the stamp comes first by itself."""
        declared = ("uint64_t timestamp", *fields)
        text = f"{name}:" + "".join(f"{field};" for field in declared)
        self.definitions += self._message("F", text.encode())
        code = ""
        for field in declared:
            kind, _, count = field.split()[0].partition("[")
            code += TYPES[kind] * int(count.rstrip("]") or 1)
        for instance in range(instances):
            number = len(self._topics)
            self._topics[f"{name}{instance}"] = (number, code)
            self.data += self._message("A", struct.pack("<BH", instance, number) + name.encode())

    def add(self, name: str, time_us: int, *values: float, instance: int = 0) -> None:
        number, code = self._topics[f"{name}{instance}"]
        self.data += self._message("D", struct.pack("<H", number) + struct.pack(f"<{code}", time_us, *values))

    def text(self, level: int, time_us: int, text: str) -> None:
        self.data += self._message("L", struct.pack("<BQ", ord("0") + level, time_us) + text.encode())

    def bytes(self) -> bytes:
        return self.definitions + self.data


def a_log() -> UlogWriter:
    """Four seconds of a plane that yaws, IMU at 100 Hz, airspeed at 20 Hz."""
    log = UlogWriter()
    log.parameter("MAV_SYS_ID", 9)
    log.parameter("FW_AIRSPD_TRIM", 15.5)
    log.topic("sensor_combined", "float[3] gyro_rad", "float[3] accelerometer_m_s2")
    log.topic("vehicle_attitude", "float[4] q")
    log.topic("airspeed", "float indicated_airspeed_m_s", "float true_airspeed_m_s", "float air_temperature_celsius")
    log.topic("differential_pressure", "float differential_pressure_pa", "float temperature")
    log.topic("vehicle_air_data", "float baro_alt_meter", "float baro_temp_celcius", "float baro_pressure_pa")
    log.topic("actuator_outputs", "uint32_t noutputs", "float[16] output", instances=2)
    log.topic(
        "vehicle_gps_position",
        *("uint64_t time_utc_usec", "int32_t lat", "int32_t lon", "int32_t alt", "float hdop", "float vdop"),
        *("float vel_m_s", "float cog_rad", "uint8_t fix_type", "uint8_t satellites_used"),
    )
    log.topic("vehicle_local_position", "float x", "float y", "float z", "float vx", "float vy", "float vz")
    log.topic("vehicle_status", "uint8_t arming_state", "uint8_t system_type", "uint8_t system_id")
    log.topic("cpuload", "float load")
    log.text(4, BOOT_US + 500_000, "[commander] Arming denied")
    for i in range(400):
        now, t = BOOT_US + 10_000 * i, 0.01 * i
        log.add("sensor_combined", now, 0.1, -0.2 * t, 0.3, 1.0, 2.0, -9.8)
        if i % 5 == 0:
            yaw = 0.5 * t
            log.add("vehicle_attitude", now, np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2))
            log.add("airspeed", now + 1, 14.0 + t, 15.0 + t, 20.0)
            log.add("differential_pressure", now + 2, 120.0, 20.0)
            log.add("vehicle_air_data", now + 3, 101.5, 18.25, 100_125.0)
            log.add("actuator_outputs", now + 4, 4, *(1100.0 + i, 1200.0, 1300.0, 1400.0), *[77.0] * 12)
            log.add("actuator_outputs", now + 4, 1, *[1900.0] * 16, instance=1)
            log.add("vehicle_local_position", now + 5, 1.0, 2.0, -30.0, 0.5, 0.25, -0.125)
        if i % 20 == 0:
            utc = UTC_US + 10_000 * i
            place = (453_000_000, -1_228_000_000, 85_000, 0.8, 1.1)
            log.add("vehicle_gps_position", now, utc, *place, 12.5, -np.pi / 2, 3, 14)
            log.add("vehicle_status", now, 2 if 100 <= i < 300 else 1, 1, 9)
            log.add("cpuload", now, 0.5)
    return log
