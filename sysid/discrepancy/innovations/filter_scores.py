"""What every effect of the catalogue promises filter error: score tests on one filter pass.

One Kalman pass carries the columns of all candidates (how one step and one reading change where an effect is there)
along with the slopes by the parameters and gives information and gradient of all together. Gusts are process noise of
the same filter, so that what an effect does is not mistaken for what they do.
"""

from __future__ import annotations

from collections.abc import Sequence

from sim_vehicle.model.model_file import Model
from sysid.discrepancy.candidates import Candidate, alone, extended
from sysid.discrepancy.score_test import ScoredColumn, gains_of
from sysid.filter_error.estimation import build_filter
from sysid.filter_error.estimator import FilterErrorResult
from sysid.filter_error.initial_noise import settled_path
from sysid.problem.estimation_problem import Problem, predictor_of


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
    columns: list[ScoredColumn] = []
    changed = []
    for i, candidate in enumerate(choices):
        for s, start in enumerate(candidate.starts):
            for name in candidate.sizes:
                values = alone(candidate, start, name)
                trial = predictor_of(problem, extended(model, candidate, values), coefficients, effects)
                changed.append(trial.apply(theta)[0])
                columns.append(ScoredColumn(i, s, name, values[name]))
    wide = [flight.widened(k, one, theta, changed) for k, one in enumerate(linear)]
    found = flight.filtered(wide, noise, base.turbulence)
    own = theta.size
    return gains_of(
        choices, columns, found.information[:own, :own] + flight.prior_information,
        found.gradient[:own] - flight.prior_information @ (theta - flight.prior_mean),
        found.information[own:], found.gradient[own:],
    )  # fmt: skip
