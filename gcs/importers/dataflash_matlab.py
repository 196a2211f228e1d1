"""ArduPilot's onboard logs as Mission Planner saves them for MATLAB (.mat): a matrix of each message, and its labels.

By Mission Planner's MatLab.cs: `ATT` has a row for each message, `ATT_label` names its columns, of which the first,
LineNo, counts the lines of the whole log. Words are 0 there; `PARM` and `MSG1` are cells and keep theirs.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError
from sysid.errors import TableError
from sysid.tables.files import matlab_variables

#: Name -> (N,) structured messages and the (N,) lines that they stand in.
Found = dict[str, tuple[NDArray[Any], NDArray[np.int64]]]
# Names of all messages, which Mission Planner writes into every file.
_SEEN, _LABEL, _LINE = "Seen", "_label", "LineNo"
# Fields that are the time since boot, which is whole.
_CLOCKS = ("TimeUS", "TimeMS")
_LATEST = float(1 << 53)


def is_mission_planner(path: Path) -> bool:
    """Whether a .mat is such a log; False for one that cannot be read."""
    from scipy.io import whosmat

    try:
        names = {name for name, _, _ in whosmat(path)}
    except Exception:  # whoever reads it says what is wrong with it
        return False
    return _SEEN in names and any(name.endswith(_LABEL) for name in names)


def read_matrices(path: Path) -> Found:
    """The messages of such a log; ImportFileError in one line where it cannot be read."""
    try:
        variables = matlab_variables(path, str(path))
    except OSError as error:
        raise ImportFileError(f"{path} cannot be read: {error.strerror or error}") from None
    except TableError as error:
        raise ImportFileError(f"{error}; save the log anew") from None
    found: Found = {}
    for name, value in variables.items():
        labels = [str(one) for one in np.atleast_1d(variables.get(f"{name}{_LABEL}", []))]
        table = _matrix(value, labels)
        if table is not None:
            found[name] = table
    if not found:
        raise ImportFileError(f"{path} holds labels of messages and no message of them; save the whole log anew")
    if (parameters := _parameters(variables.get("PARM"))) is not None:
        found["PARM"] = parameters
    if "MSG" in found:
        texts = _texts(variables.get("MSG1"), found["MSG"])
        found = (
            {**found, "MSG": texts} if texts is not None else {key: one for key, one in found.items() if key != "MSG"}
        )
    return found


def _matrix(value: Any, labels: list[str]) -> tuple[NDArray[Any], NDArray[np.int64]] | None:
    """A message's rows by its labels; None for what is no such matrix."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu" or labels[:1] != [_LINE]:
        return None
    rows = np.asarray(value, np.float64)
    # A message that came once is a vector by now.
    rows = rows[np.newaxis] if rows.ndim == 1 else rows
    if rows.ndim != 2 or rows.shape[1] != len(labels) or len(set(labels)) != len(labels):
        return None
    clocks = [place for place, one in enumerate(labels) if _is_clock(one, labels)]
    rows = rows[np.all(np.isfinite(rows[:, [0, *clocks]]) & (np.abs(rows[:, [0, *clocks]]) < _LATEST), axis=1)]
    kinds = [(one, np.int64 if _is_clock(one, labels) else np.float64) for one in labels[1:]]
    table = np.zeros(len(rows), kinds)
    for place, label in enumerate(labels[1:], 1):
        table[label] = rows[:, place]
    return table, rows[:, 0].astype(np.int64)


def _is_clock(label: str, labels: list[str]) -> bool:
    """Whether a field is the time since boot; T is that beside a GPS week, and a temperature elsewhere."""
    return label in _CLOCKS or (label == "T" and "Week" in labels)


def _parameters(cells: Any) -> tuple[NDArray[Any], NDArray[np.int64]] | None:
    """PARM: a row of name and value for each; they carry no time and stand before all."""
    if not isinstance(cells, np.ndarray) or cells.dtype != object or cells.size == 0 or cells.size % 2:
        return None
    table = np.array(
        [
            (str(name).encode(), float(value))
            for name, value in cells.reshape(-1, 2)
            if isinstance(value, float | int | np.integer)
        ],
        [("Name", "S16"), ("Value", np.float64)],
    )
    return table, np.zeros(table.size, np.int64)


def _texts(cells: Any, matrix: tuple[NDArray[Any], NDArray[np.int64]]) -> tuple[NDArray[Any], NDArray[np.int64]] | None:
    """MSG by its cells, in which the words stand, in the order of the matrix; None where they do not fit it."""
    rows, lines = matrix
    fields = list(rows.dtype.names or ())
    if "Message" not in fields or not isinstance(cells, np.ndarray):
        return None
    every = [cells] if cells.size and isinstance(cells.flat[0], str) else list(cells)
    if len(every) != len(rows):
        return None
    place = 1 + fields.index("Message")  # behind the message's name
    words = [re.sub(r"\s+", " ", str(one[place])).encode() if np.size(one) > place else b"" for one in every]
    table = np.zeros(len(rows), [(one, rows.dtype[one] if one != "Message" else np.dtype("S64")) for one in fields])
    for one in fields:
        table[one] = words if one == "Message" else rows[one]
    return table, lines


__all__ = ["is_mission_planner", "read_matrices"]
