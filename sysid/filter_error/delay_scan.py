"""The delay of the commands in rough air, where equation error may take gusts for it: judged by filter error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim_vehicle.model.model_file import Model
from sysid.compatibility.reconstruction import CompatibilityResult
from sysid.compatibility.selection import Refusal
from sysid.errors import EstimationError
from sysid.filter_error.estimation import build_filter, estimate_in_turbulence
from sysid.filter_error.estimator import FilterErrorResult
from sysid.problem.delay_parameters import with_late_commands
from sysid.problem.problem import Problem, Progress
from sysid.signals.delay import COMMANDS, Delay

# Log likelihood by which the flight must be likelier with the delay than without.
_GAIN = 10.0
_ROUNDS = 4
# Of a sample: a delay that is off by less is left as it is.
_NEAR = 0.1

SolvedProblem = tuple[Problem, FilterErrorResult, list[Refusal]]


def estimate_with_delay(
    problem: Problem,
    models: tuple[Model, Model],
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    compatible: CompatibilityResult,
    sensors: Sequence[str] | None,
    suspected_s: float,
    progress: Progress,
) -> tuple[SolvedProblem, tuple[Delay, ...]]:
    """`estimate_in_turbulence` without and with a delay of the commands that is suspected: the likelier, and its delay.

    models: start values without and with it. Raises EstimationError where the filter diverges either way.
    """
    found: dict[float, SolvedProblem] = {}
    for delay, model in zip((0.0, suspected_s), models, strict=True):
        try:
            found[delay] = estimate_in_turbulence(
                _moved(problem, delay), model, coefficients, effects, compatible, sensors, progress
            )
        except (EstimationError, np.linalg.LinAlgError):
            continue
    if not found:
        raise EstimationError("filter error diverges with the commands as sent and as late as they seem: --method oe")
    costs = {delay: one[1].cost + (_GAIN if delay else 0.0) for delay, one in found.items()}
    likelier = min(costs, key=lambda delay: costs[delay])
    if likelier == 0.0:
        return found[0.0], ()
    solved, result, refused = found[likelier]
    solved, result, more = _refined(solved, models[1], coefficients, effects, result)
    return (solved, result, refused), (Delay(COMMANDS, likelier + more.value, more.std),)


def _moved(problem: Problem, delay: float) -> Problem:
    if delay == 0.0:
        return problem
    return replace(problem, records=tuple(with_late_commands(record, delay) for record in problem.records))


def _refined(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    result: FilterErrorResult,
) -> tuple[Problem, FilterErrorResult, Delay]:
    """The estimate at the minimum of the parabola through three solutions a sample apart, and what that adds, s."""
    interval = problem.records[0].interval_s

    def solved(offset: float, known: FilterErrorResult | None) -> FilterErrorResult:
        filtered = build_filter(_moved(problem, offset), model, coefficients, effects)
        return filtered.solve(result.values(), result.turbulence, known=known)

    offset, std = 0.0, interval
    for _ in range(_ROUNDS):
        before, here, after = (solved(offset + k * interval, result).cost for k in (-1, 0, 1))
        bend = before + after - 2.0 * here
        if not bend > 0.0:
            break
        std = interval * bend**-0.5
        step = min(max(0.5 * (before - after) / bend, -2.0), 2.0)
        offset += step * interval
        if abs(step) < 1.0:
            break
    if abs(offset) < _NEAR * interval:
        return problem, result, Delay(COMMANDS, 0.0, std)
    return _moved(problem, offset), solved(offset, None), Delay(COMMANDS, offset, std)
