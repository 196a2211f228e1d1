"""Time histories: the measurement, free-running simulations over windows of it, and what moved it, for a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sysid.arrays import Array
from sysid.problem.free_run import GAP_NAMES, Fixed, window_residuals
from sysid.signals.preparation import Prepared
from sysid.signals.record import OUTPUTS
from sysid.validation.residual_series import rounded

#: Samples of one flight at most about; so many times that of all flights of a set together.
POINTS, FLIGHTS_OF_THAT = 600, 2
# Columns of a record's commands.
_INPUTS = ("de", "da", "dr", "throttle")


def simulation_series(
    flights: Sequence[Prepared], stages: Mapping[str, Fixed], shown: Sequence[str], most: int = POINTS
) -> list[dict[str, Any]]:
    """Per flight `flight`, `time_s`, `inputs` and `outputs`: by output `measured` and the simulation of every stage of
    `shown`, SI and rad, the throttle 0 to 1.

    Every n-th sample, the same for all of a flight, about `most` of one. Between windows of 5 s, from which simulations
    start anew, all hold one NaN. Outputs that a flight does not measure are left out.
    """
    points = max(min(most, FLIGHTS_OF_THAT * most // max(len(flights), 1)), 1)
    return [_flight(flight, {stage: stages[stage] for stage in shown}, points) for flight in flights]


def _flight(flight: Prepared, stages: Mapping[str, Fixed], points: int) -> dict[str, Any]:
    samples = sum(stretch.record.length for stretch in flight.stretches)
    stride = max(-(-samples // points), 1)
    time: list[Array] = []
    inputs: list[Array] = []
    columns: dict[str, list[Array]] = {"measured": [], **{stage: [] for stage in stages}}
    for position, (stage, model) in enumerate(stages.items()):
        for stretch in flight.stretches:
            for part, residual in window_residuals(stretch.record, flight.layout, model):
                columns[stage].append(_thinned(part.z - residual, stride))
                if position == 0:
                    columns["measured"].append(_thinned(part.z, stride))
                    time.append(_thinned(part.time_s[:, None], stride))
                    here = slice(part.start, part.start + part.length)
                    moved = np.column_stack([part.commands[here, : len(_INPUTS)], part.thrust[here]])
                    inputs.append(_thinned(moved, stride))
    joined = {name: np.concatenate(parts) for name, parts in columns.items()}
    there = [name for name in GAP_NAMES if np.isfinite(joined["measured"][:, OUTPUTS.index(name)]).any()]
    return {
        "flight": flight.data.name,
        "time_s": rounded(np.concatenate(time)[:, 0]),
        "inputs": _inputs(np.concatenate(inputs)),
        "outputs": {
            GAP_NAMES[name]: {key: rounded(values[:, OUTPUTS.index(name)]) for key, values in joined.items()}
            for name in there
        },
    }


def _inputs(values: Array) -> dict[str, list[float]]:
    """By name: the surfaces, and the thrust, or where that follows from it the throttle."""
    drive = "thrust" if np.isfinite(values[:, -1]).any() else "throttle"
    columns = {**dict(zip(_INPUTS, values.T, strict=False)), "thrust": values[:, -1]}
    return {name: rounded(columns[name]) for name in (*_INPUTS[:-1], drive)}


def _thinned(values: Array, stride: int) -> Array:
    """Every `stride`-th row of (N, k) and one of NaN."""
    return np.concatenate((values[::stride], np.full((1, values.shape[1]), np.nan)))
