"""Attitude that a table gives as a quaternion."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from sysid.arrays import Array
from sysid.tables.columns import Wanted, split_header
from sysid.tables.names import SIGNAL_UNITS, USUAL_NAMES, plain

# A header as the dictionary spells it: what it is of, q or quaternion, and which part.
_PART = re.compile(r"((?:.*_)?)(?:q|quat|quaternion)_?([wxyz0-4])")
# An attitude that is wanted, or somebody else's, is none of the aircraft.
_OTHERS = {"sp", "setpoint", "des", "desired", "ref", "reference", "cmd", "command", "target", "demand", "gimbal", "d"}
# Parts in the order of scalar, x, y, z.
_ORDERS = (("w", "x", "y", "z"), ("0", "1", "2", "3"), ("1", "2", "3", "4"))
_ANGLES = ("phi", "theta", "psi")
# What the length of a quaternion of an attitude may be.
_SHORTEST, _LONGEST = 0.9, 1.1


def quaternion_in(headers: Sequence[str]) -> tuple[str, ...]:
    """Headers of scalar, x, y and z of the table's quaternion; () where it has none or has angles as well.

    Reads q0 … q3, q1 … q4 (scalar first, as ArduPilot and PX4 count), q[0] … q[3], qw … qz, with a name before them;
    of several that with the shortest. ROS's `orientation` is none: it is of other axes.
    """
    called = {name for header in headers for name in (plain(header), split_header(header)[0])}
    if any(name in called for angle in _ANGLES for name in USUAL_NAMES[angle]):
        return ()
    groups: dict[str, dict[str, str]] = {}
    for header in headers:
        match = _PART.fullmatch(plain(header))
        if match and not _OTHERS & set(match[1].split("_")):
            groups.setdefault(match[1], {})[match[2]] = header
    for prefix in sorted(groups, key=len):
        for order in _ORDERS:
            if groups[prefix].keys() == {*order}:
                return tuple(groups[prefix][key] for key in order)
    return ()


def headers_named(named: Mapping[str, Wanted]) -> set[str]:
    """Headers that the user names, each in what he wants of it."""
    each = (set(map(str, wanted)) if isinstance(wanted, Mapping) else {str(wanted)} for wanted in named.values())
    return set().union(*each)


def with_angles(
    columns: Mapping[str, Array], named: Mapping[str, Wanted] | None = None
) -> tuple[dict[str, Array], dict[str, str]]:
    """The columns with phi, theta and psi in place of a quaternion, and signal -> header of those; as they are where
    they have none. It turns body axes (x forward, z down) to north, east, down.

    Parameters
    ----------
    columns : Mapping[str, Array]
        Header -> (N,) values.
    named : Mapping[str, str | int | Mapping[str, float]] | None
        What the user says of columns, as `match_columns` takes it: a part that is named is no quaternion's.

    Returns
    -------
    columns : dict[str, Array]
        The others, and (N,) angles in rad; NaN where the quaternion is none.
    angles : dict[str, str]
        Signal -> header.
    """
    headers = quaternion_in(list(columns))
    named = named or {}
    if not headers or ({*named} | headers_named(named)) & {*headers, *_ANGLES}:
        return dict(columns), {}
    try:
        parts = np.column_stack([np.asarray(columns[header], dtype=np.float64) for header in headers])
    except (TypeError, ValueError):
        return dict(columns), {}
    length = np.linalg.norm(parts, axis=1)
    known = (length > _SHORTEST) & (length < _LONGEST)
    if np.count_nonzero(known) < 0.5 * np.count_nonzero(np.isfinite(length)):
        return dict(columns), {}
    words = ", ".join(headers)
    angles = {angle: f"{angle} of {words} ({SIGNAL_UNITS[angle]})" for angle in _ANGLES}
    others = {header: values for header, values in columns.items() if header not in headers}
    return {**others, **dict(zip(angles.values(), _angles(parts, known), strict=True))}, angles


def _angles(parts: Array, known: Array) -> Array:
    """(3, N) phi, theta, psi, rad. parts: (N, 4) scalar, x, y, z."""
    from scipy.spatial.transform import Rotation

    angles = np.full((3, len(parts)), np.nan)
    turned = Rotation.from_quat(parts[known][:, [1, 2, 3, 0]])
    angles[:, known] = turned.as_euler("ZYX").T[::-1]
    return angles
