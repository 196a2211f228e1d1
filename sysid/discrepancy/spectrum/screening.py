"""What every candidate promises a group of axes, at the cost of one simulation each.

At the maximum without it Rao's score test predicts what an effect would gain (sysid.discrepancy.score_test), with what
is left of the outputs as noise. A model without a damping that the aircraft has, or without a lift that lags, is fitted
so far from the truth that slopes say nothing there. So every candidate is looked at from elsewhere too, beside the
model without it from the same place: from equation error's values, and from the model as it was given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from sysid.discrepancy.candidates import Candidate, alone, extended
from sysid.discrepancy.score_test import ScoredColumn, gains_of
from sysid.discrepancy.spectrum.group_fits import GroupFit
from sysid.errors import SysidError
from sysid.posterior.group_model import SERVO
from sysid.posterior.start_values import equation_error_starts

# A direction of which nuisances and coefficients leave no more than this share is imitated by them.
_OWN = 1e-3
# Whitened change, as a sum of squares, that is none.
_NOTHING = 1e-6


@dataclass(frozen=True)
class PredictedGain:
    """Twice the log likelihood that a candidate may gain, and values to start from.

    acts: whether it moves any output at all.
    """

    gain: float
    values: dict[str, float]
    acts: bool


@dataclass(frozen=True)
class RestartGain:
    """Twice the log likelihood by which a candidate is better than the model without it from another place.

    cost: half the deviance there. start: values of other unknowns there, as `GroupFit.with_effect` takes them.
    """

    gain: float
    cost: float
    values: dict[str, float]
    start: dict[str, float]


def promises(fit: GroupFit, choices: Sequence[Candidate]) -> list[PredictedGain]:
    """What each candidate promises one group."""
    # With twice the step a difference is as good.
    posterior, theta = fit.posterior.of(fit.posterior.model.rough()), fit.theta
    at = posterior.point(theta)
    posterior.weigh(at)
    J, e = posterior.linear(at)
    columns: list[ScoredColumn] = []
    moved = []
    acts: set[int] = set()
    for i, candidate in enumerate(choices):
        if candidate.coefficients and not any(fit.takes(name) for name in candidate.coefficients):
            continue
        for s, start in enumerate(candidate.starts):
            for name in candidate.sizes:
                values = alone(candidate, start, name)
                with suppress(SysidError):
                    # Where the effect needs what the parts do not have, it cannot be looked at.
                    flown = posterior.model.flying(
                        extended(fit.structure, candidate, values), fit.coefficients, fit.effects
                    )
                    difference = posterior.difference(at, flown)
                    if not np.isfinite(difference).all():
                        acts.add(i)
                    if np.isfinite(difference).all():
                        columns.append(ScoredColumn(i, s, name, values[name]))
                        moved.append(difference)
    if not columns:
        return [PredictedGain(0.0, dict(one.starts[0]), i in acts) for i, one in enumerate(choices)]
    C = np.array(moved).T
    off = theta - posterior.prior.mean
    found = gains_of(
        choices, columns, J.T @ J + posterior.prior.information, J.T @ e - posterior.prior.information @ off,
        np.concatenate((C.T @ J, C.T @ C), axis=1), C.T @ e, _OWN,
    )  # fmt: skip
    power = np.sum(C**2, axis=0)
    acts |= {column.candidate for column, size in zip(columns, power, strict=True) if size > _NOTHING}
    return [PredictedGain(gain, values, i in acts) for i, (gain, values) in enumerate(found)]


def second_looks(
    fit: GroupFit, choices: Sequence[Candidate], first: Sequence[PredictedGain], given: Mapping[str, float]
) -> list[RestartGain | None]:
    """What each candidate promises one group from other places; None where it does not act, or is lost from there.

    first: what each promises at the maximum. given: values of the model's coefficients and parameters of effects before
    anything was fitted.
    """
    model = fit.posterior.model
    servos = {name: value for name, value in fit.nuisances().items() if name in SERVO}
    as_given = {**{name: value for name, value in given.items() if name in fit.names}, **servos}
    at_given = fit.profile_cost_from(None, {}, as_given)
    lag = next((one.mean for one in model.unknowns if one.name == "servo_lag"), 0.0)

    def by_equation_error(more: Sequence[str]) -> tuple[float, dict[str, float]]:
        places = [
            {**values, "servo_delay": max(delay - lag, 0.0)}
            for values, delay in equation_error_starts(model.parts, model.vehicle, [*fit.coefficients, *more])
        ]
        added = [{name: one[name] for name in more} for one in places]
        costs = [fit.profile_cost_from(candidate, add, one) for add, one in zip(added, places, strict=True)]
        best = int(np.argmin(costs))
        return costs[best], places[best]

    found: list[RestartGain | None] = []
    candidate: Candidate | None = None
    least, place = by_equation_error([])
    for candidate, promise in zip(choices, first, strict=True):
        own = [name for name in candidate.coefficients if fit.takes(name)]
        if own:
            cost, start = by_equation_error(own)
            one = RestartGain(2.0 * (least - cost), cost, {name: start[name] for name in own}, start)
        elif candidate.coefficients or not promise.acts:
            found.append(None)
            continue
        else:
            tried = [
                (fit.profile_cost_from(candidate, values, start), i, start)
                for start in (as_given, place)
                for i, values in enumerate(candidate.starts)
            ]
            cost, i, start = min(tried, key=lambda item: item[0])
            one = RestartGain(2.0 * (min(at_given, least) - cost), cost, dict(candidate.starts[i]), start)
        found.append(one if np.isfinite(one.cost) else None)
    return found
