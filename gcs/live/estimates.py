"""Live identification as the service tells it: what is due, how late it is, and what it costs."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from gcs.live.signals import Samples
from sim_vehicle.vehicle import Vehicle
from sysid.live.identifier import LiveIdentifier, LiveReport
from sysid.structure import usual_size

_EVERY_S = 0.4
_SLACK_S = 0.04  # a turn of the process that comes a little early still counts
_LATENCIES = 500
_SHARE_S = 10.0


class EstimateReports:
    """Identification of one vehicle's flight, told while messages come. Times of `now_s` are monotonic."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._identifier = LiveIdentifier(vehicle)
        self._received_ns = 0
        self._fresh = False
        self._told: deque[tuple[float, float]] = deque()
        self._latencies_ms: deque[float] = deque(maxlen=_LATENCIES)

    def take(self, samples: Mapping[str, Samples], received_ns: int) -> None:
        """Samples of messages of which the newest was received at `received_ns`, UTC."""
        self._identifier.take({name: (found.time_s, found.values) for name, found in samples.items()})
        self._received_ns = received_ns
        self._fresh = True

    def due(self, now_s: float) -> dict[str, Any] | None:
        """The report by all messages so far, a little more than twice a second while they come; else None."""
        if not self._fresh or (self._told and now_s - self._told[-1][0] < _EVERY_S - _SLACK_S):
            return None
        self._fresh = False
        report = self._identifier.report()
        self._latencies_ms.append(max(time.time_ns() - self._received_ns, 0) / 1e6)
        self._told.append((now_s, time.process_time()))
        while len(self._told) > 2 and self._told[1][0] < now_s - _SHARE_S:
            self._told.popleft()
        return {**self._effort(), **report_json(report)}

    def _effort(self) -> dict[str, Any]:
        """Delay from the reception of the newest message to the estimate that holds it, and the share of one core."""
        latencies = np.array(self._latencies_ms)
        (first_s, first_cpu), (last_s, last_cpu) = self._told[0], self._told[-1]
        span = last_s - first_s
        return {
            "latency_ms": {
                "newest": float(latencies[-1]),
                "median": float(np.median(latencies)),
                "p95": float(np.percentile(latencies, 95.0)),
            },
            "updates_per_s": (len(self._told) - 1) / span if span > 0.0 else None,
            "cpu_share": (last_cpu - first_cpu) / span if span > 0.0 else None,
        }


def report_json(report: LiveReport) -> dict[str, Any]:
    """The parts of a report by name."""
    coefficients: dict[str, Any] = {}
    for name, one in report.coefficients.items():
        if one.known:
            coefficients[name] = {"value": one.value, "std": one.std, "unit": one.unit, "known": True}
            continue
        coefficients[name] = {"known": False, "why": one.why, "fly": one.fly}
        if one.std < usual_size(name):  # a first idea, with its large error bar, to watch it converge
            coefficients[name] |= {"value": one.value, "std": one.std, "unit": one.unit}
    return {
        "time_s": report.time_s if np.isfinite(report.time_s) else None,
        "coefficients": coefficients,
        "recursive_least_squares": {
            name: {"value": value, "std": std} for name, (value, std) in report.least_squares.items()
        },
        "sensors": {
            name: {"value": error.value, "std": error.std, "unit": error.unit} for name, error in report.sensors.items()
        },
        "changes": [
            {"time_s": change.time_s, "axis": change.axis, "coefficient": change.coefficient, "text": text}
            for change, text in zip(report.changes, report.sentences(), strict=True)
        ],
        "warnings": list(report.warnings),
    }
