"""The noise of measured thrust and propeller speed, inputs of the simulation, as part of the one-step estimate.

The likelihood takes inputs as exact. Smoothed thrust still has errors of level, gain and lag, known in size, and so has
a propeller's smoothed speed, whose torque rolls the aircraft. The motion itself determines them as well: each becomes
an unknown c_k with a Gaussian prior of one standard deviation beside the parameters. They are small, so one joint
Gauss-Newton step from the estimate with exact inputs is enough (errors in inputs as nuisance parameters with priors:
Maine & Iliff, NASA RP-1168, section 5.4, maximum a posteriori).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np

from sim_vehicle.constants import SEA_LEVEL_DENSITY
from sim_vehicle.effects.environment import DENSITY_ERROR
from sim_vehicle.effects.sensor import AIRSPEED_ERROR, PITOT_LAG
from sim_vehicle.model.model_file import Model
from sysid.arrays import Array
from sysid.errors import EstimationError
from sysid.numerics.normal_equations import inverse, solve
from sysid.numerics.parallel import side_by_side
from sysid.output_error.estimator import OutputErrorResult
from sysid.output_error.from_problem import build, fit, warmed
from sysid.output_error.linearisation import OutputErrorLinearisation
from sysid.problem.estimation_problem import Problem
from sysid.problem.predictor import Predictor, free_states
from sysid.signals.record import OUTPUTS, STATES, Record, angle_wrap
from sysid.signals.thrust.denoising import denoised_thrust

_AHEAD = STATES.index("u")
# What stands between the airspeed and its reading beside the sensor's bias and scale.
_AIRSPEED_EFFECTS = tuple(effect.name for effect in (AIRSPEED_ERROR, PITOT_LAG, DENSITY_ERROR))


@dataclass(frozen=True)
class InputError:
    """One error of the inputs of some records: record index -> its errors of thrust and throttle, (M,) each, of one
    standard deviation, and what it does to the record's outputs (N, 15).
    """

    inputs: dict[int, tuple[Array, Array]]
    outputs: dict[int, Array]


def _parts(record: Record) -> list[tuple[Array, Array]]:
    """The independent errors of a record's inputs, each of thrust (M,) and of the throttle (M,)."""
    nothing = np.zeros(record.thrust.size)
    if record.thrust_source.signal == "rpm":
        return list(zip_longest(record.thrust_doubt, record.rotor_doubt, fillvalue=nothing))
    return [(row, nothing) for row in record.thrust_doubt] + [(nothing, row) for row in record.rotor_doubt]


def _with_errors(record: Record, thrust: Array, throttle: Array) -> Record:
    """The record with errors (M,) added to its inputs."""
    commands = record.commands.copy()
    commands[:, 3] += throttle
    return replace(record, thrust=record.thrust + thrust, commands=commands)


def with_input_noise(here: OutputErrorLinearisation) -> tuple[Problem, OutputErrorResult]:
    """The estimate with the errors of thrust and propeller speed estimated beside it, and the problem so corrected."""
    problem, result = here.problem, here.result
    every = doubts(here)
    if not every:
        return problem, result
    step, covariance = _joint_step(here, every)
    n = result.theta.size
    white = covariance[:n, :n]
    # What colour of the residuals adds to the standard errors, it adds here too.
    growth = np.sqrt(np.diag(result.covariance) / np.diag(result.covariance_white))
    left = [residual.copy() for residual in here.residuals]
    for index in range(len(left)):
        left[index] -= here.S[index] @ step[here.estimation.places(index)]
        for doubt, size in zip(every, step[n:], strict=True):
            if index in doubt.outputs:
                left[index] -= size * doubt.outputs[index]
    theta = here.estimation.bounded(result.theta + step[:n])
    corrected = replace(
        result, theta=theta, covariance=white * np.outer(growth, growth), covariance_white=white,
        residuals=tuple(left),
    )  # fmt: skip
    return replace(problem, records=_corrected(problem.records, every, step[n:])), corrected


def with_thrust_by_airspeed(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    result: OutputErrorResult,
) -> tuple[Problem, OutputErrorResult]:
    """The estimate with thrust that follows the airspeed of the simulation.

    Where thrust falls with airspeed, noise of the measured airspeed becomes noise of the thrust, which acts like rough
    air and errs with what it is compared with. How it falls comes from the estimate's own airspeed, which has no such
    noise and none of the sensor's errors; in the simulation thrust then follows what is flown. problem, model,
    coefficients, effects: as they were given to `fit`, which gave `result`; the same two come back where no thrust
    follows the airspeed, or the model has an effect by which its sensor misreads it.
    """
    groups: dict[tuple[str, int], list[int]] = {}
    misread = any(model.effect(name) is not None for name in _AIRSPEED_EFFECTS)
    for index, record in enumerate(problem.records):
        if not misread and record.thrust_read.size and _AHEAD in free_states(record):
            groups.setdefault((record.flight, record.stretch), []).append(index)
    if not groups:
        return problem, result
    estimation = build(problem, model, coefficients, effects, result.sigma)
    predicted = estimation.predict(result.theta)
    _, errors = estimation.predictor.apply(result.theta)
    records, calibrated = list(problem.records), problem.vehicle.sensors.airspeed.kind != "true"
    for indices in groups.values():
        flown = [np.arange(records[i].start, records[i].start + records[i].length) for i in indices]
        airspeed = np.concatenate([_true_airspeed(predicted[i], records[i], errors, calibrated) for i in indices])
        read = np.concatenate([records[i].thrust_read[part] for i, part in zip(indices, flown, strict=True)])
        throttle = np.concatenate([records[i].commands[part, 3] for i, part in zip(indices, flown, strict=True)])
        again = denoised_thrust(read, throttle, records[indices[0]].interval_s, airspeed)
        place = 0
        for i, part in zip(indices, flown, strict=True):
            thrust, doubt = records[i].thrust.copy(), np.zeros((again.doubt.shape[0], records[i].thrust.size))
            own = slice(place, place + part.size)
            thrust[part], doubt[:, part] = again.values[own], again.doubt[:, own]
            flying = np.zeros(0)
            if again.law is not None:
                flying = np.full(thrust.size, airspeed[place])
                flying[part] = airspeed[own]
            records[i] = replace(
                records[i], thrust=thrust, thrust_doubt=doubt, law=again.law, airspeed=flying, thrust_noise=again.noise
            )  # fmt: skip
            place += part.size
    corrected = warmed(replace(problem, records=tuple(records)), result)
    values = {parameter.name: float(v) for parameter, v in zip(result.parameters, result.theta, strict=False)}
    try:
        return corrected, fit(corrected, model, coefficients, effects, values)
    except EstimationError:
        # The estimate before stands, with the thrust that it had.
        return problem, result


def _is_doubtful(record: Record) -> bool:
    return bool(record.thrust_doubt.size or record.rotor_doubt.size)


def doubts(here: OutputErrorLinearisation) -> list[InputError]:
    """Every error of the inputs; records of one stretch share theirs."""
    groups: dict[tuple[str, int], list[int]] = {}
    for index, record in enumerate(here.problem.records):
        if _is_doubtful(record):
            groups.setdefault((record.flight, record.stretch), []).append(index)
    if not groups:
        return []
    estimation, theta = here.estimation, here.result.theta
    flat, errors = estimation.predictor.apply(theta)
    pushes = {index: _parts(here.problem.records[index]) for indices in groups.values() for index in indices}
    every = [(index, part) for index, parts in pushes.items() for part in range(len(parts))]
    before = here.predicted

    def pushed(index: int, part: int) -> Array:
        other = Predictor(
            estimation.predictor.flat, estimation.predictor.parameters,
            (_with_errors(here.problem.records[index], *pushes[index][part]),),
            sub_steps=estimation.predictor.sub_steps, command_first=here.problem.command_first,
        )  # fmt: skip
        states = estimation.predictor.initial_states(index, theta, estimation.guesses[index])
        return angle_wrap(other.outputs(0, flat, errors, states) - before[index])

    outputs = dict(zip(every, side_by_side(pushed, *zip(*every, strict=True)), strict=True))
    return [
        InputError(
            {index: pushes[index][part] for index in indices}, {index: outputs[index, part] for index in indices}
        )
        for indices in groups.values()
        for part in range(len(pushes[indices[0]]))
    ]


def _true_airspeed(predicted: Array, record: Record, errors: Mapping[str, float], calibrated: bool) -> Array:
    """(N,) m/s of a record's outputs, without the sensor's errors."""
    read = predicted[:, OUTPUTS.index("airspeed")]
    flown = (read - errors.get("airspeed_bias", 0.0)) / (1.0 + errors.get("airspeed_scale", 0.0))
    rho = record.rho[record.start : record.start + record.length]
    return np.asarray(flown * np.sqrt(SEA_LEVEL_DENSITY / rho) if calibrated else flown)


def _joint_step(here: OutputErrorLinearisation, every: Sequence[InputError]) -> tuple[Array, Array]:
    """Gauss-Newton step of the unknowns and of the doubts, and the covariance of both."""
    joint, gradient = here.bordered_information(here.others([doubt.outputs for doubt in every]))
    return solve(joint, gradient), inverse(joint)


def _corrected(records: Sequence[Record], every: Sequence[InputError], sizes: Array) -> tuple[Record, ...]:
    """The records with the estimated errors added to their inputs."""
    corrected = list(records)
    for doubt, size in zip(every, sizes, strict=True):
        for index, (thrust, throttle) in doubt.inputs.items():
            corrected[index] = _with_errors(corrected[index], size * thrust, size * throttle)
    return tuple(corrected)
