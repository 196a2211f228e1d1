"""A filter that takes the motion for noise has named nothing, whatever gained."""

from __future__ import annotations

from typing import Any

import pytest

from sysid.discrepancy.innovations import comparison
from sysid.discrepancy.innovations.comparison import InnovationsComparison


class _Fit:
    problem: Any = None
    at: Any = None


def test_where_noise_stands_for_the_motion_the_filter_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """A propeller's torque was named for an asymmetry, with 86 % of what could be explained and 372 times the noise."""
    found: dict[str, tuple[float, float]] = {"p": (372.6, 13.9), "q": (29.8, 82.5), "r": (1.1, 1.0)}
    monkeypatch.setattr(comparison, "beyond_sensors", lambda problem, setting: found)
    nothing, fit = [None] * 9, _Fit()
    made: Any = InnovationsComparison
    lost = "the filter does not follow the flight: noise of p is 373 times the sensor's"
    assert made(*nothing).lost(fit) == lost
    # Smoothed by an autopilot, white all the same; and coloured, but hardly beyond its sensor.
    found |= {"p": (372.6, 1.1), "q": (9.0, 82.5)}
    assert made(*nothing).lost(fit) == ""
