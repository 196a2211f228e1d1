"""A folder with a CSV of each topic of one log as a recording: PX4's by ulog2csv or Flight Review, a ROS bag's.

Every topic keeps its own stamps. What a topic means stands where logs of its kind are read (`ulog`, `ros`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from gcs.importers.ros import Bag, Message, bag_of, write_bag
from gcs.importers.synthesis import Progress, write_recording
from gcs.importers.topic_csv import TopicTable, read_topic
from gcs.importers.ulog import TOPICS, mapped

PX4_FORMAT = "PX4 topics"
ROS_NOTE = "its columns: signals in SI units and radians from the topics' CSV files; these are attached"
# A topic of PX4 at the end of a file's name, and its instance.
_PX4 = re.compile(rf"(?:.*_)?(?P<topic>{'|'.join(sorted(TOPICS, key=len, reverse=True))})_(?P<number>\d+)")
# Where a name of a ROS topic may begin, and what stands for its slashes.
_EDGE = re.compile(r"_slash_|-|_")
_SLASH = re.compile(r"_slash_|-")
# Message type -> fields that it alone has.
_KINDS: tuple[tuple[str, frozenset[str]], ...] = (
    ("Imu", frozenset({"angular_velocity.x", "linear_acceleration.x", "orientation.w"})),
    ("NavSatFix", frozenset({"latitude", "longitude", "altitude", "status.status"})),
    ("FluidPressure", frozenset({"fluid_pressure"})),
    ("JointState", frozenset({"name0", "position0"})),
    ("VFR_HUD", frozenset({"airspeed", "groundspeed", "climb"})),
)
# Types whose fields others have too: these alone.
_WHOLE_KINDS: tuple[tuple[str, frozenset[str]], ...] = (
    ("TwistStamped", frozenset(f"twist.{part}.{axis}" for part in ("linear", "angular") for axis in "xyz")),
    ("Temperature", frozenset({"temperature", "variance"})),
    ("Float64", frozenset({"data"})),
)


def import_folder(
    source: Path,
    target: Path,
    progress: Progress = lambda share: None,
    name: str = "",
    columns: Path | None = None,
) -> None:
    """Write the topics in a folder as one recording, called `name` there, else as the folder.

    columns: as for `import_ros`, of ROS topics. Raises ImportFileError where the files are none of one log's topics.
    """
    called = name or source.resolve().name
    tables = [read_topic(path) for path in sorted(source.glob("*.csv"))]
    if any(_is_px4(table) for table in tables):
        if columns is not None:
            raise ImportFileError(f"{called}: PX4's topics say themselves what they are; leave the file of columns out")
        log = replace(mapped(_px4_log(called, tables)), format=PX4_FORMAT)
        write_recording(log, source, target, progress, called)
    elif any(table.stamp_s() is not None for table in tables):
        bag: Bag = bag_of(lambda headers: _ros_messages(tables, headers), called, columns)
        write_bag(bag, source, target, progress, called, note=ROS_NOTE)
    else:
        raise ImportFileError(
            f"{called}: its {len(tables)} CSV files are no topics of PX4 (LOG_vehicle_attitude_0.csv with a column"
            " timestamp) nor of ROS (a column header.stamp or %time); name one file in it, if that is a whole flight"
        )


@dataclass(frozen=True)
class _Entry:
    """A topic as pyulog has it."""

    name: str
    multi_id: int
    data: Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True)
class _Px4Log:
    """What pyulog finds in a log, of which CSV files keep the topics alone."""

    data_list: Sequence[_Entry]
    initial_parameters: Mapping[str, float] = field(default_factory=dict)
    changed_parameters: Sequence[Any] = ()
    logged_messages: Sequence[Any] = ()
    dropouts: Sequence[Any] = ()
    file_corruption: bool = False
    start_timestamp: int = 0


def _is_px4(table: TopicTable) -> bool:
    return "timestamp" in table.numbers and _PX4.fullmatch(table.stem) is not None


def _px4_log(name: str, tables: Sequence[TopicTable]) -> _Px4Log:
    """The topics of one PX4 log; those that no signal is made from keep their file's name."""
    entries: list[_Entry] = []
    files: dict[tuple[str, int], str] = {}
    for table in tables:
        stamps = table.numbers.get("timestamp")
        if stamps is None or not np.isfinite(stamps).all():
            continue  # no topic, or none with a row
        match = _PX4.fullmatch(table.stem)
        topic, number = (match["topic"], int(match["number"])) if match else (table.stem, 0)
        if (topic, number) in files:
            raise ImportFileError(
                f"{name}: {files[topic, number]}.csv and {table.stem}.csv are the same topic of two logs: one log in a"
                " folder"
            )
        files[topic, number] = table.stem
        entries.append(_Entry(topic, number, table.numbers))
    return _Px4Log(entries)


def _ros_messages(tables: Sequence[TopicTable], wanted: Sequence[str]) -> Iterator[Message]:
    """Every row of the topics as a message; those of types that are not known once, without one."""
    known = [(table, stamps) for table in tables if (stamps := table.stamp_s()) is not None]
    late = [float(np.median(late)) for table, _ in known if (late := table.late_s()) is not None]
    shift = float(np.median(late)) if late else 0.0
    for topic, (table, stamps) in zip(_topics([table.stem for table, _ in known]), known, strict=True):
        fields = table.fields()
        kind = _kind(topic, frozenset(fields))
        if not kind and not any(header.startswith(topic) for header in wanted):
            yield topic, "", float("nan"), None
            continue
        # What has no stamp of its own has that of its reception, which is later.
        times = stamps if table.is_stamped else stamps - shift
        for row, at in enumerate(times.tolist()):
            yield topic, kind, at, _message(fields, row)


def _topics(stems: Sequence[str]) -> list[str]:
    """Names of topics by those of their files, without what all of these begin with."""
    shared = 0
    if len(stems) > 1:
        low, high = min(stems), max(stems)
        shared = next((i for i, (a, b) in enumerate(zip(low, high, strict=False)) if a != b), len(low))
        # Not within a word.
        shared = max((match.end() for match in _EDGE.finditer(low) if match.end() <= shared), default=0)
    return ["/" + _SLASH.sub("/", stem[shared:]).strip("/") for stem in stems]


def _kind(topic: str, names: frozenset[str]) -> str:
    """The type of a topic's messages; "" for one that gives no signal by itself."""
    own = frozenset(one for one in names if not one.startswith("header."))
    for kind, fields in _KINDS:
        if fields <= own:
            return kind
    for kind, fields in _WHOLE_KINDS:
        if own == fields:
            return kind
    # In and out have the same field; out alone moves something.
    return "RCOut" if "channels0" in own and topic.endswith("/out") and "rssi" not in own else ""


def _message(fields: Mapping[str, Sequence[Any]], row: int) -> Any:
    """A row as ROS' readers want it: nested, arrays as lists."""
    top: dict[str, Any] = {}
    for name, column in fields.items():
        *groups, last = name.split(".")
        place = top
        for group in groups:
            place = place.setdefault(group, {})
        array = re.fullmatch(r"(.+?)(\d+)", last)
        base = f"{name[: -len(last)]}{array[1]}" if array else ""
        if array and f"{base}0" in fields:
            place.setdefault(array[1], {})[int(array[2])] = column[row]
        else:
            place[last] = column[row]
    return _nested(top)


def _nested(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    if all(isinstance(key, int) for key in value):
        return [value[key] for key in sorted(value)]
    return SimpleNamespace(**{key: _nested(one) for key, one in value.items()})


__all__ = ["import_folder"]
