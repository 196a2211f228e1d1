"""What the gap is made of: measurement and free-running simulations over the windows, thinned for a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sysid.arrays import Array
from sysid.problem.free_run import GAP_NAMES, Fixed, window_residuals
from sysid.signals.preparation import Prepared
from sysid.signals.record import OUTPUTS
from sysid.validation.residual_series import rounded

#: Samples of one flight, and of all flights of a set together, at most about.
POINTS, POINTS_OF_ALL = 600, 1200


def gap_series(flights: Sequence[Prepared], stages: Mapping[str, Fixed], shown: Sequence[str]) -> list[dict[str, Any]]:
    """Per flight `flight`, `time_s` and `outputs`: by output `measured` and the simulation of every stage of `shown`.

    Every n-th sample, the same for all of a flight. Between windows of 5 s, from which simulations start anew, all hold
    one NaN. Outputs that a flight does not measure are left out.
    """
    points = max(min(POINTS, POINTS_OF_ALL // max(len(flights), 1)), 1)
    return [_flight(flight, {stage: stages[stage] for stage in shown}, points) for flight in flights]


def _flight(flight: Prepared, stages: Mapping[str, Fixed], points: int) -> dict[str, Any]:
    samples = sum(stretch.record.length for stretch in flight.stretches)
    stride = max(-(-samples // points), 1)
    time: list[Array] = []
    columns: dict[str, list[Array]] = {"measured": [], **{stage: [] for stage in stages}}
    for position, (stage, model) in enumerate(stages.items()):
        for stretch in flight.stretches:
            for part, residual in window_residuals(stretch.record, flight.layout, model):
                columns[stage].append(_thinned(part.z - residual, stride))
                if position == 0:
                    columns["measured"].append(_thinned(part.z, stride))
                    time.append(_thinned(part.time_s[:, None], stride))
    joined = {name: np.concatenate(parts) for name, parts in columns.items()}
    there = [name for name in GAP_NAMES if np.isfinite(joined["measured"][:, OUTPUTS.index(name)]).any()]
    return {
        "flight": flight.data.name,
        "time_s": rounded(np.concatenate(time)[:, 0]),
        "outputs": {
            GAP_NAMES[name]: {key: rounded(values[:, OUTPUTS.index(name)]) for key, values in joined.items()}
            for name in there
        },
    }


def _thinned(values: Array, stride: int) -> Array:
    """Every `stride`-th row of (N, k) and one of NaN."""
    return np.concatenate((values[::stride], np.full((1, values.shape[1]), np.nan)))
