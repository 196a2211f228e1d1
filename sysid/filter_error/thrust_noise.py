"""What is not known of measured thrust, as parameters beside the model's: its noise's, and its bench curve's.

The equations of motion take thrust as exact. A curve that is wrong by a thousandth, or the slow noise that no smoothing
takes off, would look like a small error of the thrust, of the mass or of the drag in a long flight. Each is an unknown
of one standard deviation about zero (errors of inputs as parameters with priors: Maine & Iliff, NASA RP-1168, section
5.4). What smoothing lets pass counts once: a few slow swings are such unknowns, many are a state of the filter
(sysid.filter_error.augmented_states.unseen), whose spectrum is theirs, and only errors quicker than they stay beside
that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.arrays import Array
from sysid.problem.estimation_problem import Problem
from sysid.signals.calibration import Calibration
from sysid.signals.preparation import Prepared
from sysid.signals.record import Record
from sysid.signals.thrust.denoising import DOUBTED_TERMS, NO_NOISE

# A part of an error that is smaller than this everywhere moves nothing, N.
_LEAST_N = 1e-6


def with_thrust_errors(problem: Problem, prepared: Sequence[Prepared]) -> Problem:
    """The problem with errors of its thrust to be estimated by filter error.

    Those of a bench curve are common to all flights that went through it, those of the noise a stretch's own.
    """
    parts = [_counted_once(record) for record in problem.records]
    stretches: dict[tuple[str, int], int] = {}
    for record in parts:
        stretches.setdefault((record.flight, record.stretch), record.thrust_doubt.shape[0])
    curves = {flight.data.name: flight.calibrations.get("thrust") for flight in prepared}
    rows = [_rows(record, stretches, curves) for record in parts]
    kept = np.any([np.abs(one).max(axis=1, initial=0.0) > _LEAST_N for one in rows], axis=0)
    records = tuple(
        replace(record, thrust_doubt=np.ascontiguousarray(one[kept])) for record, one in zip(parts, rows, strict=True)
    )
    return replace(problem, records=records, thrust_errors=int(kept.sum()))


def _counted_once(record: Record) -> Record:
    """The record with the noise left in its thrust either among its doubts or in the filter's state, not in both."""
    noise = record.thrust_noise
    if noise.terms <= DOUBTED_TERMS:
        return replace(record, thrust_noise=NO_NOISE)
    beside = record.thrust_doubt[: record.thrust_doubt.shape[0] - noise.doubted]
    return replace(record, thrust_doubt=beside, thrust_noise=replace(noise, doubted=0))


def _rows(record: Record, stretches: dict[tuple[str, int], int], curves: dict[str, Calibration | None]) -> Array:
    """(K, M) every error of any record's thrust, as this record has it."""
    rows = []
    for stretch, count in stretches.items():
        own = stretch == (record.flight, record.stretch)
        rows.append(record.thrust_doubt if own else np.zeros((count, record.thrust.size)))
    distinct: list[Calibration] = []
    for curve in curves.values():
        if curve is None or curve in distinct:
            continue
        distinct.append(curve)
        modes = curve.error_modes(record.thrust)
        rows.append(modes if curves[record.flight] == curve else np.zeros_like(modes))
    return np.concatenate(rows)
