"""What the noise of measured thrust, an input of the simulation, does to the estimates' errors.

The likelihood takes inputs as exact. Smoothed thrust still has errors, of level foremost, which move the coefficients
by one Gauss-Newton step d each; independent of the outputs' noise, they add d d' to the covariance (consider
covariance: S. F. Schmidt, Advances in Control Systems 3, 1966).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_vehicle.model import Model
from sysid.estimate import Problem, build
from sysid.output_error import OutputErrorResult
from sysid.parameterisation import Predictor


def with_thrust_noise(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    result: OutputErrorResult,
) -> OutputErrorResult:
    """The result with the thrust's noise in its covariances.

    problem, model, coefficients, effects: as they were given to `fit`, which gave `result`.
    """
    stretches: dict[tuple[str, int], list[int]] = {}
    for index, record in enumerate(problem.records):
        if record.thrust_doubt.size:
            stretches.setdefault((record.flight, record.stretch), []).append(index)
    if not stretches:
        return result
    estimation = build(problem, model, coefficients, effects, result.sigma)
    theta = result.theta
    predicted = estimation.predict(theta)
    S = estimation.sensitivities(theta, predicted)
    flat, errors = estimation.predictor.apply(theta)
    columns = estimation.columns
    weights = result.sigma[columns] ** -2.0
    added = np.zeros_like(result.covariance)
    for indices in stretches.values():
        for part in range(problem.records[indices[0]].thrust_doubt.shape[0]):
            pull = np.zeros(theta.size)
            for index in indices:
                record = problem.records[index]
                pushed = replace(record, thrust=record.thrust + record.thrust_doubt[part])
                other = Predictor(
                    estimation.predictor.flat, estimation.predictor.parameters, (pushed,),
                    sub_steps=problem.sub_steps, command_first=problem.command_first,
                )  # fmt: skip
                states = estimation.predictor.initial_states(index, theta, estimation.guesses[index])
                change = other.outputs(0, flat, errors, states) - predicted[index]
                change[~np.isfinite(record.z)] = 0.0
                pull[estimation.places(index)] += np.einsum(
                    "kjp,kj->p", S[index][:, columns, :], change[:, columns] * weights
                )
            step = result.covariance_white @ pull
            added += np.outer(step, step)
    return replace(result, covariance=result.covariance + added, covariance_white=result.covariance_white + added)
