"""How steadily messages came: for each topic and each link when they came, and the longest time in which none did."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from gcs.recording.reader import Recording

_S = 1e9


@dataclass
class Pace:
    """Messages counted in the order of reception; times are UTC in ns, 0 before the first.

    gap_ns: the longest time without a message between two of them; gap_start_ns: when it began.
    """

    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    gap_ns: int = 0
    gap_start_ns: int = 0

    def add(self, times: np.ndarray[tuple[int], np.dtype[np.int64]]) -> None:
        """Take the next (N,) times, none before those that were taken."""
        if times.size == 0:
            return
        ordered = np.sort(times)
        if self.count:
            ordered = np.concatenate((np.array([self.last_ns]), ordered))
        else:
            self.first_ns = self.gap_start_ns = int(ordered[0])
        steps = np.diff(ordered)
        if steps.size and int(steps.max()) > self.gap_ns:
            at = int(steps.argmax())
            self.gap_ns, self.gap_start_ns = int(steps[at]), int(ordered[at])
        self.count += times.size
        self.last_ns = int(ordered[-1])

    @property
    def duration_s(self) -> float:
        """From the first to the last message."""
        return (self.last_ns - self.first_ns) / _S

    def gap(self, start_ns: int) -> tuple[float | None, float | None]:
        """The longest time without a message in s, and when it began in s after `start_ns`; None of fewer than two."""
        if self.count < 2:
            return None, None
        return self.gap_ns / _S, (self.gap_start_ns - start_ns) / _S


def paces(recording: Recording) -> tuple[dict[str, Pace], dict[str, Pace]]:
    """The pace of each topic and of each link, in one pass over the file; a topic's links are taken together."""
    topics = {topic: Pace() for topic in recording.topics()}
    links = {link: Pace() for link in recording.links()}
    for part in recording.reception_times():
        _add(topics, ((topic, times) for (topic, _), times in part.items()))
        _add(links, ((link, times) for (_, link), times in part.items()))
    return topics, links


def _add(paces: dict[str, Pace], times: Iterable[tuple[str, np.ndarray[tuple[int], np.dtype[np.int64]]]]) -> None:
    together: dict[str, list[np.ndarray[tuple[int], np.dtype[np.int64]]]] = {}
    for name, part in times:
        together.setdefault(name, []).append(part)
    for name, parts in together.items():
        paces.setdefault(name, Pace()).add(np.concatenate(parts))
