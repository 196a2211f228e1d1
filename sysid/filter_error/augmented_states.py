"""Sensors that remember, as states of the filter.

A sensor with a lag, or one that is delayed by a part of a sample, reads y_k = m_k + c1 x_k of what is there, x, with a
memory m_{k+1} = a y_k + c0 x_k = a m_k + (a c1 + c0) x_k (the motion taken as straight between samples: exact for a
first-order lag of a ramp). A filter that takes such a sensor as free of lag believes it too much: m is a state of its
own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp

import numpy as np

from sim_vehicle.effects import SENSOR_LAGS, slot
from sim_vehicle.effects.sensor_time_skew import is_late
from sim_vehicle.physics.simulation import split_delay_ticks
from sim_vehicle.sensitivities.dynamics_jacobian import STATE_COLUMNS, THRUST_COLUMN
from sim_vehicle.vehicle.packed_model import PackedModel
from sysid.arrays import Array, IntArray
from sysid.signals.record import OUTPUT_PLACES, OUTPUTS, Record

_GROUP = slot("sensor_time_skew", "group")
_SLOW, _SLOW_TAU = slot("unsteady_lift"), slot("unsteady_lift", "tau")
_ALPHA = OUTPUTS.index("alpha")
# Of a sensor's travel, one standard deviation of its memory at the start: from the middle to either end. Travel is
# between these percentiles, which one wild reading does not move.
_START_SHARE, _TRAVEL = 0.5, (1.0, 99.0)


@dataclass(frozen=True)
class OutputLag:
    """How one output remembers. column: of OUTPUTS. decay, old, new: a, c0 and c1 of the module."""

    column: int
    decay: float
    old: float
    new: float


@dataclass(frozen=True)
class Memory:
    """The outputs of a record that remember, L of them.

    columns: (L,) among the outputs used. decay: (L,) a; taken: (L,) a c1 + c0; held: (L,) a + c0. slopes: (N, L,
    nf + na) of what is there by free states and gusts. start: (L,) standard deviations of the memory at the start.
    """

    columns: IntArray
    decay: Array
    taken: Array
    held: Array
    slopes: Array
    start: Array


def lags(effects: Array, interval_s: float) -> list[OutputLag]:
    """Every output that remembers, by the effects of a model (as in `PackedModel.E`)."""
    found: dict[int, OutputLag] = {}
    _, part = split_delay_ticks(effects, interval_s)
    for column, place in enumerate(OUTPUT_PLACES):
        if part > 0.0 and is_late(int(place), float(effects[_GROUP])):
            found[column] = OutputLag(column, 0.0, part, 1.0 - part)
    for name, outputs in SENSOR_LAGS.items():
        tau = float(effects[slot(name, "tau")]) if effects[slot(name)] != 0.0 else 0.0
        if tau > 0.0:
            decay = exp(-interval_s / tau)
            held = tau / interval_s * (1.0 - decay)
            for column in (OUTPUTS.index(output) for output in outputs):
                found[column] = OutputLag(column, decay, held - decay, 1.0 - held)
    return list(found.values())


def remember(
    found: Sequence[OutputLag], columns: IntArray, z: Array, read_x: Array, read_theta: Array, direct: Sequence[int]
) -> Memory | None:
    """The memory of the outputs in use; what sensors without lag would read is changed to what these do, in place.

    None where none of them remembers; outputs that this record does not read at all have nothing to remember.

    columns: (m,) of OUTPUTS in use. z: (N, 15) measured. read_x: (N, 15, nf + na), read_theta: (N, 15, P) slopes of
    readings without lag by states and parameters. direct: parameters whose slopes are those of such readings; all
    others are those of what is read, memory included.
    """
    used = [lag for lag in found if lag.column in columns and np.isfinite(z[:, lag.column]).any()]
    if not used:
        return None
    slopes = read_x[:, [lag.column for lag in used]]
    start = []
    for lag in used:
        read_x[:, lag.column] *= lag.new
        undelayed = read_theta[:, lag.column, direct]
        before = np.concatenate((undelayed[:1], undelayed[:-1]))
        # Only delayed sensors, whose decay is 0, read forces, which parameters change at once.
        read_theta[:, lag.column, direct] = lag.new * undelayed + lag.old * before
        start.append(_START_SHARE * _travel(z[:, lag.column]))
    return Memory(
        np.array([int(np.flatnonzero(columns == lag.column)[0]) for lag in used]),
        np.array([lag.decay for lag in used]),
        np.array([lag.decay * lag.new + lag.old for lag in used]),
        np.array([lag.decay + lag.old for lag in used]),
        np.ascontiguousarray(slopes),
        np.maximum(start, 1e-6),
    )


def _travel(readings: Array) -> float:
    """How far readings (N,), NaN where missing, move; 0 where there are none."""
    there = readings[np.isfinite(readings)]
    return float(np.ptp(np.percentile(there, _TRAVEL))) if there.size else 0.0


@dataclass(frozen=True)
class System:
    """A record as a linear system driven by white noise (sysid.filter_error.kalman.kalman_pass). output: gusts from
    the states after the free ones.
    """

    transition: Array
    drift: Array
    left: Array
    observe: Array
    jump: Array
    process: Array
    p_start: Array
    output: Array


@dataclass(frozen=True)
class HiddenInput:
    """Something that nothing measures alone and that acts on steps and readings: a state of its own.

    column: of the Jacobian of forces that it acts through, weight: (N,) how much. decay: over a sample; fresh: variance
    of what comes new with each, start: of what it is at first.
    """

    column: int
    weight: Array
    decay: float
    fresh: float
    start: float


def unseen(record: Record, flat: PackedModel) -> list[HiddenInput]:
    """What acts on a record unseen.

    Noise that is left in a measured thrust: a propeller's torque rolls the aircraft by it, and gyros measure that
    better than the thrust's own sensor. Taken as exact it looks like something that the model lacks. And of a lift that
    lags, what it remembers of the time before the record.
    """
    found = []
    noise = record.thrust_noise
    if noise.sigma > 0.0 and np.isfinite(record.thrust[record.start]):
        decay, variance = exp(-record.interval_s / noise.memory_s), noise.sigma**2
        found.append(HiddenInput(THRUST_COLUMN, np.ones(record.length), decay, (1.0 - decay**2) * variance, variance))
    if flat.E[_SLOW] != 0.0 and np.isfinite(record.z[:, _ALPHA]).any() and "CL_alpha" in flat.names:
        slope = float(flat.C[flat.names.index("CL_alpha")])
        start = (_START_SHARE * _travel(record.z[:, _ALPHA])) ** 2
        decay = exp(-record.interval_s / float(flat.E[_SLOW_TAU]))
        found.append(HiddenInput(STATE_COLUMNS, np.full(record.length, slope), decay, 0.0, start))
    return found


def fill_unseen(system: System, place: int, one: HiddenInput, step: Array, read: Array) -> None:
    """Make a state at rest, the one at `place`, something unseen. step: (N - 1, nf), read: (N, m) slopes by it."""
    system.transition[:, : step.shape[1], place] = step
    system.transition[:, place, place] = one.decay
    system.process[:, place, place], system.p_start[place, place] = one.fresh, one.start
    system.observe[:, :, place] = read


def fill_memory(system: System, place: int, memory: Memory, states: int, gusts: Array) -> None:
    """Make states at rest, from `place` on, what sensors remember. states: free ones, which come first. gusts: (N, na)
    of the path.
    """
    mine = np.arange(place, place + memory.columns.size)
    by_gusts = memory.slopes[:, :, states:]
    system.transition[:, mine, :states] = (memory.taken[:, None] * memory.slopes[:, :, :states])[:-1]
    through = memory.taken[:, None] * by_gusts @ system.output[:, : place - states]
    system.transition[:, mine, states:place] = through[:-1]
    system.transition[:, mine, mine] = memory.decay
    # Gusts are whole, not deviations: what the path took of them comes off again.
    system.drift[:, mine] = -memory.taken * np.einsum("kla,ka->kl", by_gusts, gusts)[:-1]
    # At the first sample the path's sensors are at rest, before it and after it in two places.
    rest = (memory.held - memory.taken) * (memory.slopes[0, :, :states] @ system.jump[0, :states])
    system.drift[0, mine] -= rest
    system.observe[:, memory.columns, mine] = 1.0
    system.p_start[mine, mine] = memory.start**2
