"""What every effect of the catalogue promises: score tests on one filter pass.

At the estimate of the model so far, each candidate adds columns of its own to the linearised flight: how one step and
one reading change where the effect is there. One Kalman pass carries them along with the slopes by the parameters and
gives information and gradient of all together. With c a candidate's parameters and b all others,

    gain = g' S^-1 g,   g = g_c - I_cb I_bb^-1 g_b,   S = I_cc - I_cb I_bb^-1 I_bc

is twice the log likelihood to be won (Rao's score test), and S^-1 g the size to start from. Gusts are process noise of
the same filter, so that what an effect does is not taken for what they do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim_vehicle.model.model_file import Model
from sysid.arrays import Array
from sysid.discrepancy.candidates import Candidate, alone, extended
from sysid.filter_error.estimation import build_filter
from sysid.filter_error.estimator import FilterErrorResult
from sysid.filter_error.initial_noise import settled_path
from sysid.numerics.normal_equations import inverse
from sysid.problem.problem import Problem, predictor_of

# A start value is moved by what the score tells, but not by more than these factors.
_LEAST, _MOST = 0.1, 3.0
# Of an effect's plausible range, beyond which the score's linear prediction is not followed.
_RANGE = 0.5
# Share of a direction that nothing else can imitate, below which it is taken for an imitation.
_OWN = 1e-6


@dataclass(frozen=True)
class _Column:
    """One parameter of one candidate, from one start: where it stands and by how much it was moved."""

    candidate: int
    start: int
    name: str
    moved: float


def filter_gains(
    problem: Problem,
    model: Model,
    coefficients: Sequence[str],
    effects: Sequence[tuple[str, str]],
    base: FilterErrorResult,
    choices: Sequence[Candidate],
) -> list[tuple[float, dict[str, float]]]:
    """Twice the log likelihood that each candidate promises, and the parameters to start from."""
    flight = build_filter(problem, model, coefficients, effects)
    noise, theta = base.sigma[flight.columns] ** 2, base.theta
    linear, _ = settled_path(flight, theta, noise, base.turbulence)
    columns: list[_Column] = []
    changed = []
    for i, candidate in enumerate(choices):
        for s, start in enumerate(candidate.starts):
            for name in candidate.sizes:
                values = alone(candidate, start, name)
                trial = predictor_of(problem, extended(model, candidate, values), coefficients, effects)
                changed.append(trial.apply(theta)[0])
                columns.append(_Column(i, s, name, values[name]))
    wide = [flight.widened(k, one, theta, changed) for k, one in enumerate(linear)]
    found = flight.filtered(wide, noise, base.turbulence)
    own = theta.size
    inner = found.information[:own, :own] + flight.prior_information
    downhill = found.gradient[:own] - flight.prior_information @ (theta - flight.prior_mean)
    solve = inverse(inner)
    cross = found.information[own:, :own]
    score = found.gradient[own:] - cross @ solve @ downhill
    outer = found.information[own:, own:]
    schur = outer - cross @ solve @ cross.T
    return [_best(i, choice, columns, score, schur, np.diag(outer)) for i, choice in enumerate(choices)]


def _best(
    index: int, candidate: Candidate, columns: Sequence[_Column], score: Array, schur: Array, whole: Array
) -> tuple[float, dict[str, float]]:
    """Gain of one candidate from its best start, and the values that the scores lead to."""
    best = (0.0, dict(candidate.starts[0]))
    for s, start in enumerate(candidate.starts):
        places = [
            j
            for j, column in enumerate(columns)
            if (column.candidate, column.start) == (index, s)
            and np.isfinite(whole[j])
            and schur[j, j] > _OWN * whole[j]
        ]
        if not places:
            continue
        shares = inverse(schur[np.ix_(places, places)]) @ score[places]
        gain = float(shares @ score[places])
        values = dict(start)
        for share, j in zip(shares, places, strict=True):
            values[columns[j].name], possible = _moved(candidate, start, columns[j], float(share))
            gain = gain if possible else 0.0
        if gain > best[0]:
            best = (gain, values)
    return best


def _moved(candidate: Candidate, start: dict[str, float], column: _Column, share: float) -> tuple[float, bool]:
    """A parameter moved as its score tells, within reason, and whether an effect of that sign is possible."""
    parameter = next(p for p in candidate.effect.parameters if p.name == column.name)
    if start[column.name] == 0.0 or parameter.low < 0.0:
        reach = _RANGE * max(abs(parameter.low), abs(parameter.high))
        low = 0.0 if parameter.low >= 0.0 else -reach
        return float(np.clip(share * column.moved, low, reach)), True
    if not candidate.is_size(column.name):
        # A limit, not a size: an effect that is too large by its score has its limit too near.
        return start[column.name], share > 0.0
    return float(np.clip(share, _LEAST, _MOST)) * start[column.name], share > 0.0
