"""What has failed or changed in flight, as the service reports it: sensors first, then the aircraft."""

from __future__ import annotations

from typing import Any

import numpy as np

from sysid.live.identifier import LiveReport
from sysid.live.recursive.causes import CauseFound
from sysid.live.recursive.change_detection import Change
from sysid.live.signals.sensor_failures import SensorFailure
from sysid.live.wording import change_sentence, change_text, failure_sentence, failure_text, named_cause

#: The cause of a change that none of the known ones explains.
UNKNOWN = "unknown"
# Other causes that are reported, the likeliest first.
_ALTERNATIVES = 3


def events_json(report: LiveReport) -> list[dict[str, Any]]:
    """Each event with its time `t` [s], `kind` (sensor, aircraft), `cause`, `probability` (None where none is
    estimated), `alternatives`, `size` and `size_std` in `unit`, None where it has none, `until` when it ended [s], and
    a sentence and a text of 50 characters.
    """
    return [*map(_of_sensor, report.failures), *map(_of_aircraft, report.changes)]


def _of_sensor(one: SensorFailure) -> dict[str, Any]:
    return {
        "t": one.time_s,
        "kind": "sensor",
        "cause": one.name,
        "probability": finite_or_none(one.probability),
        "alternatives": [],
        "size": one.size if one.unit else None,
        "size_std": finite_or_none(one.std),
        "unit": one.unit,
        "until": one.until_s,
        "signal": one.signal,
        "text": failure_sentence(one),
        "short": failure_text(one),
    }


def _of_aircraft(one: Change) -> dict[str, Any]:
    found = named_cause(one)
    others = [cause for cause in one.causes if cause is not found][:_ALTERNATIVES]
    named = {"cause": UNKNOWN, "probability": None, "size": None, "size_std": None, "unit": ""}
    return {
        "t": one.time_s,
        "kind": "aircraft",
        **(named if found is None else _of_cause(found)),
        "alternatives": [_of_cause(cause) for cause in others],
        "until": None,
        "axis": one.axis,
        "coefficient": one.coefficient,
        "text": change_sentence(one),
        "short": change_text(one),
    }


def _of_cause(one: CauseFound) -> dict[str, Any]:
    return {
        "cause": one.cause.short.lower().replace(" ", "_"),
        "probability": one.probability,
        "size": one.size,
        "size_std": finite_or_none(one.std),
        "unit": one.cause.unit,
    }


def finite_or_none(value: float) -> float | None:
    """A number as JSON may hold it."""
    return value if np.isfinite(value) else None
