"""The gap of one set of flights at every stage of a comparison: as given, fitted again, with the effect, and noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sim_vehicle.model import Model
from sim_vehicle.parameters import flatten
from sysid.compatibility import CompatibilityResult
from sysid.estimate import Problem, fit, split_runs
from sysid.flight import Array
from sysid.gap import Fixed, gap, noise_floor
from sysid.output_error import OutputErrorResult
from sysid.parameterisation import SENSOR_ERRORS
from sysid.prepare import MAX_STRETCH_S, Prepared
from sysid.records import OUTPUTS, Record
from sysid.smoothing import noise_sigma


def fixed_model(problem: Problem, model: Model, result: OutputErrorResult, compatible: CompatibilityResult) -> Fixed:
    """A model with the sensor errors of its fit; of outputs outside the fit those of the compatibility check."""
    outside = {
        name: error.value
        for name, error in compatible.parameters.items()
        if name in SENSOR_ERRORS and SENSOR_ERRORS[name][0] not in problem.motion.outputs
    }
    errors = outside | {name: result.value(name) for name in problem.sensors}
    return Fixed(flatten(problem.vehicle, model), errors, problem.command_first)


def stage_gaps(
    problem: Problem,
    prepared: Sequence[Prepared],
    stages: Mapping[str, tuple[Model, OutputErrorResult]],
    compatible: CompatibilityResult,
    generator: np.random.Generator,
    *,
    held_out: bool,
) -> dict[str, dict[str, float]]:
    """Gap of every stage on these flights, and the noise floor of the last.

    On flights held out the sensor errors alone are fitted for each stage: they change with every power-up.
    """
    stretches = [stretch for flight in prepared for stretch in flight.stretches]
    records = [stretch.record for stretch in stretches]
    layout = prepared[0].layout
    found: dict[str, dict[str, float]] = {}
    for stage, (model, result) in stages.items():
        own = fit(problem, model, ()) if held_out else result
        fixed = fixed_model(problem, model, own, compatible)
        found[stage] = {name: value for name, value in gap(records, layout, fixed).items() if math.isfinite(value)}
        last_fixed = fixed
    thrust_noise = [noise_sigma(s.data["thrust"], s.data.interval_s) for s in stretches if "thrust" in s.data]
    thrust_sigma = 0.0 if not thrust_noise else float(np.median(thrust_noise)) * _thrust_noise_left(records)
    runs, starts = [], []
    for stretch, states in zip(stretches, compatible.states, strict=True):
        full = dict(states)
        full.setdefault("psi", stretch.data.columns.get("psi", np.zeros(stretch.record.length)))
        part_runs, paths = split_runs(stretch.record, full, problem.motion, MAX_STRETCH_S)
        runs += [replace(run, held=np.zeros((0, 9))) for run in part_runs]
        starts += [path[0] for path in paths]
    sigma = _output_noise(records)
    found["noise_floor"] = noise_floor(
        runs, starts, layout, last_fixed, sigma, thrust_sigma, compatible.gust_sigma, generator
    )
    return found


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
