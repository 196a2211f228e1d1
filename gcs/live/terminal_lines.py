"""Live estimates as lines of text, for a terminal in the field."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from gcs.live.feed import LiveFeed

# What shows at a glance whether the flight serves: stability, damping and control of each axis.
MAIN = ("CL_alpha", "CD_0", "Cm_alpha", "Cm_q", "Cm_de", "CY_beta", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr")
_EVERY_S = 2.0


class LiveLines:
    """What there is to say of a feed: the main coefficients every 2 s, each change and warning once."""

    def __init__(self, feed: LiveFeed) -> None:
        self._feed = feed
        self._next_s = 0.0
        self._number = 0
        self._time_s = 0.0
        self._said: set[str] = set()

    def due(self, now_s: float) -> Iterator[str]:
        """The lines of now; `now_s` is monotonic."""
        if now_s < self._next_s:
            return
        self._next_s = now_s + _EVERY_S
        state, problem = self._feed.state, self._feed.problem
        if problem:
            yield from self._once(problem)
        if state.estimate_number == self._number or state.identification is None:
            return
        self._number = state.estimate_number
        # Not the time of the newest signals: an estimate that is behind them must not pass for theirs.
        time_s = state.identification["time_s"] or 0.0
        if time_s < self._time_s:
            self._said.clear()  # another flight, or the vehicle was switched on again
        self._time_s = time_s
        yield coefficients_line(state.identification["coefficients"], time_s)
        for found in state.identification["events"]:
            yield from self._once(found["text"])
        for warning in state.identification["warnings"]:
            yield from self._once(warning)

    def _once(self, text: str) -> Iterator[str]:
        # The figures of a warning move from report to report; it is the same warning.
        key = "".join(letter for letter in text if not letter.isdigit())
        if key not in self._said:
            self._said.add(key)
            yield text


def coefficients_line(coefficients: Mapping[str, Any], time_s: float) -> str:
    """One line: how many are known, and the main ones of them with one standard error."""
    known = {name: entry for name, entry in coefficients.items() if entry["known"]}
    shown = (f"{name} {_plus_minus(known[name])}" for name in MAIN if name in known)
    return "  ".join([f"{time_s:6.1f} s  {len(known)} of {len(coefficients)} known", *shown])


def _plus_minus(entry: Mapping[str, float]) -> str:
    """Both to the second figure of the standard error."""
    std = entry["std"]
    places = min(max(1 - math.floor(math.log10(std)), 0), 9) if std > 0.0 else 4
    return f"{entry['value']:.{places}f}±{std:.{places}f}"
