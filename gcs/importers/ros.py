"""ROS bags (rosbag2 in MCAP or SQLite, ROS 1's .bag) as recordings: standard messages become signals.

By REP 103 a body's axes are forward, left, up and the world's are east, north, up; ours are forward, right, down and
north, east, down. Frames whose name says so (base_link_frd, map_ned) are left as they are.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.flights.signal_sources import TABLE_SIGNALS
from gcs.flights.signals import IMPORT_WARNING
from gcs.importers import messages as make
from gcs.importers.damaged_bag import as_far_as_it_goes
from gcs.importers.synthesis import ImportedLog, Ints, Progress, Series, write_recording
from gcs.importers.table import FIRST_US, row_series
from sysid.errors import TableError
from sysid.signals.flight import FlightSignals, Signal
from sysid.tables.columns import Wanted, match_columns
from sysid.tables.files import read_mapping
from sysid.tables.names import SIGNAL_UNITS, TIME

FORMAT = "ros"
NOTE = "its columns: signals in SI units and radians from the bag's standard messages; the bag itself is attached"
_NED = re.compile(r"(^|[_/])(ned|frd)$", re.IGNORECASE)
_FEWEST = 10  # messages of a topic
_NO_PULSE = 65535.0
# Topics that hold what is wanted, what the air does, or another temperature than its own, by words in their names.
_NOT_MEASURED = re.compile(r"wind|cmd|command|set_?point|target|desired|goal|imu.*temp|temp.*imu", re.IGNORECASE)

Values = NDArray[np.float64]
#: Signal -> (N,) values, from (N, …) fields of a topic's messages.
Found = dict[str, Values]
#: Topic, type, time [s] and message; None for one of a type that is not known.
Message = tuple[str, str, float, Any]


def import_ros(
    source: Path,
    target: Path,
    progress: Progress = lambda share: None,
    name: str = "",
    columns: Path | None = None,
) -> None:
    """Write a bag as a recording, called `name` there.

    columns: TOML that says which field of which topic is a signal: de = "/servos.position[1]". Raises ImportFileError.
    """
    called = name or source.name
    with as_far_as_it_goes(source) as (whole, missing):
        bag = bag_of(lambda headers: _messages(whole, called, headers), called, columns)
    write_bag(bag, source, target, progress, called, missing)


def bag_of(read: Callable[[Sequence[str]], Iterator[Message]], name: str, columns: Path | None) -> Bag:
    """What messages give.

    read: topic, type, time [s] and message of each, from the headers that are wanted beside those of known types.
    columns: as for `import_ros`. Raises ImportFileError.
    """
    try:
        wanted, units = ({}, {}) if columns is None else read_mapping(columns)
        named = {*wanted, *(header for header in wanted.values() if isinstance(header, str))}
        if strange := [key for key in units if key not in named] if isinstance(units, dict) else []:
            raise TableError(f"units: {strange[0]!r} is none of the columns that are named")
        messages = read([header for header in wanted.values() if isinstance(header, str)])
        bag = Bag(messages, name, wanted, units)
    except TableError as error:
        raise ImportFileError(f"{name}: {error}") from None
    if not bag.signals.keys() & set(TABLE_SIGNALS):
        raise ImportFileError(
            f"{name}: none of its messages is one of sensor_msgs/Imu, FluidPressure, Temperature, JointState,"
            " geometry_msgs/TwistStamped, mavros_msgs/RCOut, VFR_HUD or std_msgs/Float32, Float64 of a known name; name"
            f" fields with --columns FILE.toml; topics are {', '.join(sorted(bag.kinds))[:400] or 'none'}"
        )
    return bag


def write_bag(
    bag: Bag, source: Path, target: Path, progress: Progress, name: str, missing: str = "", note: str = NOTE
) -> None:
    """Write what messages gave as a recording. missing: what of them could not be read."""
    start = min(one.time_s[0] for one in bag.signals.values())
    moved = {key: Signal(one.time_s - start, one.values, one.unit, one.source) for key, one in bag.signals.items()}
    series = row_series(FlightSignals(name, moved))
    series += [_positions(time_s - start, values) for time_s, values in bag.fixes]
    notes = {"note": note, "columns": "; ".join(f"{key}: {one.source}" for key, one in bag.signals.items()),
             "unused": ", ".join(bag.unused), **({f"{IMPORT_WARNING}bag": missing} if missing else {})}  # fmt: skip
    utc = round(1e6 * start) - FIRST_US if start > 1e9 else None
    write_recording(ImportedLog(FORMAT, 1, series, utc, notes), source, target, progress, name)


class Bag:
    """What a bag gives. kinds: topic -> message type. unused: topics that gave nothing. fixes: of GPS receivers."""

    def __init__(
        self, messages: Iterable[Message], name: str, wanted: Mapping[str, Wanted], units: Mapping[str, str] | str
    ) -> None:
        self.signals: dict[str, Signal] = {}
        self.fixes: list[tuple[Values, NDArray[np.float64]]] = []
        self.kinds: dict[str, str] = {}
        by_topic: dict[str, tuple[list[float], list[Any]]] = {}
        for topic, kind, at, message in messages:
            self.kinds[topic] = kind
            if message is None:
                continue
            times, each = by_topic.setdefault(topic, ([], []))
            times.append(at)
            each.append(message)
        for topic, (times, each) in by_topic.items():
            if len(each) >= _FEWEST:
                self._take(topic, np.array(times), each)
        for signal, header in wanted.items():
            self._take_wanted(name, signal, header, units, by_topic)
        used = {one.source.split(" ")[0].split(".")[0] for one in self.signals.values()}
        self.unused = sorted(topic for topic in self.kinds if topic not in used and not self._is_fix(topic))

    def _is_fix(self, topic: str) -> bool:
        return self.kinds[topic].endswith("/NavSatFix")

    def _take(self, topic: str, time_s: Values, messages: list[Any]) -> None:
        kind = self.kinds[topic].rsplit("/", 1)[-1]
        if kind == "NavSatFix":
            fields = [(m.latitude, m.longitude, m.altitude, m.status.status) for m in messages]
            self.fixes.append((time_s, np.array(fields, np.float64)))
            return
        reader = None if _NOT_MEASURED.search(topic) else _READERS.get(kind)
        found = reader(topic, messages) if reader is not None else {}
        for signal, values in found.items():
            if signal not in self.signals and np.isfinite(values).any():
                order = np.argsort(time_s, kind="stable")
                unit = SIGNAL_UNITS[signal]
                self.signals[signal] = Signal(time_s[order], values[order], "" if unit == "1" else unit, topic)

    def _take_wanted(
        self, name: str, signal: str, header: Wanted, units: Mapping[str, str] | str,
        by_topic: Mapping[str, tuple[list[float], list[Any]]],
    ) -> None:  # fmt: skip
        """A field that the user names: TOPIC.field.field[3]."""
        if signal == TIME:
            raise ImportFileError(f"{name}: columns.time: a bag's messages have times of their own; leave it out")
        if not isinstance(header, str):
            raise ImportFileError(f'{name}: columns.{signal}: name a field of a topic, as "/servos.position[1]"')
        topic = max((one for one in by_topic if header.startswith(one)), key=len, default=None)
        if topic is None:
            raise ImportFileError(
                f"{name}: columns.{signal}: no topic {header}; there are {', '.join(sorted(by_topic))}"
            )
        times, messages = by_topic[topic]
        path = header[len(topic) :].lstrip(".")
        try:
            values = np.array([_field(message, path) for message in messages], np.float64)
        except (AttributeError, IndexError, TypeError, ValueError):
            raise ImportFileError(
                f"{name}: columns.{signal}: the messages of {topic} have no number {path!r}"
            ) from None
        said = units if isinstance(units, str) else {key: one for key, one in units.items() if key in (signal, header)}
        (use,) = match_columns(["time", header], {"time": "time", signal: header}, said).uses
        unit = "" if use.unit.si == "1" else use.unit.si
        self.signals[signal] = Signal(np.array(times), use.unit.factor * values + use.unit.offset, unit, header)


def _messages(path: Path, name: str, wanted: Iterable[str]) -> Iterator[Message]:
    """Topic, type, time [s] and message of each of a kind that is known, or of a topic that is wanted.

    What has no stamp of its own is put on the clock of what has: by the median of reception less stamp.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, TypesysError, get_typestore
    except ImportError:
        raise ImportFileError(f"{name}: is a ROS bag, for which rosbags is needed: pip install rosbags") from None
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            asked = [
                one
                for one in reader.connections
                if one.msgtype.rsplit("/", 1)[-1] in (*_READERS, "NavSatFix")
                or any(header.startswith(one.topic) for header in wanted)
            ]
            yield from ((one.topic, one.msgtype, math.nan, None) for one in reader.connections if one not in asked)
            late: list[float] = []
            unstamped: list[Message] = []
            for connection, logged, raw in reader.messages(connections=asked) if asked else ():
                try:
                    message = reader.deserialize(raw, connection.msgtype)
                except (TypesysError, KeyError, ValueError, AssertionError):
                    continue  # a type that the bag does not define
                stamp = getattr(getattr(message, "header", None), "stamp", None)
                seconds = 0.0 if stamp is None else stamp.sec + 1e-9 * stamp.nanosec
                if seconds > 0.0:
                    late.append(1e-9 * logged - seconds)
                    yield connection.topic, connection.msgtype, seconds, message
                else:
                    unstamped.append((connection.topic, connection.msgtype, 1e-9 * logged, message))
            shift = float(np.median(late)) if late else 0.0
            yield from ((topic, kind, logged - shift, message) for topic, kind, logged, message in unstamped)
    except Exception as error:  # whatever a library that reads four formats says of bytes that are none of them
        said = " ".join(str(error).split()) or type(error).__name__
        raise ImportFileError(f"{name}: cannot be read as a ROS bag: {said[:200]}") from None


def _field(message: Any, path: str) -> float:
    for part in re.findall(r"[^.\[\]]+|\[\d+\]", path):
        message = message[int(part[1:-1])] if part.startswith("[") else getattr(message, part)
    return float(message)


def _turned(messages: list[Any]) -> bool:
    """Whether frames are REP 103's, to be turned to ours."""
    return not _NED.search(str(getattr(messages[0].header, "frame_id", "")))


def _vectors(messages: list[Any], of: Callable[[Any], Any]) -> NDArray[np.float64]:
    return np.array([(v.x, v.y, v.z) for v in map(of, messages)], np.float64)


def _imu(topic: str, messages: list[Any]) -> Found:
    sign = np.array([1.0, -1.0, -1.0]) if _turned(messages) else np.ones(3)
    force, rate = (
        sign * _vectors(messages, of) for of in (lambda m: m.linear_acceleration, lambda m: m.angular_velocity)
    )
    found = dict(zip(("ax", "ay", "az", "p", "q", "r"), (*force.T, *rate.T), strict=True))
    # A covariance that begins with -1 says that there is none of it.
    for signals, of in ((("ax", "ay", "az"), "linear_acceleration"), (("p", "q", "r"), "angular_velocity")):
        if float(getattr(messages[0], f"{of}_covariance")[0]) == -1.0:
            found = {key: one for key, one in found.items() if key not in signals}
    if float(messages[0].orientation_covariance[0]) == -1.0:
        return found
    w, x, y, z = np.array([(m.w, m.x, m.y, m.z) for m in (m.orientation for m in messages)], np.float64).T
    size = np.sqrt(w * w + x * x + y * y + z * z)
    if not (np.abs(size - 1.0) < 0.01).all():
        return found
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    if _turned(messages):
        # From east-north-up to forward-left-up: nose up is a pitch below 0, and east is a yaw of 0.
        pitch, yaw = -pitch, 0.5 * math.pi - yaw
    return {**found, "phi": roll, "theta": pitch, "psi": np.asarray((yaw + math.pi) % (2.0 * math.pi) - math.pi)}


def _twist(topic: str, messages: list[Any]) -> Found:
    """Velocity over ground; that in a body's frame is none of ours."""
    frame = str(messages[0].header.frame_id)
    if "base" in frame or "body" in frame:
        return {}
    of = (lambda m: m.twist.twist.linear) if hasattr(messages[0].twist, "twist") else (lambda m: m.twist.linear)
    east, north, up = _vectors(messages, of).T
    if not _turned(messages):
        return {"vn": east, "ve": north, "vd": up}
    return {"vn": north, "ve": east, "vd": -up}


def _pressure(topic: str, messages: list[Any]) -> Found:
    values = np.array([m.fluid_pressure for m in messages], np.float64)
    return {"differential_pressure" if "diff" in topic or "dynamic" in topic else "static_pressure": values}


def _temperature(topic: str, messages: list[Any]) -> Found:
    return {"temperature": np.array([m.temperature for m in messages], np.float64) + 273.15}


def _joints(topic: str, messages: list[Any]) -> Found:
    """Positions of joints, rad, whose names the dictionary of columns knows; each message brings those it names."""
    names = list(dict.fromkeys(str(name) for message in messages for name in message.name))
    if not names:
        return {}
    try:
        matched = match_columns(["time", *names], None, "SI")
    except TableError:
        return {}
    rows = [dict(zip(map(str, m.name), map(float, m.position), strict=False)) for m in messages]
    return {
        use.signal: np.array([[row.get(head, np.nan) for head in use.headers] for row in rows]) @ np.array(use.weights)
        for use in matched.uses
        if use.unit.si == "rad"
    }


def _number(topic: str, messages: list[Any]) -> Found:
    """A number alone: its topic says what it is and in which unit, as /air_data/alpha_deg."""
    header = topic.rstrip("/").rsplit("/", 1)[-1]
    try:
        matched = match_columns(["time", header])
    except TableError:
        return {}
    values = np.array([m.data for m in messages], np.float64)
    return {use.signal: use.unit.factor * values + use.unit.offset for use in matched.uses}


def _outputs(topic: str, messages: list[Any]) -> Found:
    """MAVROS' servo outputs, us; 0 and 65535 where there is none."""
    found = {}
    for place in range(min(16, *(len(m.channels) for m in messages))):
        pulses = np.array([m.channels[place] for m in messages], np.float64)
        found[f"servo{place + 1}"] = np.where((pulses > 0.0) & (pulses < _NO_PULSE), pulses, np.nan)
    return found


def _hud(topic: str, messages: list[Any]) -> Found:
    """MAVROS' airspeed, m/s as in VFR_HUD."""
    return {"airspeed": np.array([m.airspeed for m in messages], np.float64)}


_READERS: dict[str, Callable[[str, list[Any]], Found]] = {
    "Imu": _imu,
    "TwistStamped": _twist,
    "TwistWithCovarianceStamped": _twist,
    "FluidPressure": _pressure,
    "Temperature": _temperature,
    "JointState": _joints,
    "RCOut": _outputs,
    "VFR_HUD": _hud,
    "VfrHud": _hud,
    "Float32": _number,
    "Float64": _number,
}


def _positions(time_s: Values, fields: NDArray[np.float64]) -> Series:
    """NavSatFix as GPS_RAW_INT. fields: (N, 4) deg, deg, m, status, -1 for none."""
    nothing = np.full(time_s.size, np.nan)
    time_us: Ints = FIRST_US + np.rint(1e6 * time_s).astype(np.int64)
    return make.gps(
        time_us, fix=np.where(fields[:, 3] >= 0.0, 3.0, 1.0), latitude=fields[:, 0], longitude=fields[:, 1],
        altitude=fields[:, 2], speed=nothing, course=nothing, hdop=nothing, vdop=nothing, satellites=nothing,
    )  # fmt: skip
