"""Identification of flights in turbulence: what filter error is asked to estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_vehicle.model.model_file import Model
from sysid.compatibility.reconstruction import CompatibilityResult
from sysid.compatibility.selection import Refusal, most_implausible, select
from sysid.filter_error.estimator import FilterError, FilterErrorResult
from sysid.numerics.dryden import Turbulence
from sysid.problem.estimation_problem import Problem, Progress, known_of, predictor_of, start_values
from sysid.signals.record import GROUND, OUTPUTS
from sysid.signals.sensor_errors import SENSOR_ERRORS

# Log likelihood by which the other timing of the commands must be better.
_TIMING = 5.0
_LEAST_SIGMA = 0.02  # m/s, to start from
# Steps of the filter over a sample, along which surfaces move as they do; more where they jump or turn between samples.
_FILTER_STEPS, _UNEVEN_STEPS = 1, 4
_UNEVEN = ("actuator_delay", "actuator_rate_limit", "actuator_backlash")


def estimate_in_turbulence(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    compatible: CompatibilityResult,
    sensors: Sequence[str] | None = None,
    progress: Progress = lambda share, text: None,
) -> tuple[Problem, FilterErrorResult, list[Refusal]]:
    """Filter error with the sensor errors that this flight can identify, over the likelier timing of the commands.

    problem: of the flight, with paths. sensors: names to estimate; None lets the flight decide, GPS velocity included
    where it was measured. Raises EstimationError where the filter diverges.
    Returns the problem as it was solved, the result, and refused sensor errors.
    """
    refused: list[Refusal] = []
    if sensors is None:
        problem, refused = _with_sensors(problem, model, coefficients, effects, compatible)
    sigma = max(compatible.gust_sigma, _LEAST_SIGMA)

    def solved(given: Problem, values: dict[str, float], near: FilterErrorResult | None) -> FilterErrorResult:
        air = Turbulence(sigma, sigma) if near is None else near.turbulence
        return build_filter(given, model, coefficients, effects).solve(
            values, air, lambda i, cost: progress(min(0.8, i / 12.0), f"filter error, step {i}"), near=near
        )

    def believed(given: Problem, found: FilterErrorResult) -> tuple[Problem, FilterErrorResult]:
        while (wrong := most_implausible(list(given.sensors), [found.value(n) for n in given.sensors])) is not None:
            refused.append(wrong)
            given = replace(given, sensors={n: start for n, start in given.sensors.items() if n != wrong.name})
            found = solved(given, found.values(), found)
        return given, found

    problem, result = believed(problem, solved(problem, start_values(problem, model, coefficients, effects), None))
    if 0.0 < problem.command_first < 1.0:
        return problem, result, refused
    other = replace(problem, command_first=1.0 - problem.command_first)
    again = build_filter(other, model, coefficients, effects).solve(result.values(), result.turbulence, known=result)
    if again.cost < result.cost - _TIMING:
        again = build_filter(other, model, coefficients, effects).solve(result.values(), result.turbulence)
        problem, result = believed(other, again)
    return problem, result, refused


def _with_sensors(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    compatible: CompatibilityResult,
) -> tuple[Problem, list[Refusal]]:
    """The problem with those sensor errors that its own information can identify beside the coefficients."""
    z = np.concatenate([record.z for record in problem.records])
    measured = {name for j, name in enumerate(OUTPUTS) if np.isfinite(z[:, j]).any()}
    motion = replace(problem.motion, ground=measured >= {*GROUND, "psi"})
    names = [name for name, entry in SENSOR_ERRORS.items() if entry[0] in motion.outputs and entry[0] in measured]
    start = {
        name: compatible.parameters[name].value if name in compatible.parameters else problem.sensors.get(name, 0.0)
        for name in names
    }
    # Velocity over ground must not count twice: the air data's priors come from it.
    priors = {} if motion.ground else {name: prior for name, prior in problem.priors.items() if name in names}
    whole = replace(problem, motion=motion, sensors=start, priors=priors)
    filtered = build_filter(whole, model, coefficients, effects)
    sigma = max(compatible.gust_sigma, _LEAST_SIGMA)
    covariance = filtered.covariance_at(start_values(whole, model, coefficients, effects), Turbulence(sigma, sigma))
    place = [[p.name for p in filtered.predictor.parameters].index(name) for name in names]
    kept, refused = select(names, covariance[place][:, place])
    return replace(whole, sensors={name: start[name] for name in kept}), refused


def build_filter(
    problem: Problem, model: Model, coefficients: Sequence[str], effects: Sequence[tuple[str, str]] = ()
) -> FilterError:
    """The same problem with turbulence as process noise."""
    uneven = any(effect.name in _UNEVEN for effect in model.effects)
    problem = replace(problem, sub_steps=_UNEVEN_STEPS if uneven else _FILTER_STEPS)
    predictor = predictor_of(problem, model, coefficients, effects)
    return FilterError(predictor, problem.paths, problem.motion.outputs, known_of(problem, predictor))
