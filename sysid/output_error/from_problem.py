"""From a problem and a model to the output-error estimate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from sim_vehicle.model.model_file import Model
from sysid.arrays import Array
from sysid.output_error.estimator import MAX_ITERATIONS, OutputError, OutputErrorResult
from sysid.problem.estimation_problem import Problem, Progress, known_of, predictor_of, start_values
from sysid.problem.predictor import free_states


def build(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]] = (),
    sigma: Array | None = None,
) -> OutputError:
    """The estimation problem for a model in which coefficients and effect parameters are free.

    Parameters
    ----------
    problem : Problem
        Records, guesses of the initial states, and what is known before.
    model : Model
        The model that holds what is not free.
    coefficients : Sequence[str]
        Names of the coefficients that are free.
    effects : Sequence[tuple[str, str]]
        (effect, parameter) pairs that are free.
    sigma : Array, shape (15,), optional
        Known standard deviations of the noise of OUTPUTS, in the outputs' units; None to estimate them.

    Returns
    -------
    OutputError
        The problem to solve.
    """
    predictor = predictor_of(problem, model, coefficients, effects)
    return OutputError(predictor, problem.guesses, problem.motion.outputs, sigma, known_of(problem, predictor))


def warmed(problem: Problem, result: OutputErrorResult) -> Problem:
    """The problem with the initial states of an earlier result of it as guesses."""
    guesses, place = [], len(result.parameters)
    for record, guess in zip(problem.records, problem.guesses, strict=True):
        free = free_states(record)
        warm = guess.copy()
        warm[free] = result.theta[place : place + len(free)]
        place += len(free)
        guesses.append(warm)
    return replace(problem, guesses=tuple(guesses))


def fit(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]] = (),
    start: Mapping[str, float] | None = None,
    progress: Progress = lambda share, text: None,
    max_iterations: int = MAX_ITERATIONS,
    give_up_above: float = math.inf,
) -> OutputErrorResult:
    """Estimate coefficients, effect parameters, sensor errors and initial states together.

    start: values by parameter name that differ from the model's and from problem.sensors. give_up_above: see
    `OutputError.solve`.
    """
    values = start_values(problem, model, coefficients, effects) | dict(start or {})
    return build(problem, model, coefficients, effects).solve(
        values, step_callback(progress), max_iterations, give_up_above
    )


def step_callback(progress: Progress) -> Callable[[int, float], None]:
    """What output error calls after every step, from what a job calls."""
    return lambda step, cost: progress(min(1.0, step / 10.0), f"output error, step {step}")
