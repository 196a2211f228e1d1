"""Flights as a live estimator gets them, and flights in which something breaks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sysid.live.posterior_window import WindowEstimate
from sysid.signals.flight import FlightSignals

Array = NDArray[np.float64]


class Here:
    """Where windows are estimated: at once, at a cost that does not depend on the machine, and decides when the next
    one is due.
    """

    def submit(self, function: Callable[..., WindowEstimate], /, *arguments: object) -> Future[WindowEstimate]:
        """What it gives."""
        promise: Future[WindowEstimate] = Future()
        try:
            promise.set_result(replace(function(*arguments), cost_s=0.4))
        except EOFError as error:
            promise.set_exception(error)
        return promise


def pieces(signals: FlightSignals, length_s: float) -> Iterator[dict[str, tuple[Array, Array]]]:
    """The samples of each stretch of time: name -> stamps and values."""
    end = max(float(signal.time_s[-1]) for signal in signals.signals.values())
    edges = np.arange(0.0, end + length_s, length_s) - 1e-6
    cuts = {name: np.searchsorted(signal.time_s, edges) for name, signal in signals.signals.items()}
    for k in range(edges.size - 1):
        yield {
            name: (signal.time_s[cuts[name][k] : cuts[name][k + 1]], signal.values[cuts[name][k] : cuts[name][k + 1]])
            for name, signal in signals.signals.items()
        }


def half_elevator(signals: FlightSignals, time_s: float) -> FlightSignals:
    """The same motion told with an elevator command twice as large from `time_s` on.

    It is the flight of an aircraft of which, from then on, half of what is commanded arrives at the elevator.
    """
    return _told(signals, time_s, 2.0)


def stuck_elevator(signals: FlightSignals, other: FlightSignals, time_s: float) -> FlightSignals:
    """A flight whose elevator rests, told with the elevator command of `other` from `time_s` on: it is stuck."""
    elevator = signals.signals["de"]
    command = other.signals["de"].values[: elevator.values.size]
    values = np.where(elevator.time_s >= time_s, command, elevator.values)
    return FlightSignals(signals.name, {**signals.signals, "de": replace(elevator, values=values)})


def _told(signals: FlightSignals, time_s: float, factor: float) -> FlightSignals:
    elevator = signals.signals["de"]
    trim = float(np.median(elevator.values))
    after = trim + factor * (elevator.values - trim)
    values = np.where(elevator.time_s >= time_s, after, elevator.values)
    return FlightSignals(signals.name, {**signals.signals, "de": replace(elevator, values=values)})
