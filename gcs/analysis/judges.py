"""Flights that are to judge a model, beside those that it was fitted to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.flight import FlightSignals


def judged_by_itself(flights: Sequence[FlightSignals], judges: Sequence[FlightSignals]) -> list[str]:
    """A warning for each judge that is one of the flights, whatever its file is called."""
    return [
        f"{judge.name} holds the same samples as {flight.name}, to which the model is fitted: its validation says "
        "nothing of another flight; give one that was not fitted"
        for judge in judges
        for flight in flights
        if _same(flight, judge)
    ]


def _same(one: FlightSignals, other: FlightSignals) -> bool:
    names = one.signals.keys() & other.signals.keys()
    return bool(names) and all(
        np.array_equal(one.signals[name].values, other.signals[name].values, equal_nan=True) for name in names
    )
