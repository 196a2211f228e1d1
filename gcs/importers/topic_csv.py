"""One topic's CSV: columns of numbers and of words, and its stamps in seconds."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import ImportFileError

Values = NDArray[np.float64]
# What `rostopic echo -p` writes before every field.
_PREFIX = "field."
_NANOSECONDS = 1e-9


@dataclass(frozen=True)
class TopicTable:
    """A topic. numbers, words: header -> (N,) of each row. stem: its file's name."""

    stem: str
    numbers: Mapping[str, Values]
    words: Mapping[str, Sequence[str]]

    @property
    def is_stamped(self) -> bool:
        """Whether its messages have stamps of their own."""
        return self._stamped() is not None

    def stamp_s(self) -> Values | None:
        """(N,) s of its messages: their stamps, else their reception; None for no topic of ROS, or one without a row.

        By `rostopic echo -p` in ns, by bagpy in seconds and nanoseconds apart.
        """
        own = self._stamped()
        return self._received() if own is None else own

    def late_s(self) -> Values | None:
        """(N,) s from stamp to reception, where both are there."""
        own, received = self._stamped(), self._received()
        return None if own is None or received is None else received - own

    def fields(self) -> dict[str, Sequence[Any]]:
        """Field -> (N,) values, but those of the reception."""
        every: dict[str, Sequence[Any]] = {**{key: one.tolist() for key, one in self.numbers.items()}, **self.words}
        return {key.removeprefix(_PREFIX): one for key, one in every.items() if key not in ("%time", "Time")}

    def _stamped(self) -> Values | None:
        for prefix in (_PREFIX, ""):
            whole = self.numbers.get(f"{prefix}header.stamp")
            if whole is not None:
                return self._known(whole * _NANOSECONDS)
            parts = [self.numbers.get(f"{prefix}header.stamp.{part}") for part in ("secs", "nsecs")]
            if parts[0] is not None and parts[1] is not None:
                return self._known(parts[0] + parts[1] * _NANOSECONDS)
        return None

    def _received(self) -> Values | None:
        ns, seconds = self.numbers.get("%time"), self.numbers.get("Time")
        return self._known(ns * _NANOSECONDS) if ns is not None else None if seconds is None else self._known(seconds)

    @staticmethod
    def _known(times: Values) -> Values | None:
        """Times that are some: a header that nobody filled in says 0."""
        return times if times.size and np.isfinite(times).all() and bool((times > 0.0).all()) else None


def read_topic(path: Path) -> TopicTable:
    """Read a topic's CSV; ImportFileError in one line where it is none. Without rows its columns are empty."""
    try:
        with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
            rows = [row for row in csv.reader(file) if row]
    except OSError as error:
        raise ImportFileError(f"{path} cannot be read: {error.strerror or error}") from None
    except csv.Error as error:
        raise ImportFileError(f"{path} is no CSV: {error}") from None
    headers = [cell.strip() for cell in rows[0]] if rows else []
    body = rows[1:]
    # A copy that was interrupted ends within a row.
    if body and len(body[-1]) < len(headers):
        body.pop()
    wrong = next((number for number, row in enumerate(body, 2) if len(row) != len(headers)), None)
    if wrong is not None:
        raise ImportFileError(
            f"{path}: row {wrong} has {len(body[wrong - 2])} cells, the header {len(headers)}; export the topic anew"
        )
    numbers: dict[str, Values] = {}
    words: dict[str, Sequence[str]] = {}
    for place, header in enumerate(headers):
        cells = [row[place].strip() for row in body]
        try:
            numbers[header] = np.array([float(cell) if cell else np.nan for cell in cells])
        except ValueError:
            words[header] = cells
    return TopicTable(path.stem, numbers, words)


__all__ = ["TopicTable", "read_topic"]
