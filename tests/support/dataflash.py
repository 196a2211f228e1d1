"""A writer of ArduPilot's onboard log format, by its rules: A3 95, type, packed fields as the FMT messages declare."""

from __future__ import annotations

import struct

HEAD = b"\xa3\x95"
FMT_TYPE = 0x80
LETTERS = {
    **{"b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "q": "q", "Q": "Q", "f": "f", "d": "d"},
    **{"n": "4s", "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B"},
}
SCALES = {"c": 100, "C": 100, "e": 100, "E": 100, "L": 10_000_000}


class DataflashWriter:
    """Builds the bytes of a log; formats are declared first, as ArduPilot does."""

    def __init__(self) -> None:
        self.data = b""
        self._types: dict[str, tuple[int, str]] = {}
        self.declare("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", FMT_TYPE)

    def declare(self, name: str, letters: str, columns: str, number: int | None = None) -> None:
        """Add a FMT message."""
        number = len(self._types) + 1 if number is None else number
        length = 3 + struct.calcsize("<" + "".join(LETTERS[letter] for letter in letters))
        self._types[name] = (number, letters)
        fields = struct.pack("<BB4s16s64s", number, length, name.encode(), letters.encode(), columns.encode())
        self.data += HEAD + bytes((FMT_TYPE,)) + fields

    def message(self, name: str, *values: float | str) -> bytes:
        """One message; scaled letters take values in their unit."""
        number, letters = self._types[name]
        packed = []
        for letter, value in zip(letters, values, strict=True):
            if isinstance(value, str):
                packed.append(value.encode())
            elif letter in SCALES:
                packed.append(round(value * SCALES[letter]))
            else:
                packed.append(value)
        return HEAD + bytes((number,)) + struct.pack("<" + "".join(LETTERS[c] for c in letters), *packed)

    def add(self, name: str, *values: float | str) -> None:
        """Append one message."""
        self.data += self.message(name, *values)
