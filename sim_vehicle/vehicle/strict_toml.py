"""Reading a TOML table strictly: every key is asked for, and a key nobody asked for is an error."""

from __future__ import annotations

import difflib
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from sim_vehicle.errors import VehicleFileError

# Alike enough to be a slip: "mas" is "mass" (0.86), "Ixz" is not "Ixx" (0.67).
_NEAR = 0.75
_LARGEST = sys.float_info.max


@dataclass(frozen=True)
class Known:
    """A quantity as far as a vehicle file gives it: its value, and its standard deviation; None where it is silent."""

    value: float | None = None
    std: float | None = None


NOT_SAID = Known()


class Table:
    """One table of a vehicle file, whose every error is one line naming file and key.

    data: the table as tomllib gives it. file: the file's name for errors. where: dotted path of the table.
    """

    def __init__(self, data: Mapping[str, object], file: str, where: str = "") -> None:
        self._data = data
        self._file = file
        self._where = where
        self._known: list[str] = []

    def __contains__(self, key: str) -> bool:
        return key in self._data

    def __iter__(self) -> Iterator[str]:
        return iter(self._data)

    def path(self, key: str) -> str:
        """Dotted path of `key` from the top of the file."""
        return f"{self._where}.{key}" if self._where else key

    def error(self, key: str, problem: str) -> VehicleFileError:
        """The error that says what is wrong with `key`, to be raised by the caller."""
        return VehicleFileError(f"{self._file}: {self.path(key)} {problem}")

    def _take(self, key: str) -> object:
        self._known.append(key)
        if key not in self._data:
            raise self.error(key, f"is missing{self._instead_of(key)}")
        return self._data[key]

    def _instead_of(self, key: str) -> str:
        """What stands where `key` is missing and is spelt nearly like it, as a part of a sentence."""
        others = {other.casefold(): other for other in self._data if other not in self._known}
        near = difflib.get_close_matches(key.casefold(), others, 1, _NEAR)
        return f"; {others[near[0]]} is not a key of a vehicle file, did you mean {key}?" if near else ""

    def optional(self, key: str) -> bool:
        """Declare `key` as known and return whether it is there."""
        self._known.append(key)
        return key in self._data

    def number(
        self, key: str, default: float | None = None, *, above: float = -math.inf, low: float = -math.inf
    ) -> float:
        """A finite number > `above` and >= `low`; `default` where absent, None meaning demanded."""
        if default is not None and not self.optional(key):
            return default
        value = self._finite(key, self._take(key))
        if not value > above or value < low:
            limit = f"greater than {above:g}" if not value > above else f"at least {low:g}"
            raise self.error(key, f"is {value:g}; it must be {limit}")
        return value

    def _finite(self, key: str, value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _LARGEST:
            raise self.error(key, f"is {value!r}; it must be a finite number")
        return float(value)

    def optional_number(self, key: str, *, above: float = -math.inf, low: float = -math.inf) -> float | None:
        """As `number`, and None where the key is absent."""
        return self.number(key, above=above, low=low) if self.optional(key) else None

    def known(self, key: str) -> Known:
        """A number and, under the key with `_std` behind it, its standard deviation; either may be absent."""
        return Known(self.optional_number(key), self.optional_number(f"{key}_std", low=0.0))

    def text(self, key: str, default: str | None = None, choices: Sequence[str] = ()) -> str:
        """A text, one of `choices` if any are given; `default` where absent, None meaning demanded."""
        if default is not None and not self.optional(key):
            return default
        value = self._take(key)
        if not isinstance(value, str) or not value:
            raise self.error(key, f"is {value!r}; it must be a text in quotes")
        if choices and value not in choices:
            raise self.error(key, f"is {value!r}; it must be one of {', '.join(choices)}")
        return value

    def numbers(self, key: str) -> tuple[float, ...]:
        """A list of finite numbers."""
        value = self._take(key)
        if not isinstance(value, list) or not value:
            raise self.error(key, f"is {value!r}; it must be a list of numbers")
        return tuple(self._finite(key, item) for item in value)

    def vector(self, key: str) -> tuple[float, float, float]:
        """Three finite numbers, [0, 0, 0] where absent."""
        if not self.optional(key):
            return (0.0, 0.0, 0.0)
        values = self.numbers(key)
        if len(values) != 3:
            raise self.error(key, f"has {len(values)} numbers; it must have three: [x, y, z]")
        return (values[0], values[1], values[2])

    def rows(self, key: str) -> tuple[tuple[float, ...], ...]:
        """A list of lists of numbers."""
        value = self._take(key)
        if not isinstance(value, list) or not value or not all(isinstance(row, list) and row for row in value):
            raise self.error(key, f"is {value!r}; it must be a list of lists of numbers")
        return tuple(tuple(self._finite(key, item) for item in row) for row in value)

    def is_nested(self, key: str) -> bool:
        """Whether `key` holds a list of lists."""
        value = self._data.get(key)
        return isinstance(value, list) and bool(value) and isinstance(value[0], list)

    def is_list(self, key: str) -> bool:
        """Whether `key` holds a list."""
        return isinstance(self._data.get(key), list)

    def is_table(self, key: str) -> bool:
        """Whether `key` holds a table."""
        return isinstance(self._data.get(key), dict)

    def is_text(self, key: str) -> bool:
        """Whether `key` holds a string."""
        return isinstance(self._data.get(key), str)

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of texts."""
        value = self._take(key)
        if not isinstance(value, list) or not all(isinstance(one, str) for one in value):
            raise self.error(key, f"is {value!r}; it must be a list of names")
        return tuple(value)

    def table(self, key: str, *, demanded: bool = False) -> Table:
        """A table below this one; an empty one where absent unless `demanded`."""
        if not demanded and not self.optional(key):
            return Table({}, self._file, self.path(key))
        value = self._take(key)
        if not isinstance(value, dict):
            raise self.error(key, f"is {value!r}; it must be a table: [{self.path(key)}] or {{ key = value }}")
        return Table(value, self._file, self.path(key))

    def close(self) -> None:
        """Raise VehicleFileError for a key that was never asked for, naming the nearest one that exists."""
        for key in self._data:
            if key not in self._known:
                near = difflib.get_close_matches(key, self._known, 1)
                hint = (
                    f"; did you mean {near[0]}?" if near else f"; known here: {', '.join(dict.fromkeys(self._known))}"
                )
                raise self.error(key, f"is not a key of a vehicle file{hint}")
