"""Live estimates as MAVLink, for a ground station beside this one: named values, and texts of what has changed.

They come from this station's own system and a component of its own, never from the vehicle's.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import common

from gcs.station.own_sender import StationVoice

COMPONENT = common.MAV_COMP_ID_USER1
_EVERY_S = 1.0
_NAME_BYTES, _TEXT_BYTES = 10, 50
_MOST_TEXTS = 100
_FIGURES = re.compile(r"[-+\d.]+")


class EstimateTelemetry:
    """Says reports of live identification through `say`, which takes frames. key: signs them."""

    def __init__(
        self,
        say: Callable[[Sequence[bytes]], None],
        key: bytes | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._say = say
        self._clock = clock
        self._voice = StationVoice(key, COMPONENT)
        self._due_s = -math.inf
        self._time_s = self._said_s = -math.inf
        self._values: dict[str, Any] = {}
        self._texts: dict[str, None] = {}
        self._number = 0

    def take(self, report: dict[str, Any], time_s: float) -> None:
        """One report and the flight's time, s: known coefficients about once a second, each text once.

        A second of the clock, not of the flight, whose time stands still once it is over: what it ended with may come
        seconds behind the last of its messages, and is sent as it comes.
        """
        if time_s < self._time_s:  # another flight
            self._texts.clear()
        frames = [frame for text, severity in _texts(report) for frame in self._text(text, severity)]
        values = {name: entry["value"] for name, entry in report["coefficients"].items() if entry["known"]}
        now_s = self._clock()
        over, self._time_s = time_s == self._time_s, time_s
        if (over or now_s >= self._due_s) and (time_s, values) != (self._said_s, self._values):
            self._due_s = now_s + _EVERY_S
            self._said_s, self._values = time_s, values
            frames += [self._value(name, value, time_s) for name, value in values.items()]
        self._say(frames)

    def _value(self, name: str, value: float, time_s: float) -> bytes:
        stamp = round(time_s * 1000.0) % 2**32
        return self._voice.frame(
            common.MAVLink_named_value_float_message(stamp, name.encode()[:_NAME_BYTES], float(value))
        )

    def _text(self, text: str, severity: int) -> list[bytes]:
        """A text that was not said before, in as many pieces as it takes (MAVLink's `id` and `chunk_seq`)."""
        # The figures of a warning move from report to report; it is the same warning.
        key = _FIGURES.sub("", text) if severity == common.MAV_SEVERITY_WARNING else text
        if key in self._texts or len(self._texts) >= _MOST_TEXTS:
            return []
        self._texts[key] = None
        data = text.encode("ascii", "replace")
        pieces = [data[i : i + _TEXT_BYTES] for i in range(0, len(data), _TEXT_BYTES)]
        self._number = self._number % 65535 + 1
        number = self._number if len(pieces) > 1 else 0
        return [
            self._voice.frame(common.MAVLink_statustext_message(severity, piece, number, i))
            for i, piece in enumerate(pieces)
        ]


def _texts(report: dict[str, Any]) -> list[tuple[str, int]]:
    events = report["events"]
    short = [(one["short"], common.MAV_SEVERITY_CRITICAL) for one in events]
    return [*short, *((text, common.MAV_SEVERITY_WARNING) for text in report["warnings"])]
