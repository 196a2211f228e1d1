"""Logs of INAV's and Betaflight's Blackbox as CSV (blackbox_decode, Blackbox Explorer): what their columns are.

Fields and units: INAV's blackbox.c. Their body axes are forward, left, up, their world north, east, up; ours are
forward, right, down and north, east, down. A pitch is positive nose down there.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from sysid.errors import TableError
from sysid.tables.columns import Wanted
from sysid.tables.names import TIME
from sysid.tables.units import is_unit

# What a row of a log is counted by, first in every header.
_FIRST = "loopiteration"
# Lines before the header that are looked through for it: Blackbox Explorer writes all settings of the aircraft there.
_MOST_SETTINGS = 5_000
_SETTING = re.compile(r'[#%\s]*(?:H )?"?(?P<name>[A-Za-z][\w .]*?)"?\s*[:,]\s*"?(?P<value>[^"]*?)"?\s*')
# Columns of words, or of "0" where no word is set.
_WORDS = re.compile(r"flags|phase|mode", re.IGNORECASE)
# Columns that INAV alone logs: its gyro is in deg/s in every version.
_INAV = ("navpos[0]", "navvel[0]", "navstate")

#: Signal -> (field, weight, unit) of raw values, in order of preference. Weights turn axes.
_FIELDS: dict[str, tuple[tuple[str, float, str], ...]] = {
    TIME: (("time", 1.0, "us"),),
    "phi": (("attitude[0]", 1.0, "ddeg"),),
    "theta": (("attitude[1]", -1.0, "ddeg"),),
    "psi": (("attitude[2]", 1.0, "ddeg"),),
    "airspeed": (("airspeed", 1.0, "cm/s"),),
    "altitude": (("baroalt", 1.0, "cm"), ("navpos[2]", 1.0, "cm")),
    "vn": (("navvel[0]", 1.0, "cm/s"), ("gps_velned[0]", 1.0, "cm/s")),
    "ve": (("navvel[1]", 1.0, "cm/s"), ("gps_velned[1]", 1.0, "cm/s")),
    "vd": (("navvel[2]", -1.0, "cm/s"), ("gps_velned[2]", 1.0, "cm/s")),
    **{f"servo{number + 1}": ((f"servo[{number}]", 1.0, "us"),) for number in range(16)},
}
_RATES = {"p": ("gyroadc[0]", 1.0), "q": ("gyroadc[1]", -1.0), "r": ("gyroadc[2]", -1.0)}
_FORCES = {"ax": ("accsmooth[0]", 1.0), "ay": ("accsmooth[1]", -1.0), "az": ("accsmooth[2]", -1.0)}


def is_blackbox(headers: Sequence[str]) -> bool:
    """Whether columns are those of a Blackbox.

    Parameters
    ----------
    headers : Sequence[str]
        Headers of a table.

    Returns
    -------
    bool
        Whether they begin as a Blackbox's do.
    """
    return bool(headers) and headers[0].strip().lower() == _FIRST


def is_of_words(header: str) -> bool:
    """Whether a column of a Blackbox holds words: flags that are set, "0" for none."""
    return _WORDS.search(header) is not None


def settings_before(lines: Sequence[str]) -> tuple[int, dict[str, str]]:
    """The line of a Blackbox's header and the settings before it; 0 and none where it is none.

    Parameters
    ----------
    lines : Sequence[str]
        Lines of a text: "H acc_1G:2048" of the log, also behind "#", or "acc_1G","2048" of Blackbox Explorer.

    Returns
    -------
    first : int
        The line that names the columns.
    settings : dict[str, str]
        Setting -> value.
    """
    settings: dict[str, str] = {}
    for number, line in enumerate(lines[:_MOST_SETTINGS]):
        if line.lstrip('" ').lower().startswith(_FIRST):
            return number, settings
        if match := _SETTING.fullmatch(line):
            settings[match["name"]] = match["value"]
    return 0, {}


def blackbox_columns(
    name: str, headers: Sequence[str], settings: Mapping[str, str], columns: Mapping[str, Wanted],
    units: Mapping[str, str] | str,
) -> tuple[dict[str, Wanted], dict[str, str]]:  # fmt: skip
    """What columns of a Blackbox are, and their units.

    Parameters
    ----------
    name : str
        What the table is called in errors.
    headers : Sequence[str]
        Its headers: a unit in brackets is that of values that blackbox_decode has turned already.
    settings : Mapping[str, str]
        Of the log's header: `acc_1G` counts of the accelerometer are one g.
    columns, units : Mapping
        What the user says, which goes before.

    Returns
    -------
    columns : dict[str, Wanted]
        Signal -> header and weight.
    units : dict[str, str]
        Header -> unit, where the header says none.

    Raises
    ------
    TableError
        Where the scale of the gyro or the accelerometer is not known.
    """
    if isinstance(units, str):
        raise TableError(f"{name}: is a log of a Blackbox, whose columns are not in SI units: leave units = 'SI' out")
    parsed = {_field(header): header for header in headers}
    found: dict[str, Wanted] = {}
    known: dict[str, str] = {}

    counts = settings.get("acc_1G", "")
    force = f"g/{int(counts)}" if counts.isascii() and counts.isdigit() and int(counts) > 0 else ""
    rate = _rate_unit(parsed, settings)
    rows = {
        **_FIELDS,
        **{signal: ((field, sign, rate),) for signal, (field, sign) in _RATES.items()},
        **{signal: ((field, sign, force),) for signal, (field, sign) in _FORCES.items()},
    }
    for signal, each in rows.items():
        there = [(parsed[field], weight, unit) for field, weight, unit in each if field in parsed]
        known |= {header: unit for header, _, unit in there if unit and not _unit(header)}
        if there:
            found[signal] = {there[0][0]: there[0][1]}
    for signals, unit, why in (
        (_RATES, "deg/s", "the unit of the gyro is not in the file (decode with --unit-rotation deg/s and it is)"),
        (_FORCES, "g/2048", "how many counts of the accelerometer are one g is not in the file (the log's header has"
         " them as acc_1G, say 2048; decode with --unit-acceleration m/s2 and they are turned)"),
    ):  # fmt: skip
        lacking = [
            parsed[field]
            for signal, (field, _) in signals.items()
            if field in parsed and signal not in columns and not _unit(parsed[field])
            and not {signal, parsed[field]} & {*units, *known}
        ]  # fmt: skip
        if lacking:
            example = ", ".join(f"{header!r}: {unit!r}" for header in lacking)
            raise TableError(f"{name}, {why}: give units = {{{example}}}", dict.fromkeys(lacking, unit))
    return {**found, **columns}, {**known, **units}


def _rate_unit(parsed: Mapping[str, str], settings: Mapping[str, str]) -> str:
    """The unit of the gyro's counts; "" where the file does not say it."""
    tenths = settings.get("blackbox_high_resolution")
    if tenths in ("0", "1"):
        return "ddeg/s" if tenths == "1" else "deg/s"
    return "deg/s" if any(field in parsed for field in _INAV) else ""


def _field(header: str) -> str:
    """A header without its unit: "gyroADC[0] (deg/s)" -> "gyroadc[0]"."""
    return header.split(" (")[0].strip().lower()


def _unit(header: str) -> str:
    """The unit in a header's round brackets, "" for none; those in square ones are of an axis."""
    match = re.search(r"\(([^()]*)\)\s*$", header)
    return match[1] if match and is_unit(match[1]) else ""
