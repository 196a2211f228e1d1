"""Tables of a flight that was seen from outside: position and quaternion in place of an IMU and air data."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from sysid.arrays import Array
from sysid.errors import TableError
from sysid.tables.columns import TAKEN_FOR_SECONDS, Wanted, split_header
from sysid.tables.names import SIGNAL_UNITS, TIME, UNIT_OF_NAME, USUAL_NAMES, plain
from sysid.tables.pose import FRAMES, signals_of_pose
from sysid.tables.quaternions import headers_named, quaternion_in, with_angles
from sysid.tables.units import unit_of

_IMU = ("p", "q", "r", "ax", "ay", "az")
# A header as the dictionary spells it: an axis alone, or what it is of, that it is a position, and which axis.
_PLACE = re.compile(r"(?:(?:.*_)?(?:position_|pos_|p_?|translation_|t_?))?([xyz])")
# Names of positions whose axes they say, and the frame of those.
_SAID: dict[tuple[str, ...], str] = {
    ("north", "east", "down"): "ned",
    ("pn", "pe", "pd"): "ned",
    ("east", "north", "up"): "enu",
}
_HEADER = "{} of position and quaternion, in still air ({})"

Units = Mapping[str, str] | str | None
Derived = tuple[Mapping[str, Array], dict[str, Wanted], Units]


def derived_columns(columns: Mapping[str, Array], named: Mapping[str, Wanted] | None, units: Units) -> Derived:
    """What a table says otherwise than as signals, as signals: a pose, or an attitude as a quaternion.

    Parameters
    ----------
    columns : Mapping[str, Array]
        Header -> (N,) values.
    named : Mapping[str, str | int | Mapping[str, float]] | None
        What the user says of columns, as `match_columns` takes it.
    units : Mapping[str, str] | str | None
        What the user says of units, likewise.

    Returns
    -------
    columns : Mapping[str, Array]
        With what was derived, in place of what it comes from.
    named : dict[str, str | int | Mapping[str, float]]
        With the headers of that.
    units : Mapping[str, str] | str | None
        As it was, but for a time that was replaced.

    Raises
    ------
    TableError
        Where position and quaternion are no flight's.
    """
    spoken = _by_header(named or {}, list(columns))
    pose = _pose_in(list(columns), spoken)
    if pose is None:
        every, angles = with_angles(columns, spoken)
        return every, {**angles, **spoken}, units
    time, places, quaternion = pose
    _require_one_length(columns, time)
    stamps = _in_si(columns, time, TIME, "s", units)
    at = np.column_stack([_in_si(columns, header, "position", "m", units) for header in places])
    turned = np.column_stack([np.asarray(columns[header], dtype=np.float64) for header in quaternion])
    found = _signals(stamps, at, turned, _SAID.get(tuple(plain(split_header(header)[0]) for header in places), ""))
    known = _known_besides(columns, spoken)
    headers: dict[str, Wanted] = {
        name: _HEADER.format(name, SIGNAL_UNITS[name]) for name in found if name not in (TIME, *known)
    }
    headers[TIME] = "time (s)"
    gone = {time, TIME, "position", *places, *quaternion}
    rest = {header: values for header, values in columns.items() if header not in (time, *places, *quaternion)}
    # An input holds until the next one.
    held = np.searchsorted(stamps, found[TIME] + 1e-9, side="right").clip(min=1) - 1
    every = {header: np.asarray(values)[held] for header, values in rest.items()}
    every |= {str(header): found[name] for name, header in headers.items()}
    said = units if isinstance(units, str) or units is None else {k: u for k, u in units.items() if k not in gone}
    return every, {**spoken, **headers}, said


def _by_header(named: Mapping[str, Wanted], headers: Sequence[str]) -> dict[str, Wanted]:
    """What the user names, columns by their headers: their numbers are those of the whole table."""
    return {
        signal: headers[wanted] if isinstance(wanted, int) and 0 <= wanted < len(headers) else wanted
        for signal, wanted in named.items()
    }


def _known_besides(columns: Mapping[str, Array], named: Mapping[str, Wanted]) -> set[str]:
    """Signals that the table measures itself, or the user names: they are not made from the motion in still air."""
    spelt = {name for header in columns for name in (plain(header), split_header(header)[0])}
    known = {signal for signal in SIGNAL_UNITS if signal in named or spelt & set(USUAL_NAMES.get(signal, ()))}
    return known | ({"true_airspeed"} if known & {"airspeed", "differential_pressure"} else set())


def _require_one_length(columns: Mapping[str, Array], time: str) -> None:
    rows = np.size(columns[time])
    for header, values in columns.items():
        if np.ndim(values) != 1 or np.size(values) != rows:
            raise TableError(f"column {header!r} has {np.size(values)} rows, and the time {rows}")


def _pose_in(headers: Sequence[str], named: Mapping[str, Wanted]) -> tuple[str, list[str], tuple[str, ...]] | None:
    """Headers of time, position and quaternion; None where one is missing, or an IMU is there."""
    by_name = {spelt: header for header in headers for spelt in (plain(header), split_header(header)[0])}
    if any(name in by_name for signal in _IMU for name in USUAL_NAMES[signal]) or named.keys() & {*_IMU}:
        return None
    quaternion = quaternion_in(headers)
    given = named.get(TIME)
    usual = (by_name[name] for name in USUAL_NAMES[TIME] if name in by_name)
    time = given if isinstance(given, str) and given in headers else next(usual, None)
    places = _places(by_name)
    if not quaternion or time is None or not places or headers_named(named) & {*places, *quaternion}:
        return None
    return time, places, quaternion


def _places(by_name: Mapping[str, str]) -> list[str]:
    """Headers of the three parts of a position; of several that whose name is shortest."""
    for names in _SAID:
        if all(name in by_name for name in names):
            return [by_name[name] for name in names]
    groups: dict[str, dict[str, str]] = {}
    for spelt in sorted(by_name, key=len):
        if match := _PLACE.fullmatch(spelt):
            groups.setdefault(spelt[:-1], {})[match[1]] = by_name[spelt]
    whole = [group for key, group in sorted(groups.items(), key=lambda item: len(item[0])) if len(group) == len("xyz")]
    return [whole[0][axis] for axis in "xyz"] if whole else []


def _in_si(columns: Mapping[str, Array], header: str, signal: str, si: str, units: Units) -> Array:
    said = {} if units is None or isinstance(units, str) else units
    name, own = split_header(header)
    written = said.get(header) or said.get(signal) or own or UNIT_OF_NAME.get(name, si)
    unit = unit_of(si if written == TAKEN_FOR_SECONDS else written, si, header)
    return np.asarray(unit.factor * np.asarray(columns[header], dtype=np.float64))


def _signals(time_s: Array, position: Array, quaternion: Array, frame: str) -> dict[str, Array]:
    """Signals of a pose, in the one frame in which an aircraft flies as it does where no name says which it is."""
    found, errors = [], []
    for one in (frame,) if frame else FRAMES:
        try:
            found.append(signals_of_pose(time_s, position, quaternion, one))
        except TableError as error:
            errors.append(str(error))
    if len(found) == 1:
        return found[0]
    if not found:
        # What is wrong in both frames alike has nothing to do with them.
        words = "" if len({*errors}) == 1 else "; neither as north, east, down nor as east, north, up"
        why = errors[0].partition("; try frame=")[0].partition(": try frame=")[0]
        raise TableError(f"{why}{words}")
    raise TableError(
        "pose: it never banks, and nothing else shows whether positions are north, east, down or east, north, up: call"
        " their columns so"
    )
