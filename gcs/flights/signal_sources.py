"""Which MAVLink field is which signal: the table, as data. A new sensor begins here (CONTRIBUTING.md).

The first source of a row that comes fast enough through the flight counts. Field names are in lower case, as the
recording keeps them; "data[3]" is an element of an array. Numbers that MAVLink defines as "unknown" become NaN.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_vehicle.constants import STANDARD_GRAVITY
from sim_vehicle.vehicle.controls import OUTPUTS, PORTS
from sim_vehicle.vehicle.second_sensors import SECOND_SENSORS

Array = NDArray[np.float64]

ZERO_CELSIUS = 273.15  # K
SURFACE_RATE_HZ = 20.0
GPS_RATE_HZ = 1.0
BATTERY_RATE_HZ = 0.5
UINT16_NONE = 65535.0
CELLS = 10  # whose voltages BATTERY_STATUS has
INT16_NONE = 32767.0  # of temperatures that a sender does not know, as AIRSPEED's definition has it
LOOKS_DOWN = 25.0  # MAV_SENSOR_ROTATION_PITCH_270
FIX_2D = 2.0  # GPS_FIX_TYPE_2D_FIX
ADC_CHANNELS = 16

# Messages that may come from several instances of one component, distinguished by this field; the lowest one counts.
INSTANCE_FIELDS = {
    "HIGHRES_IMU": "id",
    "RAW_IMU": "id",
    "AIRSPEED": "id",
    "BATTERY_STATUS": "id",
}

# Bits of HIGHRES_IMU.fields_updated: a field whose bit is off repeats an old value.
HIGHRES_BITS = {
    **{"xacc": 0, "yacc": 1, "zacc": 2, "xgyro": 3, "ygyro": 4, "zgyro": 5},
    **{"abs_pressure": 9, "diff_pressure": 10, "pressure_alt": 11, "temperature": 12},
}

# Signals of a table that was imported: elements of two DEBUG_FLOAT_ARRAYs of these names for each row. Each is two,
# whose sum it is, to 14 digits; NaN where there is none. The order is that of the
# recordings there are; new ones go to its end.
TABLE_NAMES = ("signals", "signals2")
TABLE_SIGNALS_EACH = 29
TABLE_SIGNALS = (
    *("ax", "ay", "az", "p", "q", "r", "phi", "theta", "psi", "alpha", "beta", "alpha2", "beta2"),
    *("airspeed", "true_airspeed", "differential_pressure", "static_pressure", "temperature", "air_density"),
    *("altitude", "height", "vn", "ve", "vd", "thrust", "rpm", "de", "da", "dr", "throttle"),
    *(f"servo{number}" for number in range(1, OUTPUTS + 1)),
    *(name for name in SECOND_SENSORS if name not in ("alpha2", "beta2")),
    *("battery_voltage", "battery_current"),
)

# Signals that a sender without the sensor leaves at exactly 0 throughout.
ZERO_MEANS_ABSENT = {"differential_pressure", "altitude", "rpm", *(f"adc{i}" for i in range(ADC_CHANNELS))}


@dataclass(frozen=True)
class Source:
    """Fields of one message and how they become one signal.

    convert: takes one (N,) float64 array for each field, gives (N,) values in the row's unit.
    name: what the message's `name` must say, for NAMED_VALUE_FLOAT and DEBUG_FLOAT_ARRAY. port: what its `port` must
    be, for SERVO_OUTPUT_RAW.
    """

    message: str
    fields: tuple[str, ...]
    convert: Callable[..., Array]
    name: str = ""
    port: int | None = None

    @property
    def label(self) -> str:
        """Message and field, as "HIGHRES_IMU.xgyro" or "NAMED_VALUE_FLOAT.value[thrust]"."""
        return f"{self.message}.{self.fields[0]}" + (f" {self.name!r}" if self.name else "")


@dataclass(frozen=True)
class Row:
    """One signal: its unit, the rate it must come at through the flight, and its sources in order of preference."""

    unit: str
    rate_hz: float
    sources: tuple[Source, ...]


def linear(scale: float = 1.0, offset: float = 0.0, none: float | None = None) -> Callable[[Array], Array]:
    """scale * x + offset, NaN where x is `none`."""

    def convert(x: Array) -> Array:
        values = scale * x + offset
        return values if none is None else np.where(x == none, np.nan, values)

    return convert


def _quaternion_angle(which: int) -> Callable[[Array, Array, Array, Array], Array]:
    """Roll, pitch or yaw of the rotation from earth to body, 3-2-1."""

    def convert(w: Array, x: Array, y: Array, z: Array) -> Array:
        if which == 0:
            return np.asarray(np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)))
        if which == 1:
            return np.asarray(np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)))
        return np.asarray(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))

    return convert


def _ground_velocity(axis: Callable[[Array], Array]) -> Callable[[Array, Array, Array], Array]:
    """North or east part of GPS ground speed (cm/s) along the course (cdeg), while there is a fix."""

    def convert(speed: Array, course: Array, fix: Array) -> Array:
        known = (speed != UINT16_NONE) & (course != UINT16_NONE) & (fix >= FIX_2D)
        return np.where(known, 0.01 * speed * axis(np.radians(0.01 * course)), np.nan)

    return convert


def _with_fix(x: Array, fix: Array) -> Array:
    return np.where(fix >= FIX_2D, 1e-7 * x, np.nan)


def _height(distance: Array, low: Array, high: Array, orientation: Array) -> Array:
    """cm to m, where the sensor looks down and its reading lies in its range."""
    known = (orientation == LOOKS_DOWN) & (distance >= low) & ((distance < high) | (high == 0.0))
    return np.where(known, 0.01 * distance, np.nan)


def _cells(*voltages: Array) -> Array:
    """mV of each cell, or of the whole battery in the first, to V."""
    known = np.stack([np.where((one > 0.0) & (one < UINT16_NONE), one, 0.0) for one in voltages])
    total = 1e-3 * known.sum(axis=0)
    return np.where(total > 0.0, total, np.nan)


def _pulse(x: Array) -> Array:
    """us, where the output is in use."""
    return np.where((x <= 0.0) | (x >= UINT16_NONE), np.nan, x)


def _healthy(x: Array, flags: Array) -> Array:
    """AIRSPEED where the sensor does not call itself unhealthy (AIRSPEED_SENSOR_UNHEALTHY = 1)."""
    return np.where(flags.astype(np.int64) & 1 == 1, np.nan, x)


def _body(axis: int, unit: str) -> Row:
    """Specific force (axis 0-2) of the three IMU messages."""
    field = ("xacc", "yacc", "zacc")[axis]
    raw = linear(1e-3 * STANDARD_GRAVITY)
    return Row(
        unit,
        SURFACE_RATE_HZ,
        (
            Source("HIGHRES_IMU", (field,), linear()),
            Source("SCALED_IMU", (field,), raw),
            Source("RAW_IMU", (field,), raw),
        ),
    )


def _rate(axis: int) -> Row:
    field = ("xgyro", "ygyro", "zgyro")[axis]
    return Row(
        "rad/s",
        SURFACE_RATE_HZ,
        (
            Source("HIGHRES_IMU", (field,), linear()),
            Source("SCALED_IMU", (field,), linear(1e-3)),
            Source("RAW_IMU", (field,), linear(1e-3)),
            Source("ATTITUDE", (("rollspeed", "pitchspeed", "yawspeed")[axis],), linear()),
        ),
    )


def _angle(axis: int) -> Row:
    return Row(
        "rad",
        SURFACE_RATE_HZ,
        (
            Source("ATTITUDE", (("roll", "pitch", "yaw")[axis],), linear()),
            Source("ATTITUDE_QUATERNION", ("q1", "q2", "q3", "q4"), _quaternion_angle(axis)),
        ),
    )


def _velocity(axis: int) -> Row:
    part = (np.cos, np.sin)
    field = ("vx", "vy", "vz")[axis]
    solved = (Source("GLOBAL_POSITION_INT", (field,), linear(0.01)), Source("LOCAL_POSITION_NED", (field,), linear()))
    if axis == 2:
        return Row("m/s", GPS_RATE_HZ, solved)
    raw = Source("GPS_RAW_INT", ("vel", "cog", "fix_type"), _ground_velocity(part[axis]))
    return Row("m/s", GPS_RATE_HZ, (raw, *solved))


def _position(field: str) -> Row:
    raw = Source("GPS_RAW_INT", (field, "fix_type"), _with_fix)
    return Row("deg", GPS_RATE_HZ, (raw, Source("GLOBAL_POSITION_INT", (field,), linear(1e-7))))


def _named(name: str, unit: str) -> Row:
    return Row(unit, SURFACE_RATE_HZ, (Source("NAMED_VALUE_FLOAT", ("value",), linear(), name),))


def _of_battery(unit: str, *sources: Source) -> Row:
    return Row(unit, BATTERY_RATE_HZ, sources)


def _one(unit: str, *sources: Source) -> Row:
    return Row(unit, SURFACE_RATE_HZ, sources)


DEGREES = linear(np.pi / 180.0)

_OF_MESSAGES: dict[str, Row] = {
    "ax": _body(0, "m/s^2"),
    "ay": _body(1, "m/s^2"),
    "az": _body(2, "m/s^2"),
    "p": _rate(0),
    "q": _rate(1),
    "r": _rate(2),
    "phi": _angle(0),
    "theta": _angle(1),
    "psi": _angle(2),
    "alpha": _one("rad", Source("AOA_SSA", ("aoa",), DEGREES)),
    "beta": _one("rad", Source("AOA_SSA", ("ssa",), DEGREES)),
    **{name: _named(name, one.unit) for name, one in SECOND_SENSORS.items()},
    "airspeed": _one(
        "m/s",
        Source("AIRSPEED", ("airspeed", "flags"), _healthy),
        Source("VFR_HUD", ("airspeed",), linear()),
    ),
    "differential_pressure": _one(
        "Pa",
        Source("HIGHRES_IMU", ("diff_pressure",), linear(100.0)),
        Source("SCALED_PRESSURE", ("press_diff",), linear(100.0)),
    ),
    "static_pressure": _one(
        "Pa",
        Source("HIGHRES_IMU", ("abs_pressure",), linear(100.0, none=0.0)),
        Source("SCALED_PRESSURE", ("press_abs",), linear(100.0, none=0.0)),
    ),
    "temperature": _one(
        "K",
        Source("HIGHRES_IMU", ("temperature",), linear(1.0, ZERO_CELSIUS)),
        Source("SCALED_PRESSURE", ("temperature",), linear(0.01, ZERO_CELSIUS, none=INT16_NONE)),
    ),
    "altitude": _one("m", Source("HIGHRES_IMU", ("pressure_alt",), linear()), Source("VFR_HUD", ("alt",), linear())),
    "height": _one(
        "m",
        Source("DISTANCE_SENSOR", ("current_distance", "min_distance", "max_distance", "orientation"), _height),
    ),
    "lat": _position("lat"),
    "lon": _position("lon"),
    "vn": _velocity(0),
    "ve": _velocity(1),
    "vd": _velocity(2),
    "thrust": _named("thrust", "N"),
    "rpm": _one("1/min", Source("RPM", ("rpm1",), linear()), Source("ESC_TELEMETRY_1_TO_4", ("rpm[0]",), linear())),
    "battery_voltage": _of_battery(
        "V",
        Source("BATTERY_STATUS", tuple(f"voltages[{i}]" for i in range(CELLS)), _cells),
        Source("SYS_STATUS", ("voltage_battery",), _cells),
    ),
    "battery_current": _of_battery(
        "A",
        Source("BATTERY_STATUS", ("current_battery",), linear(0.01, none=-1.0)),
        Source("SYS_STATUS", ("current_battery",), linear(0.01, none=-1.0)),
    ),
    **{
        f"servo{OUTPUTS * port + i}": _one("us", Source("SERVO_OUTPUT_RAW", (f"servo{i}_raw",), _pulse, port=port))
        for port in range(len(PORTS))
        for i in range(1, OUTPUTS + 1)
    },
    **{
        f"adc{i}": _one("V", Source("DEBUG_FLOAT_ARRAY", (f"data[{i}]",), linear(), "adc")) for i in range(ADC_CHANNELS)
    },
}

# What no message of its own carries.
_UNITS_OF_TABLE = {
    "true_airspeed": "m/s",
    "air_density": "kg/m^3",
    "de": "rad",
    "da": "rad",
    "dr": "rad",
    "throttle": "",
}


def _with_table(signals: dict[str, Row]) -> dict[str, Row]:
    """The rows with a table's element in front: a recording that has one was imported from it."""
    rows = dict(signals)
    for place, name in enumerate(TABLE_SIGNALS):
        row = rows.get(name) or _one(_UNITS_OF_TABLE[name])
        number, first = divmod(2 * place, 2 * TABLE_SIGNALS_EACH)
        parts = (f"data[{first}]", f"data[{first + 1}]")
        element = Source("DEBUG_FLOAT_ARRAY", parts, lambda high, low: high + low, TABLE_NAMES[number])
        rows[name] = replace(row, sources=(element, *row.sources))
    return rows


SIGNALS = _with_table(_OF_MESSAGES)


def usual_conversion(message: str, field: str) -> Callable[[Array], Array] | None:
    """How the table turns `message.field` alone into SI; None where the table does not use it."""
    for row in SIGNALS.values():
        for source in row.sources:
            if source.message == message and source.fields == (field,):
                return source.convert
    return None


def usual_source(signal: str, message: str) -> Source | None:
    """The table's source of `signal` in `message`, if it has one."""
    row = SIGNALS.get(signal)
    return next((source for source in row.sources if source.message == message), None) if row else None
