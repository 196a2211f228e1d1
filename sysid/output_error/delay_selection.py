"""Delays that kinematics cannot tell, or only roughly, but the whole motion can: of the commands and of the sensors.

At the estimate without a delay, one Gauss-Newton step along its sensitivity says what it would be (score test: C. R.
Rao, Proc. Camb. Phil. Soc. 44, 1948). What is clearly not zero becomes an unknown beside the coefficients, whose
standard errors then hold its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim_vehicle.effects import EFFECTS
from sim_vehicle.model.model_file import Model
from sysid.arrays import Array
from sysid.compatibility.selection import Refusal
from sysid.errors import EstimationError
from sysid.numerics.normal_equations import inverse
from sysid.output_error.estimator import OutputErrorResult
from sysid.output_error.fit import build, fit, warmed
from sysid.output_error.linearisation import Linearised
from sysid.problem.delay_parameters import (
    COMMAND_DELAY,
    DELAY_STEP_S,
    SENSOR_DELAYS,
    delay_derivative,
    with_late_commands,
)
from sysid.problem.problem import Problem
from sysid.signals.record import OUTPUTS, angle_wrap

# A delay is an unknown from four standard errors and one millisecond on.
SIGMAS, LEAST_S = 4.0, 1e-3
# Log likelihood that the delays must gain: 99.9 % for four of them, coloured residuals allowed for.
_GAIN = 10.0
_ROUNDS = 2
# Log likelihood by which a lag of the servos and a delay of the commands must differ to be told apart.
_LAG_MARGIN = 10.0
_LAG_STEPS = 10
_LONGEST_LAG_S = 0.25


def candidates(problem: Problem, model: Model) -> list[str]:
    """Delays that this motion could tell: of outputs in the likelihood, and of commands where no effect delays them."""
    z = np.concatenate([record.z for record in problem.records])
    shown = {name for name in problem.motion.outputs if np.isfinite(z[:, OUTPUTS.index(name)]).any()}
    found = [] if model.effect("actuator_delay") is not None else [COMMAND_DELAY]
    return found + [name for name, outputs in SENSOR_DELAYS.items() if shown.intersection(outputs)]


def with_told_delays(here: Linearised, sure: Sequence[str] = ()) -> Linearised:
    """Estimate once more with those delays that the flight insists on.

    sure: delays that the data were corrected for already, whose remaining error counts in any case. The same comes back
    where there are none.
    """
    possible = candidates(here.problem, here.model)
    for _ in range(_ROUNDS):
        problem, result = here.problem, here.result
        kept = {name: value for name, value in problem.delays.items() if name in sure or _clear(result, name)}
        told = dict.fromkeys((name for name in sure if name in possible), 0.0) | kept
        if _worth_a_look(here, possible):
            told |= _insisting(here, possible)
        if set(told) == set(problem.delays):
            break
        other = replace(warmed(problem, result), delays=told)
        try:
            found = fit(other, here.model, here.coefficients, here.effects, told | _values(result))
        except EstimationError:
            break
        asked = set(told) - set(sure) - set(problem.delays)
        if not found.converged or (asked and found.cost > result.cost - _GAIN):
            break
        here = replace(here, problem=other, result=found)
    return here


def _values(result: OutputErrorResult) -> dict[str, float]:
    return {p.name: float(v) for p, v in zip(result.parameters, result.theta, strict=False)}


def _clear(result: OutputErrorResult, name: str) -> bool:
    """Whether a delay among the unknowns is clearly not zero."""
    return abs(result.value(name)) > max(SIGMAS * result.std(name), LEAST_S)


def _worth_a_look(here: Linearised, names: Sequence[str]) -> bool:
    """Whether one step finds any of `names` as clearly as it must with white residuals; coloured ones ask for more."""
    free = [name for name in names if name not in here.problem.delays]
    predictor, theta = here.estimation.predictor, here.result.theta
    flat, errors = predictor.apply(theta)
    slopes: list[dict[int, Array]] = [{} for _ in free]
    later = {**errors, COMMAND_DELAY: errors.get(COMMAND_DELAY, 0.0) + DELAY_STEP_S}
    for k, (record, y) in enumerate(zip(here.problem.records, here.predicted, strict=True)):
        for name, of_name in zip(free, slopes, strict=True):
            of_name[k] = np.zeros_like(y)
            if name == COMMAND_DELAY:
                states = predictor.initial_states(k, theta, here.estimation.guesses[k])
                of_name[k] = angle_wrap(predictor.outputs(k, flat, later, states) - y) / DELAY_STEP_S
            else:
                delay_derivative(name, y, record.interval_s, of_name[k])
    # What stands beside is taken to be one second at most, which says nothing next to what a flight tells.
    information, gradient = here.bordered_information(here.others(slopes))
    white = inverse(information)
    n = theta.size
    steps, stds = (white @ gradient)[n:], np.sqrt(np.diag(white)[n:])
    return bool(np.any(np.abs(steps) > np.maximum(SIGMAS * stds, LEAST_S)))


def _insisting(here: Linearised, names: Sequence[str]) -> dict[str, float]:
    """Delays of `names` that one step from the estimate finds clearly, with what it makes of them, s."""
    problem, result = here.problem, here.result
    every = replace(warmed(problem, result), delays=dict.fromkeys(names, 0.0) | dict(problem.delays))
    estimation = build(every, here.model, here.coefficients, here.effects, result.sigma)
    step, covariance = estimation.step_at(estimation.start(_values(result)))
    place = {parameter.name: i for i, parameter in enumerate(estimation.predictor.parameters)}
    found = {}
    for name in names:
        size, std = float(step[place[name]]), math.sqrt(covariance[place[name], place[name]])
        if name not in problem.delays and abs(size) > max(SIGMAS * std, LEAST_S):
            found[name] = float(np.clip(size, -0.1, 0.1))
    return found


@dataclass(frozen=True)
class LagOrDelay:
    """Whether a lag of the servos would explain late commands as well. refused, warning: what is to be said, if any."""

    refused: tuple[Refusal, ...] = ()
    warnings: tuple[str, ...] = ()


def lag_or_delay(here: Linearised, corrected_s: float) -> LagOrDelay:
    """Compare the delay of the commands that was found with a lag of the servos in its place.

    corrected_s: the part of the delay that the data were corrected for, whole samples.
    """
    problem, model, result = here.problem, here.model, here.result
    if COMMAND_DELAY not in problem.delays or model.effect("actuator_lag") is not None:
        return LagOrDelay()
    total_s = corrected_s + result.value(COMMAND_DELAY)
    if total_s <= LEAST_S:
        return LagOrDelay()
    lagging = model.with_effect(EFFECTS["actuator_lag"], {"tau": min(total_s, _LONGEST_LAG_S)})
    instead = replace(
        warmed(problem, result),
        delays={name: value for name, value in problem.delays.items() if name != COMMAND_DELAY},
        records=tuple(with_late_commands(record, -corrected_s) for record in problem.records),
    )
    values = _values(result)
    values["actuator_lag.tau"] = min(total_s, _LONGEST_LAG_S)
    try:
        found = fit(
            instead, lagging, here.coefficients, [*here.effects, ("actuator_lag", "tau")], values,
            max_iterations=_LAG_STEPS, give_up_above=result.cost + _LAG_MARGIN,
        )  # fmt: skip
    except EstimationError:
        return LagOrDelay()
    gain = result.cost - found.cost
    lag, std = found.value("actuator_lag.tau") * 1e3, found.std("actuator_lag.tau") * 1e3
    if gain > _LAG_MARGIN:
        text = (
            f"a lag of the servos of {lag:.1f} ± {std:.1f} ms explains the late commands better than a delay does:"
            " give a --structure with the effect actuator_lag"
        )
        return LagOrDelay(warnings=(text,))
    if gain > -_LAG_MARGIN:
        reason = f"a lag of the servos of {lag:.1f} ms and the delay of the commands that was found explain it alike"
        return LagOrDelay((Refusal("actuator_lag.tau", reason, "elevator-sweep"),))
    return LagOrDelay()
