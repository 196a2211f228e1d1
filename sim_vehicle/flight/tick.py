"""One control tick, as the flight hands it to whoever sends or records it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sim_vehicle.flight.sensor_suite import Reading


@dataclass(frozen=True)
class Tick:
    """One control tick: what was read at `time_s` (s since the flight's first sample), and what then went to
    the servos.

    servos: output number -> pulse width, us. throttle: 0 to 1.
    """

    time_s: float
    reading: Reading
    servos: Mapping[int, int]
    throttle: float
    armed: bool
