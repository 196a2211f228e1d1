"""Flights of JSBSim's as the telemetry of an autopilot: rows that `other_aircraft` makes messages of."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jsbsim_flight import Aircraft, fly, measure
from other_aircraft import DENSITY, Row

# What one microsecond of a servo's pulse moves, rad; of the throttle's it is the same number of its full travel.
PER_PULSE = 0.001
# Output of each control, and which way it turns.
SERVOS = {"da": (1, 1), "de": (2, -1), "dr": (4, -1)}
THROTTLE = 3


def telemetry(folder: Path, aircraft: Aircraft, seed: int, seconds: float) -> Sequence[Row]:
    """A flight in the air that `other_aircraft` reports, with sensors of Table II and servos that take whole pulses."""
    flown = fly(folder, aircraft, seed, seconds, DENSITY, PER_PULSE)
    signals, _ = measure(flown, seed, "telemetry")
    read = {name: signal.values for name, signal in signals.signals.items()}
    force, rates, angles = (
        np.column_stack([read[name] for name in names])
        for names in (("ax", "ay", "az"), ("p", "q", "r"), ("phi", "theta", "psi"))
    )
    airspeed = read["airspeed"] * np.sqrt(1.225 / DENSITY)
    pulses = {output: 1500 + np.round(sign * read[name] / PER_PULSE) for name, (output, sign) in SERVOS.items()}
    pulses[THROTTLE] = 1000 + np.round(read["throttle"] / PER_PULSE)
    return [
        Row(
            float(flown.time_s[i]),
            force[i],
            rates[i],
            angles[i],
            float(read["alpha"][i]),
            float(read["beta"][i]),
            float(airspeed[i]),
            float(read["thrust"][i]),
            {output: int(values[i]) for output, values in pulses.items()},
        )
        for i in range(flown.time_s.size)
    ]
