"""Sensor errors that kinematics alone cannot tell apart, but the whole motion can.

Data compatibility knows nothing of lift and moments; a pitch offset and an accelerometer's bias then look alike. In the
one-step estimate the aircraft's own motion tells them apart, and an error that is held at zero though it could be told
would go into the coefficients, outside their intervals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sim_vehicle.model.model_file import Model
from sysid.arrays import Array
from sysid.compatibility.selection import LIMITS
from sysid.numerics.normal_equations import inverse
from sysid.output_error.estimator import OutputErrorResult
from sysid.output_error.fit import build, fit, warmed
from sysid.problem.problem import Problem, relevant_sensors

# Of the standard error at which a sensor error says nothing: below that it is worth its unknown.
_CLEAR_SHARE = 0.2


def with_told_sensors(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    result: OutputErrorResult,
    refused: Sequence[str],
) -> tuple[Problem, OutputErrorResult]:
    """Estimate once more with those sensor errors of `refused` that the whole motion tells clearly.

    problem, model, coefficients, effects: as they were given to `fit`, which gave `result`. The same two come back
    where it tells none of them.
    """
    values = {parameter.name: float(v) for parameter, v in zip(result.parameters, result.theta, strict=False)}
    richer = with_clear_sensors(warmed(problem, result), model, coefficients, effects, values, result.sigma, refused)
    if set(richer.sensors) == set(problem.sensors):
        return problem, result
    found = fit(richer, model, coefficients, effects, values)
    return (richer, found) if found.converged else (problem, result)


def with_clear_sensors(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    values: Mapping[str, float],
    sigma: Array,
    refused: Sequence[str],
) -> Problem:
    """The problem with those sensor errors of `refused` as unknowns that the whole motion would tell clearly.

    values: parameter -> value at which the information is taken. sigma: (15,) noise of the outputs.
    """
    wanted = [name for name in relevant_sensors(refused, problem.motion) if name in LIMITS]
    while wanted:
        richer = replace(problem, sensors={**problem.sensors, **dict.fromkeys(wanted, 0.0)})
        share = _predicted_share(richer, model, coefficients, effects, values, sigma, wanted)
        if share.max() < _CLEAR_SHARE:
            return richer
        wanted.pop(int(np.argmax(share)))
    return problem


def _predicted_share(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    values: Mapping[str, float],
    sigma: Array,
    names: Sequence[str],
) -> Array:
    """Predicted standard errors of the sensor errors `names` over those at which they say nothing."""
    estimation = build(problem, model, coefficients, effects, sigma)
    theta = estimation.start(dict(values))
    predicted = estimation.predict(theta)
    information, _ = estimation.normal_equations(
        theta, estimation.residuals(predicted), estimation.sensitivities(theta, predicted), sigma
    )
    covariance = inverse(information)
    places = [[p.name for p in estimation.predictor.parameters].index(name) for name in names]
    limits = np.array([LIMITS[name].std for name in names])
    return np.asarray(np.sqrt(np.diag(covariance)[places]) / limits)
