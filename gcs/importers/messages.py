"""The standard messages that logs are turned into, with the units of the MAVLink definitions.

All arrays are (N,); what is given in SI units or radians here is scaled to the message's units. NaN is "unknown".
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.importers.synthesis import Ints, Series, milliseconds, whole

ARMED_FLAG, CUSTOM_MODE_FLAG = 128, 1
STANDBY, ACTIVE = 3, 4
INFO = 6
TEXT_LENGTH, NAME_LENGTH = 50, 16
UNKNOWN_16 = 65535.0
UNKNOWN_TEMPERATURE = 32767.0
OF_THE_BAROMETER = "that of the barometer's own chip, often 10 to 20 K above the air's: density comes out too low"
ABSOLUTE_ZERO = -273.15  # degC; PX4 says -1000 where it does not know
HEARTBEAT_US = 1_000_000
_LATEST_US = 1 << 62

# Bits of HIGHRES_IMU.fields_updated.
ACCELERATION, ROTATION, MAGNETISM = 0b111, 0b111 << 3, 0b111 << 6
STATIC_PRESSURE, DIFFERENTIAL_PRESSURE, PRESSURE_ALTITUDE, TEMPERATURE = 1 << 9, 1 << 10, 1 << 11, 1 << 12

Values = NDArray[np.float64]

_IMU_FIELDS = (
    *("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro", "xmag", "ymag", "zmag"),
    *("abs_pressure", "diff_pressure", "pressure_alt", "temperature"),
)


def celsius(values: Values) -> Values:
    """Temperatures, NaN where they are none."""
    return np.where(values < ABSOLUTE_ZERO, np.nan, values)


def at_times(time_us: Ints, known_us: Ints, values: Values) -> Values:
    """(N,) what changes slowly and is known, (M,), at `known_us`; NaN where it never is."""
    order = np.argsort(known_us, kind="stable")
    order = order[np.isfinite(values[order])]
    if order.size == 0:
        return np.full(time_us.size, np.nan)
    return np.interp(time_us, known_us[order], values[order])


def highres_imu(time_us: Ints, updated: int, sensor: int, **given: Values) -> Series:
    """HIGHRES_IMU that brings only the fields named in `updated` and `given`; the others are NaN.

    Units of the message: m/s^2, rad/s, gauss, hPa, m, degC.
    """
    fields: dict[str, NDArray[Any]] = {
        name: given.get(name, np.full(time_us.size, np.nan)).astype(np.float32) for name in _IMU_FIELDS
    }
    return Series(
        "HIGHRES_IMU",
        time_us,
        {
            "time_usec": time_us.astype(np.uint64),
            **fields,
            "fields_updated": np.full(time_us.size, updated, np.uint16),
            "id": np.full(time_us.size, sensor, np.uint8),
        },
    )


def attitude(time_us: Ints, roll: Values, pitch: Values, yaw: Values) -> Series:
    """ATTITUDE, rad; rates unknown."""
    unknown = np.full(time_us.size, np.nan, np.float32)
    fields: dict[str, NDArray[Any]] = {
        "time_boot_ms": milliseconds(time_us),
        "roll": roll.astype(np.float32),
        "pitch": pitch.astype(np.float32),
        "yaw": np.asarray((yaw + np.pi) % (2.0 * np.pi) - np.pi, np.float32),
        "rollspeed": unknown,
        "pitchspeed": unknown,
        "yawspeed": unknown,
    }
    return Series("ATTITUDE", time_us, fields)


def airspeed(time_us: Ints, speed: Values, pressure: Values, temperature: Values, healthy: NDArray[np.bool_]) -> Series:
    """AIRSPEED from calibrated airspeed in m/s, Pa and degC."""
    return Series(
        "AIRSPEED",
        time_us,
        {
            "airspeed": speed.astype(np.float32),
            "raw_press": (pressure / 100.0).astype(np.float32),
            "temperature": whole(100.0 * temperature, "int16", UNKNOWN_TEMPERATURE),
            "flags": np.where(healthy, 0, 1).astype(np.uint8),
        },
    )


def static_pressure(time_us: Ints, pressure: Values, temperature: Values, altitude: Values) -> list[Series]:
    """SCALED_PRESSURE, and the same in HIGHRES_IMU, which also holds the altitude; from Pa, degC and m."""
    scaled = Series(
        "SCALED_PRESSURE",
        time_us,
        {
            "time_boot_ms": milliseconds(time_us),
            "press_abs": (pressure / 100.0).astype(np.float32),
            "temperature": whole(100.0 * temperature, "int16", UNKNOWN_TEMPERATURE),
        },
    )
    bits = STATIC_PRESSURE
    bits |= TEMPERATURE if np.isfinite(temperature).any() else 0
    bits |= PRESSURE_ALTITUDE if np.isfinite(altitude).any() else 0
    precise = highres_imu(
        time_us, bits, 0, abs_pressure=pressure / 100.0, temperature=temperature, pressure_alt=altitude
    )
    return [scaled, precise]


def servo_outputs(time_us: Ints, pulses: Sequence[Values], port: int) -> Series:
    """SERVO_OUTPUT_RAW from pulses in us, output 1 first; at most 16."""
    fields: dict[str, NDArray[Any]] = {
        "time_usec": (time_us & 0xFFFFFFFF).astype(np.uint32),
        "port": np.full(time_us.size, port, np.uint8),
    }
    fields |= {f"servo{i + 1}_raw": whole(values, "uint16") for i, values in enumerate(pulses[:16])}
    return Series("SERVO_OUTPUT_RAW", time_us, fields)


def rc_channels(time_us: Ints, pulses: Sequence[Values]) -> Series:
    """RC_CHANNELS from pulses in us, channel 1 first; at most 18."""
    fields: dict[str, NDArray[Any]] = {
        "time_boot_ms": milliseconds(time_us),
        "chancount": np.full(time_us.size, min(len(pulses), 18), np.uint8),
        "rssi": np.full(time_us.size, 255, np.uint8),
    }
    unused = np.full(time_us.size, UNKNOWN_16, np.uint16)
    fields |= {f"chan{i + 1}_raw": unused for i in range(18)}
    fields |= {f"chan{i + 1}_raw": whole(values, "uint16") for i, values in enumerate(pulses[:18])}
    return Series("RC_CHANNELS", time_us, fields)


def gps(
    time_us: Ints,
    *,
    fix: Values,
    latitude: Values,
    longitude: Values,
    altitude: Values,
    speed: Values,
    course: Values,
    hdop: Values,
    vdop: Values,
    satellites: Values,
) -> Series:
    """GPS_RAW_INT from degrees, m, m/s and rad."""
    return Series(
        "GPS_RAW_INT",
        time_us,
        {
            "time_usec": time_us.astype(np.uint64),
            "fix_type": whole(fix, "uint8"),
            "lat": whole(1e7 * latitude, "int32"),
            "lon": whole(1e7 * longitude, "int32"),
            "alt": whole(1e3 * altitude, "int32"),
            "eph": whole(100.0 * hdop, "uint16", UNKNOWN_16),
            "epv": whole(100.0 * vdop, "uint16", UNKNOWN_16),
            "vel": whole(100.0 * speed, "uint16", UNKNOWN_16),
            "cog": whole(np.rint(100.0 * np.degrees(course)) % 36000.0, "uint16", UNKNOWN_16),
            "satellites_visible": whole(satellites, "uint8", 255.0),
        },
    )


def local_position(time_us: Ints, position: Sequence[Values], velocity: Sequence[Values]) -> Series:
    """LOCAL_POSITION_NED, m and m/s."""
    names = ("x", "y", "z", "vx", "vy", "vz")
    values = (*position, *velocity)
    fields = {name: part.astype(np.float32) for name, part in zip(names, values, strict=True)}
    return Series("LOCAL_POSITION_NED", time_us, {"time_boot_ms": milliseconds(time_us), **fields})


def distance(time_us: Ints, reading: Values, low: Values, high: Values, orientation: Values) -> Series:
    """DISTANCE_SENSOR from m; a range of 0 to 0 is unknown."""
    return Series(
        "DISTANCE_SENSOR",
        time_us,
        {
            "time_boot_ms": milliseconds(time_us),
            "current_distance": whole(100.0 * reading, "uint16"),
            "min_distance": whole(100.0 * low, "uint16"),
            "max_distance": whole(100.0 * high, "uint16"),
            "orientation": whole(orientation, "uint8"),
            "covariance": np.full(time_us.size, 255, np.uint8),
        },
    )


def battery(time_us: Ints, voltage: Values, current: Values) -> Series:
    """SYS_STATUS from V and A."""
    return Series(
        "SYS_STATUS",
        time_us,
        {
            "voltage_battery": whole(1e3 * voltage, "uint16", UNKNOWN_16),
            "current_battery": whole(1e2 * current, "int16", -1.0),
            "battery_remaining": np.full(time_us.size, -1, np.int8),
        },
    )


def system_time(time_us: Ints, utc_us: Ints) -> Series:
    """SYSTEM_TIME: UTC of the moments `time_us`."""
    stamp: dict[str, NDArray[Any]] = {"time_boot_ms": milliseconds(time_us)}
    return Series("SYSTEM_TIME", time_us, {"time_unix_usec": utc_us.astype(np.uint64), **stamp})


def _at(changes: Sequence[tuple[int, int]], time_us: Ints) -> Ints:
    """(N,) the last of (time, value) at each time, 0 before the first."""
    if not changes:
        return np.zeros(time_us.size, np.int64)
    ordered = sorted(changes, key=lambda change: change[0])
    places = np.searchsorted([time for time, _ in ordered], time_us, side="right") - 1
    values = np.array([value for _, value in ordered], np.int64)
    return np.where(places >= 0, values[places], 0)


def heartbeats(
    times_us: Ints,
    *,
    vehicle: int,
    autopilot: int,
    armed: Sequence[tuple[int, int]],
    mode: Sequence[tuple[int, int]],
) -> Series:
    """HEARTBEAT once in every second in which the log holds something, and whenever the vehicle is armed or disarmed.

    times_us: (N,) of the log's other messages. armed, mode: (time in us, 0 or 1) and (time in us, custom mode) from
    then on.
    """
    first, last = int(times_us.min()), int(times_us.max())
    regular = first + np.unique((times_us - first) // HEARTBEAT_US) * HEARTBEAT_US
    changes = np.array([time for time, _ in armed if first <= time <= last], np.int64)
    time_us = np.unique(np.concatenate((regular, changes)))
    is_armed = _at(armed, time_us) > 0
    flags = np.where(is_armed, ARMED_FLAG, 0) | (CUSTOM_MODE_FLAG if mode else 0)
    return Series(
        "HEARTBEAT",
        time_us,
        {
            "custom_mode": _at(mode, time_us).astype(np.uint32),
            "type": np.full(time_us.size, vehicle, np.uint8),
            "autopilot": np.full(time_us.size, autopilot, np.uint8),
            "base_mode": flags.astype(np.uint8),
            "system_status": np.where(is_armed, ACTIVE, STANDBY).astype(np.uint8),
            "mavlink_version": np.full(time_us.size, 3, np.uint8),
        },
    )


def _stamps(times: Sequence[int]) -> Ints:
    """Times, of which a damaged one may be beyond what 64 bits hold."""
    return np.array([min(time, _LATEST_US) for time in times], np.int64)


def _letters(texts: Sequence[bytes], length: int) -> NDArray[np.uint8]:
    padded = np.array(texts, dtype=f"S{length}")
    return np.frombuffer(padded.tobytes(), np.uint8).reshape(len(texts), length)


def status_texts(entries: Sequence[tuple[int, int, str]]) -> Series:
    """STATUSTEXT of (time in us, severity, text); one that is too long for a message comes in numbered pieces."""
    times, severities, pieces, numbers, places = [], [], [], [], []
    long_ones = 0
    for time, severity, text in entries:
        data = text.encode()
        parts = [data[at : at + TEXT_LENGTH] for at in range(0, len(data), TEXT_LENGTH)] or [b""]
        long_ones += len(parts) > 1
        for place, part in enumerate(parts[:256]):
            times.append(time)
            severities.append(severity)
            pieces.append(part)
            numbers.append((long_ones - 1) % 65535 + 1 if len(parts) > 1 else 0)
            places.append(place)
    return Series(
        "STATUSTEXT",
        _stamps(times),
        {
            "severity": np.array(severities, np.uint8),
            "text": _letters(pieces, TEXT_LENGTH),
            "id": np.array(numbers, np.uint16),
            "chunk_seq": np.array(places, np.uint8),
        },
    )


def parameters(times: Sequence[int], names: Sequence[str], values: NDArray[np.float32], kinds: Sequence[int]) -> Series:
    """PARAM_VALUE in the order of the log. kinds: MAV_PARAM_TYPE of each."""
    index = {name: number for number, name in enumerate(dict.fromkeys(names))}
    return Series(
        "PARAM_VALUE",
        _stamps(times),
        {
            "param_value": values,
            "param_count": np.full(len(names), len(index), np.uint16),
            "param_index": np.array([index[name] for name in names], np.uint16),
            "param_id": _letters([name.encode() for name in names], NAME_LENGTH),
            "param_type": np.array(kinds, np.uint8),
        },
    )
