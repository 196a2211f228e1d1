"""Live identification as the service reports it: what is due, how late it is, and what it costs."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from gcs.live.events import events_json, finite_or_none
from gcs.live.signals import Samples
from gcs.text.nuisance_text import unknown_words
from sim_vehicle.vehicle.vehicle_file import Vehicle
from sysid.arrays import Array, IntArray
from sysid.live.identifier import LiveIdentifier, LiveReport
from sysid.live.posterior_window import Runner
from sysid.posterior.estimates import NuisanceEstimate
from sysid.problem.model_structure import usual_size

# A report has words and is sent to whoever listens; in between only values and standard errors are.
_EVERY_S = 0.4
# Without a message for so long a flight may be over: what it ended with is estimated.
_SILENT_S = 1.0
_SLACK_S = 0.02  # a turn of the process that comes a little early still counts
# Effort is reported over this time.
_SHARE_S = 10.0
# A message so far behind the newest of which no row has been made is in no estimate: its row was left out.
_LEFT_OUT_S = 1.0
# Of what stands between aircraft and log that counts as estimated which is known so much better than before.
ESTIMATED_SHARE = 0.5
# Most stamps are whole milliseconds.
_SAME_S = 1.001e-3


class EstimateReports:
    """Identification of one vehicle's flight, reported while messages come. Times of `now_s` are monotonic.

    runner: as of LiveIdentifier.
    """

    def __init__(self, vehicle: Vehicle, runner: Runner | None = None) -> None:
        self._identifier = LiveIdentifier(vehicle, runner)
        # Messages are in no estimate yet; estimates have been made that no report holds.
        self._fresh = self._owed = False
        self._reported_s, self._heard_s = -np.inf, np.inf
        self._waiting: list[Array] = []
        # Of each estimate: when, monotonic, the process' time, s, and the delay of each message that it is the first
        # to hold, ms.
        self._made: deque[tuple[float, float, Array]] = deque()

    def take(self, samples: Mapping[str, Samples], time_s: Array, received_ns: IntArray) -> None:
        """Samples of messages. time_s, received_ns: (N,) of each message, on the vehicle's clock and UTC."""
        self._identifier.take({name: (found.time_s, found.values) for name, found in samples.items()})
        self._waiting.append(np.array([time_s, received_ns]))
        self._fresh = True

    def update(self, now_s: float) -> dict[str, Any] | None:
        """Values and standard errors by all messages so far; None where nothing new is known."""
        if not self._fresh:
            return None
        values = self._identifier.update()
        self._owed = True
        self._note(now_s)
        return {"time_s": finite_or_none(self._identifier.time_s), "values": values} if values else None

    def due(self, now_s: float) -> dict[str, Any] | None:
        """The report by all messages so far, a little more than twice a second while they come; else None, but for what
        was estimated since the last report and what still comes of the last messages.
        """
        if self._fresh:
            self._heard_s = now_s
        elif now_s > self._heard_s + _SILENT_S:
            self._identifier.finish()
        if (
            not (self._fresh or self._owed or self._identifier.has_news)
            or now_s - self._reported_s < _EVERY_S - _SLACK_S
        ):
            return None
        self._reported_s, self._owed = now_s, False
        report = self._identifier.report()
        if self._fresh:
            self._note(now_s)
        return {**self._effort(), **report_json(report)}

    def _note(self, now_s: float) -> None:
        """An estimate has been made: how long ago the messages came that it is the first to hold."""
        self._fresh = False
        stamps, received = np.concatenate(self._waiting, axis=1)
        row_s, newest_s = self._identifier.time_s, float(stamps.max())
        held, counts = stamps <= row_s + _SAME_S, stamps > newest_s - _LEFT_OUT_S
        delays = np.maximum(time.time_ns() - received[held & counts], 0.0) / 1e6
        later = ~held & counts
        self._waiting = [np.array([stamps[later], received[later]])]
        self._made.append((now_s, time.process_time() + self._identifier.cost_elsewhere_s, delays))
        while len(self._made) > 2 and self._made[1][0] < now_s - _SHARE_S:
            self._made.popleft()

    def _effort(self) -> dict[str, Any]:
        """Delay from the reception of a message to the first estimate that holds it, and the share of one core."""
        (first_s, first_cpu, _), (last_s, last_cpu, _) = self._made[0], self._made[-1]
        span = last_s - first_s
        delays = np.concatenate([delays for _, _, delays in self._made])
        latency = None
        if delays.size:
            median, p95 = np.percentile(delays, (50.0, 95.0))
            latency = {"median": float(median), "p95": float(p95), "messages": delays.size}
        return {
            "latency_ms": latency,
            "updates_per_s": (len(self._made) - 1) / span if span > 0.0 else None,
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
        "time_s": finite_or_none(report.time_s),
        "coefficients": coefficients,
        "sensors": {
            name: {"value": error.value, "std": error.std, "unit": error.unit} for name, error in report.sensors.items()
        },
        "events": events_json(report),
        "nuisances": [_nuisance(one) for one in report.nuisances],
        "warnings": list(report.warnings),
    }


def _nuisance(one: NuisanceEstimate) -> dict[str, Any]:
    """The entry of a result file, its words and its figures in the unit that one thinks in."""
    entry = one.to_json()
    text, unit, factor = unknown_words(entry)
    shown = {"value": factor * one.value, "std": factor * one.std, "unit": unit}
    return {
        **entry,
        "text": f"{text}, {one.group}",
        "shown": shown,
        "estimated": one.std < ESTIMATED_SHARE * one.prior_std,
    }
