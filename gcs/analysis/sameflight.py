"""Flights that are named twice: what was fitted judges no model, and counts no more than once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.signals.flight import FlightSignals

# Measured motion: commands of a planned manoeuvre are alike in flights that have nothing else in common.
_MOTION = ("p", "q", "r", "ax", "ay", "az", "phi", "theta", "psi")
_FEWEST = 50


def repeated(fitted: Sequence[FlightSignals], judges: Sequence[FlightSignals]) -> list[str]:
    """One line for every flight that was fitted before, whatever it is called."""
    lines = []
    for index, flight in enumerate(fitted):
        before = next((other for other in fitted[:index] if same(flight, other)), None)
        if before is not None:
            lines.append(
                f"{flight.name} is the same flight as {before.name} and counts twice: the error bars are too small;"
                " name it once"
            )
    for judge in judges:
        own = next((other for other in fitted if same(judge, other)), None)
        if own is not None:
            named = "" if own.name == judge.name else f", there called {own.name}"
            lines.append(
                f"{judge.name} is a flight that the model was fitted to{named}: this is no validation on another"
                " flight; validate on one that was not fitted"
            )
    return lines


def same(one: FlightSignals, other: FlightSignals) -> bool:
    """Whether the measured motion is alike to the last bit, as far as both of them go."""
    compared = 0
    for name in _MOTION:
        if name not in one.signals or name not in other.signals:
            continue
        a, b = one.signals[name].values, other.signals[name].values
        count = min(a.size, b.size)
        if not np.array_equal(a[:count], b[:count], equal_nan=True):
            return False
        known = a[:count][np.isfinite(a[:count])]
        compared += bool(known.size >= _FEWEST and np.ptp(known) > 0.0)
    return compared > 0
