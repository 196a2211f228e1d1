"""Bounds of the text of a vehicle file: the memory that TOML takes grows with the square of some texts."""

from __future__ import annotations

import re

from sim_vehicle.errors import VehicleFileError

# Far beyond what any aircraft needs. Dots: of one key; and so many keys may have any.
_MOST_LINES, _MOST_DOTS, _MOST_DOTTED, _DEEPEST = 20_000, 8, 50, 32
# Remarks and texts, which may hold anything, and what counts. The end of a text is not demanded: nothing is looked at
# twice. Of the three quotes that end one two more may belong to it.
_PART = re.compile(
    r'''\#[^\r\n]*+
    |"""(?:[^"\\]++|\\.|"(?!""))*+(?:"{3,5})?
    |\'\'\'(?:[^']++|'(?!\'\'))*+(?:'{3,5})?
    |"(?:[^"\\\r\n]++|\\.)*+"?
    |'[^'\r\n]*+'?
    |[][{}.,=\r\n]''',
    re.VERBOSE | re.DOTALL,
)


def check_bounds(text: str, name: str) -> None:
    """Raise VehicleFileError for a text of more lines, dots in a key or brackets within one another than are read.

    To be asked before anything reads the text as TOML. name: of the file, for the error.
    """
    if text.count("\n") > _MOST_LINES:
        raise VehicleFileError(f"{name}: is not a vehicle file: it has more than {_MOST_LINES} lines; leave some out")
    dots = dotted = depth = 0
    for part in _PART.finditer(text):
        first, wrong = part[0][0], ""
        if first == ".":
            dots += 1
        elif first in "[]{},=\r\n":
            dotted += first == "=" and dots > 0
            dots = 0
            depth += (first in "[{") - (first in "]}")
        if dots > _MOST_DOTS:
            wrong = f"a key has more than {_MOST_DOTS} dots"
        elif dotted > _MOST_DOTTED:
            wrong = f"more than {_MOST_DOTTED} keys have dots"
        elif depth > _DEEPEST:
            wrong = "its lists are nested too deep"
        if wrong:
            line = text.count("\n", 0, part.start()) + 1
            raise VehicleFileError(f"{name}: is not a vehicle file: {wrong} in line {line}; take that out")
