"""Which column of a table is which signal, and in which unit: by what the user says, else by its header."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from sysid.errors import TableError
from sysid.tables.names import SIGNAL_UNITS, TIME, UNIT_OF_NAME, USUAL_NAMES, USUAL_PAIRS, plain
from sysid.tables.units import Unit, is_unit, unit_of, usual_units

#: How a time's unit is written that nobody said.
TAKEN_FOR_SECONDS = "s, as nothing else is said"
#: What `units` says where every column without a unit is in SI.
ALL_SI = "SI"
# Short words at the end of a name that are units there; any other is part of the name (rudder_r, vel_n, aileron_in).
_SHORT_UNITS = {"g", "m", "s", "pa", "us", "ms", "kt", "kn", "ft"}


@dataclass(frozen=True)
class ColumnUse:
    """What a signal is made from: the sum of weight * column, in one unit.

    headers, weights: columns of the table and what each counts. written: the unit as it was found.
    """

    signal: str
    headers: tuple[str, ...]
    weights: tuple[float, ...]
    unit: Unit
    written: str

    @property
    def sentence(self) -> str:
        """Column and unit in words: "alpha: column 'Alpha (deg)', deg"."""
        columns = " ".join(
            f"{'' if weight == 1.0 else f'{weight:+g} '}{header!r}"
            for header, weight in zip(self.headers, self.weights, strict=True)
        )
        return f"{self.signal}: column {columns}, {self.written}"


@dataclass(frozen=True)
class Matched:
    """Columns of a table: its time, what becomes a signal, and what is not used."""

    time: ColumnUse
    uses: tuple[ColumnUse, ...]
    unused: tuple[str, ...]


#: One column, several with weights, or the number of a column (from 0) where there are no headers.
Wanted = str | int | Mapping[str, float]


def match_columns(
    headers: Sequence[str],
    columns: Mapping[str, Wanted] | None = None,
    units: Mapping[str, str] | str | None = None,
) -> Matched:
    """Find the columns of a table.

    Parameters
    ----------
    headers : Sequence[str]
        Headers as they stand in the table.
    columns : Mapping[str, str | int | Mapping[str, float]] | None
        Signal (or "time") -> its header, the number of its column from 0, or headers with weights. Signals that are not
        named are looked for by their usual names.
    units : Mapping[str, str] | str | None
        Signal or header -> unit, where a header does not say it, or says it wrongly; "SI" where all the others are in
        SI units and radians.

    Returns
    -------
    Matched
        Time, signals and unused columns.

    Raises
    ------
    TableError
        Where there is no time, a named column is not there, or a unit is not known. All columns whose unit is missing
        are named at once.
    """
    given = dict(columns or {})
    _check_names(given, units, headers)
    parsed = {header: split_header(header) for header in headers}
    by_name: dict[str, list[str]] = {}
    for header, (name, _) in parsed.items():
        for known_as in dict.fromkeys((name, plain(header))):
            by_name.setdefault(known_as, []).append(header)
    found: dict[str, tuple[tuple[str, ...], tuple[float, ...]]] = {}
    for signal in (TIME, *SIGNAL_UNITS):
        if signal in given:
            found[signal] = _named(signal, given[signal], headers)
    taken = {header for heads, _ in found.values() for header in heads}
    for signal, names in USUAL_NAMES.items():
        if signal in found:
            continue
        called = [header for name in names for header in by_name.get(name, []) if header not in taken]
        able = [header for header in called if _may_be(signal, parsed[header][1], header, units)]
        with_unit = [header for header in able if _unit_text(signal, (header,), parsed, units) is not None]
        pairs = [
            (by_name[left][0], by_name[right][0])
            for left, right in USUAL_PAIRS.get(signal, ())
            if left in by_name and right in by_name and _may_be(signal, parsed[by_name[left][0]][1], left, units)
        ]
        if with_unit or (able and not pairs):
            found[signal] = (((with_unit or able)[0],), (1.0,))
        elif pairs:
            found[signal] = (pairs[0], (0.5, -0.5))
        taken.update(found[signal][0] if signal in found else ())
    if TIME not in found:
        raise TableError(
            f"no column is the time: name it, as columns = {{'time': ...}}; columns are {_listed(headers)}"
        )
    # A table's own time has a unit that can be checked: its steps.
    uses, lacking = [], []
    for signal, (heads, weights) in found.items():
        written = _unit_text(signal, heads, parsed, units)
        if written is None:
            lacking.append(heads[0])
            continue
        unit = unit_of("s" if written == TAKEN_FOR_SECONDS else written, _si(signal), heads[0])
        each = [_unit_text(signal, (head,), parsed, units) or written for head in heads]
        for place, text in enumerate(each[1:], 1):
            # Columns of one signal may be in several units; those with a zero of their own add up to nothing.
            other = unit_of(text, _si(signal), heads[place])
            if other.offset != unit.offset:
                raise TableError(f"{signal}: {heads[0]!r} and {heads[place]!r} are in units that do not add up")
            weights = (*weights[:place], weights[place] * other.factor / unit.factor, *weights[place + 1 :])
        uses.append(ColumnUse(signal, heads, weights, unit, written))
    if lacking:
        usual = {header: usual_units(_si(_signal_of(found, header)))[:2][-1] for header in lacking}
        example = ", ".join(f"{header!r}: {unit!r}" for header, unit in list(usual.items())[:3])
        raise TableError(
            f"the unit of {_listed(lacking)} is not known: give units = {{{example}, ...}}, or units = 'SI' where"
            " all others are in SI units and radians",
            usual,
        )
    (time,) = (use for use in uses if use.signal == TIME)
    unused = tuple(header for header in headers if header not in taken)
    return Matched(time, tuple(use for use in uses if use.signal != TIME), unused)


def split_header(header: str) -> tuple[str, str]:
    """Name, as the dictionary spells it, and unit, "" where the header says none.

    Reads "Alpha (deg)", "alpha [deg]", "alpha_deg", "p_rad_s", JSBSim's "/fdm/jsbsim/velocities/p-rad_sec" and
    X-Plane's "alpha,__deg ".
    """
    text = " ".join(header.split())
    text = re.sub(r" ?\.\d+$", "", text)  # what pandas adds to a header that stands twice
    if match := re.fullmatch(r"([^\[(]*(?:[\[(][^\[\]()]*[\])][^\[(]*)*)[\[(]([^\[\]()]*)[\])]", text):
        return plain(match[1]), "" if match[2].strip().isdigit() or not is_unit(match[2]) else match[2].strip()
    if text.count(",") == 1:
        name, unit = (part.strip().strip("_").strip() for part in text.split(","))
        if is_unit(unit):
            return plain(name), unit
    last = text.rsplit("/", 1)[-1] if text.count("/") > 0 and not is_unit(text) else text
    if "-" in last and is_unit(last.rsplit("-", 1)[1]):
        name, unit = last.rsplit("-", 1)
        return plain(name), unit
    words = last.split("_")
    for count in (3, 2, 1):
        unit = "_".join(words[-count:])
        if len(words) > count and is_unit(unit) and (len(unit) > 2 or unit.lower() in _SHORT_UNITS):
            return plain("_".join(words[:-count])), unit
    return plain(last), ""


def _si(signal: str) -> str:
    return "s" if signal == TIME else SIGNAL_UNITS[signal]


def _listed(names: Iterable[str]) -> str:
    names = list(names)
    more = f" and {len(names) - 12} more" if len(names) > 12 else ""
    return ", ".join(names[:12]) + more


def _signal_of(found: Mapping[str, tuple[tuple[str, ...], tuple[float, ...]]], header: str) -> str:
    return next(signal for signal, (heads, _) in found.items() if header in heads)


def _check_names(given: Mapping[str, Wanted], units: Mapping[str, str] | str | None, headers: Sequence[str]) -> None:
    """Whatever is said must be of something that exists."""
    known = (TIME, *SIGNAL_UNITS)
    for signal in given:
        if signal not in known:
            near = difflib.get_close_matches(signal, known, 2, 0.5)
            meant = (
                f"did you mean {' or '.join(near)}?" if near else f"signals are {', '.join(known[:-16])}, servo1 to 16"
            )
            raise TableError(f"columns: {signal!r} is no signal; {meant}")
    if isinstance(units, str):
        if units != ALL_SI:
            raise TableError(f"units: give a unit for each column, or 'SI' for all of them, not {units!r}")
        return
    for name, unit in (units or {}).items():
        if not isinstance(unit, str):
            raise TableError(f"units: that of {name} is {unit!r}; give a text, as 'deg'")
        if name not in known and name not in headers:
            near = difflib.get_close_matches(name, [*headers, *known], 2, 0.5)
            meant = f"did you mean {' or '.join(near)}?" if near else f"columns are {_listed(headers)}"
            raise TableError(f"units: {name!r} is neither a column nor a signal; {meant}")


def _named(signal: str, wanted: Wanted, headers: Sequence[str]) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """The headers and weights that a user names."""
    if isinstance(wanted, int):
        if not 0 <= wanted < len(headers):
            raise TableError(f"columns: {signal} is column {wanted}, and the table has 0 to {len(headers) - 1}")
        return (headers[wanted],), (1.0,)
    weights = {wanted: 1.0} if isinstance(wanted, str) else dict(wanted)
    if not weights or not all(isinstance(one, int | float) for one in weights.values()):
        raise TableError(f"columns: {signal} needs a header, a number, or headers with a number as weight each")
    exact = {header.strip(): header for header in headers}
    for header in weights:
        if header.strip() not in exact:
            near = difflib.get_close_matches(header, headers, 3, 0.4)
            meant = f"did you mean {' or '.join(map(repr, near))}?" if near else f"it has {_listed(headers)}"
            raise TableError(f"columns: {signal} is {header!r}, which the table does not have; {meant}")
    return tuple(exact[header.strip()] for header in weights), tuple(weights.values())


def _may_be(signal: str, written: str, header: str, units: Mapping[str, str] | str | None) -> bool:
    """Whether a column's own unit is one of the signal: an elevator in parts of its travel is no angle."""
    if not written or (isinstance(units, Mapping) and (signal in units or header in units)):
        return True
    try:
        unit_of(written, _si(signal), header)
    except TableError:
        return False
    return True


def _unit_text(
    signal: str,
    heads: Sequence[str],
    parsed: Mapping[str, tuple[str, str]],
    units: Mapping[str, str] | str | None,
) -> str | None:
    """The unit of a signal's columns as somebody wrote it; None where nobody did."""
    if isinstance(units, Mapping):
        said = [units[name] for name in (signal, *heads) if name in units]
        if said:
            return said[0]
    name, written = parsed[heads[0]]
    if written:
        return written
    implied = UNIT_OF_NAME.get(name) or UNIT_OF_NAME.get(plain(heads[0]))
    if implied is not None:
        return implied
    # A time without a unit is seconds where its steps are a flight's; that is looked at where the values are.
    if signal == TIME and units != ALL_SI:
        return TAKEN_FOR_SECONDS
    return _si(signal) if signal in (TIME, "throttle") or units == ALL_SI else None
