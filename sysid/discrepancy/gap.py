"""The gap of one set of flights at every stage of a comparison: as given, fitted again, with the effect, and noise."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sim_vehicle.model.model_file import Model
from sim_vehicle.vehicle.packed_model import flatten
from sysid.arrays import Array
from sysid.compatibility.reconstruction import CompatibilityResult
from sysid.discrepancy.comparison import Compared
from sysid.discrepancy.naming_rule import WIDER
from sysid.numerics.smoothing import noise_sigma
from sysid.problem.estimation_problem import Estimates, Problem, split_runs
from sysid.problem.free_run import Fixed, gap, noise_floor
from sysid.signals.preparation import MAX_STRETCH_S
from sysid.signals.record import OUTPUTS, Record
from sysid.signals.sensor_errors import SENSOR_ERRORS


def fixed_model(problem: Problem, model: Model, result: Estimates, compatible: CompatibilityResult) -> Fixed:
    """A model with the sensor errors of its fit; of outputs outside the fit those of the compatibility check."""
    outside = {
        name: error.value
        for name, error in compatible.parameters.items()
        if name in SENSOR_ERRORS and SENSOR_ERRORS[name][0] not in problem.motion.outputs
    }
    errors = outside | {name: result.value(name) for name in problem.sensors}
    return Fixed(flatten(problem.vehicle, model), errors, problem.command_first)


def widening(compared: Compared, outputs: Collection[str] | None = None) -> float:
    """How many times as wide as "before" the gap on these flights is "after": the quadratic mean over the outputs, or
    over those given.

    Where it is wider than names may leave it, gaps within what noise alone makes count as that, by the stage to which
    noise does less: a part of the motion that hardly moves says nothing of a name by its noise.
    """
    records, layout = _records(compared), compared.flights[0].layout
    before, after = (gap(records, layout, compared.stages[stage]) for stage in ("before", "after"))
    shown = {name for name in before if outputs is None or name in outputs}
    wider = _times_as_wide(before, after, dict.fromkeys(shown, 0.0))
    if wider < WIDER:
        return wider
    floors = [_noise_floor(compared, compared.stages[stage], np.random.default_rng(0)) for stage in ("before", "after")]
    return _times_as_wide(before, after, {name: min(floor.get(name, 0.0) for floor in floors) for name in shown})


def _times_as_wide(before: Mapping[str, float], after: Mapping[str, float], floor: Mapping[str, float]) -> float:
    pairs = [(max(before[name], least), max(after[name], least)) for name, least in floor.items()]
    ratios = [most / least for least, most in pairs if least > 0.0 and math.isfinite(least)]
    return float(np.sqrt(np.mean(np.square(ratios)))) if ratios else 1.0


def stage_gaps(compared: Compared, generator: np.random.Generator) -> dict[str, dict[str, float]]:
    """Gap of every stage on these flights, and the noise floor of the last in air of their turbulence."""
    records, layout = _records(compared), compared.flights[0].layout
    found: dict[str, dict[str, float]] = {}
    for stage, fixed in compared.stages.items():
        found[stage] = _finite(gap(records, layout, fixed))
    found["noise_floor"] = _noise_floor(compared, list(compared.stages.values())[-1], generator)
    return found


def _records(compared: Compared) -> list[Record]:
    return [stretch.record for flight in compared.flights for stretch in flight.stretches]


def _finite(gaps: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in gaps.items() if math.isfinite(value)}


def _noise_floor(compared: Compared, fixed: Fixed, generator: np.random.Generator) -> dict[str, float]:
    """The gap that a model has on flights of its own, by noise of sensors and inputs and by gusts."""
    stretches = [stretch for flight in compared.flights for stretch in flight.stretches]
    records = [stretch.record for stretch in stretches]
    thrust_noise = [noise_sigma(s.data["thrust"], s.data.interval_s) for s in stretches if "thrust" in s.data]
    thrust_sigma = 0.0 if not thrust_noise else float(np.median(thrust_noise)) * _thrust_noise_left(records)
    runs, starts = [], []
    for stretch, states in zip(stretches, compared.compatible.states, strict=True):
        full = dict(states)
        full.setdefault("psi", stretch.data.columns.get("psi", np.zeros(stretch.record.length)))
        part_runs, paths = split_runs(stretch.record, full, compared.motion, MAX_STRETCH_S)
        runs += [replace(run, imposed_states=np.zeros((0, 9))) for run in part_runs]
        starts += [path[0] for path in paths]
    layout = compared.flights[0].layout
    return _finite(
        noise_floor(runs, starts, layout, fixed, _output_noise(records), thrust_sigma, compared.air, generator)
    )


def _thrust_noise_left(records: Sequence[Any]) -> float:
    """Share of a thrust cell's noise that its smoothing lets through: that of the mean."""
    return 1.0 / math.sqrt(max(len(records[0].thrust), 1))


def _output_noise(records: Sequence[Record]) -> Array:
    """(15,) noise of the outputs from the measurement alone: a wrong model would hide in its own residuals."""
    sigma = np.zeros(len(OUTPUTS))
    for j in range(len(OUTPUTS)):
        noise = [noise_sigma(r.z[:, j], r.interval_s) for r in records if np.isfinite(r.z[:, j]).all()]
        sigma[j] = float(np.sqrt(np.mean(np.square(noise)))) if noise else 0.0
    return sigma
