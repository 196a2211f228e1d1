"""Delays as unknowns of the one-step estimate: commands that act late, sensors that show the motion late.

Commands act later by whole samples and, for the rest, by the simulation's own delay of the actuators, which knows when
between two samples a held command changes. A reading y(t) turns into y(t - tau) by the cubic through the four nearest
samples, which is linear, so that tangents of the simulation pass through it as they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sysid.arrays import Array, IntArray
from sysid.numerics.fractional_delay import held_back, read_later
from sysid.signals.record import OUTPUTS, SURFACES, Record, angle_wrap

# The commands' delay, and for every group of sensors that share one: parameter -> the outputs that come late.
COMMAND_DELAY = "delay_commands"
SENSOR_DELAYS: dict[str, tuple[str, ...]] = {
    "delay_vanes": ("alpha", "beta"),
    "delay_air_data": ("airspeed",),
    "delay_attitude": ("phi", "theta", "psi"),
    "delay_gps": ("vn", "ve", "vd"),
}
DELAYS = (COMMAND_DELAY, *SENSOR_DELAYS)
LONGEST_S = 0.3
# Step of the difference quotient by a delay, s.
DELAY_STEP_S = 1e-4
_TURNS = frozenset(OUTPUTS.index(name) for name in ("phi", "psi"))


def late_columns(name: str) -> IntArray:
    """Places among OUTPUTS of what a sensor delay moves."""
    return np.array([OUTPUTS.index(output) for output in SENSOR_DELAYS[name]])


def commands_of(record: Record, delays: Mapping[str, float]) -> tuple[Array, float]:
    """(M, 4) commands of a record as they act, but for a part of a sample by which they act later, s.

    The throttle, behind a motor's lag, keeps its time.
    """
    delay = delays.get(COMMAND_DELAY, 0.0)
    if delay == 0.0:
        return record.commands, 0.0
    whole = float(np.floor(delay / record.interval_s + 1e-9)) * record.interval_s
    return with_late_commands(record, whole).commands, max(delay - whole, 0.0)


def with_late_commands(record: Record, delay: float) -> Record:
    """The record with its surfaces following later by `delay`, s, each sample the mean of what then is held."""
    commands = record.commands.copy()
    surfaces = slice(0, len(SURFACES))
    commands[:, surfaces] = held_back(record.commands[:, surfaces], delay, record.interval_s)
    return replace(record, commands=commands)


def late_readings(y: Array, delays: Mapping[str, float], interval_s: float) -> Array:
    """Outputs (N, 15), or derivatives of them (N, 15, K), as sensors show them that come late."""
    late = {name: delays[name] for name in SENSOR_DELAYS if delays.get(name)}
    if not late:
        return y
    found = y.copy()
    with np.errstate(invalid="ignore"):  # a simulation that diverged is told by its likelihood
        for name, delay in late.items():
            for j in late_columns(name):
                whole = np.unwrap(y[:, j], axis=0) if y.ndim == 2 and j in _TURNS else y[:, j]
                found[:, j] = read_later(whole, -delay, interval_s)
    return found


def delay_derivative(name: str, readings: Array, interval_s: float, out: Array) -> None:
    """Derivative of the readings (N, 15) by one more second of a sensor's delay, added to `out` (N, 15)."""
    more = late_readings(readings, {name: DELAY_STEP_S}, interval_s)
    out += angle_wrap(more - readings) / DELAY_STEP_S
