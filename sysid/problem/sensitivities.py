"""Exact derivatives of a simulated flight's outputs by coefficients, thrust and initial states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sim_vehicle.effects import SENSOR_LAGS, slot
from sim_vehicle.effects.sensor_time_skew import delay_rows, is_late
from sim_vehicle.physics.kernel_records import NOT_SEEN, DrivingInputs
from sim_vehicle.physics.simulation import split_delay_ticks
from sim_vehicle.sensitivities.dynamics_jacobian import STATE_COLUMNS, THRUST_COLUMN
from sim_vehicle.sensitivities.sensor_jacobian import READINGS
from sim_vehicle.sensitivities.tangent_simulation import InputUnknowns, Unknowns, simulate_tangents
from sim_vehicle.vehicle.packed_model import PackedModel
from sysid.arrays import Array

_STILL_AIR = np.zeros((0, 3))


@dataclass(frozen=True)
class Lane:
    """One unknown: its place in the result, and what it is.

    term: of the flat model, the coefficient it is; thrust: change of measured thrust [N] by it. An initial state is
    neither, and what acts through the inputs neither.
    """

    place: int
    term: int = -1
    thrust: float = 0.0


@dataclass(frozen=True)
class Inputs:
    """What the simulation is driven by: samples start ... stop - 1; see `sim_vehicle.physics.simulation.simulate`."""

    start: int
    stop: int
    commands: Array
    thrust: Array
    rho: Array
    interval_s: float
    sub_steps: int
    command_first: float
    held: Array
    seen: Array = field(default_factory=lambda: NOT_SEEN)


@dataclass(frozen=True)
class Driven:
    """What drives the simulation where an unknown has grown by `step`; arrays as in `Inputs`."""

    commands: Array
    thrust: Array
    held: Array
    step: float
    seen: Array = field(default_factory=lambda: NOT_SEEN)


def has_tangents(flat: PackedModel, interval_s: float) -> bool:
    """Whether `tangents` knows all that the model has: it leaves out a lift that lags, the ground, and sensors that
    are delayed by a part of a sample.
    """
    _, part = split_delay_ticks(flat.E, interval_s)
    return bool(flat.E[slot("unsteady_lift")] == 0.0 and flat.E[slot("ground_effect")] == 0.0 and part == 0.0)


def tangents(
    flat: PackedModel,
    inputs: Inputs,
    x0: Array,
    states: Sequence[int],
    lanes: Sequence[Lane],
    outputs: Sequence[str],
    gains: Sequence[float],
    driven: Sequence[Driven],
    out: Array,
) -> None:
    """Derivatives of `outputs` times `gains` by the unknowns, into `out` (N, outputs, unknowns), 0 at other places.

    x0: (14,) state at the start. driven: the last lanes act through these. states: which of the nine initial states
    u v w p q r phi theta psi the lanes before those are. outputs: names among READINGS.
    """
    axes = np.searchsorted(flat.T, np.arange(flat.C.size), side="right") - 1
    terms = np.array([lane.term for lane in lanes], dtype=np.int64)
    columns = np.full(len(lanes), -1, dtype=np.int64)
    shares = np.ones(out.shape[2])
    measured = bool(np.isfinite(inputs.thrust[inputs.start]))
    for i, lane in enumerate(lanes):
        if lane.term >= 0:
            columns[i] = STATE_COLUMNS + axes[lane.term]
        elif lane.thrust != 0.0 and measured:
            columns[i] = THRUST_COLUMN
            shares[lane.place] = lane.thrust
    places = np.array([lane.place for lane in lanes], dtype=np.int64)
    rows = np.array([READINGS.index(name) for name in outputs], dtype=np.int64)
    drive = DrivingInputs(
        inputs.commands, inputs.thrust, inputs.rho, inputs.held, _STILL_AIR, inputs.interval_s, inputs.sub_steps,
        float(inputs.command_first), inputs.seen,
    )  # fmt: skip
    initial = np.array(states, dtype=np.int64)
    unknowns = Unknowns(terms, columns, places, initial, rows, np.array(gains, dtype=np.float64))
    others = InputUnknowns(
        _stacked([one.commands for one in driven], inputs.commands),
        _stacked([one.thrust for one in driven], inputs.thrust),
        _stacked([one.held for one in driven], inputs.held),
        _stacked([one.seen for one in driven], inputs.seen),
        np.array([one.step for one in driven], dtype=np.float64),
    )
    simulate_tangents(x0, 0, inputs.start, inputs.stop, drive, flat.arrays, unknowns, others, out)
    for place in np.nonzero(shares != 1.0)[0]:
        out[:, :, place] *= shares[place]
    for effect, names in SENSOR_LAGS.items():
        if flat.E[slot(effect)] != 0.0:
            for name in names:
                if name in outputs:
                    _lag(out[:, list(outputs).index(name), :], inputs.interval_s, float(flat.E[slot(effect, "tau")]))
    late = float(flat.E[slot("sensor_time_skew", "delay")]) / inputs.interval_s
    if flat.E[slot("sensor_time_skew")] != 0.0 and late > 0.0:
        for i, row in enumerate(rows):
            if is_late(int(row), float(flat.E[slot("sensor_time_skew", "group")])):
                out[:, i, :] = delay_rows(np.ascontiguousarray(out[:, i, :]), late)


def _stacked(arrays: Sequence[Array], like: Array) -> Array:
    return np.stack(arrays) if arrays else np.empty((0, *like.shape))


def _lag(series: Array, interval_s: float, tau: float) -> None:
    """Pass (N, unknowns) in place through the first-order lag that sensors have (`ramp_lag`), at rest at the start."""
    if tau <= 0.0:
        return
    from scipy.signal import lfilter  # slow to import, and seldom wanted

    decay = np.exp(-interval_s / tau)
    lead = tau / interval_s * (1.0 - decay)
    now, before = 1.0 - lead, lead - decay
    # At rest: the first output is the first input.
    series[:] = lfilter([now, before], [1.0, -decay], series, axis=0, zi=(lead * series[:1]))[0]
