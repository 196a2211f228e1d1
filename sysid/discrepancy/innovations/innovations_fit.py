"""A model fitted by filter error, as the search for missing effects asks of it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from sim_vehicle.effects import EFFECTS
from sim_vehicle.effects.sensor import AIRSPEED_ERROR
from sim_vehicle.model.model_file import Model
from sysid.discrepancy.candidate_fit import Trial
from sysid.discrepancy.candidates import Candidate, candidates, is_possible, without_absent
from sysid.discrepancy.identified_effect import Named
from sysid.discrepancy.innovations.candidate_fits import (
    Finalist,
    FittedModel,
    fit_full,
    fit_short,
    rank,
    values_of,
    wald_statistic,
)
from sysid.discrepancy.innovations.filter_scores import filter_gains
from sysid.discrepancy.innovations.lack_of_fit import lack_of_fit
from sysid.discrepancy.innovations.posed_flights import is_beyond_bench, timed
from sysid.discrepancy.naming_rule import LEAST_PROMISE, PROMISE_SHARE, LeftOver, is_too_little_beside
from sysid.discrepancy.significance import Significance, chance_of, is_significant
from sysid.errors import EstimationError
from sysid.filter_error.estimation import build_filter
from sysid.filter_error.estimator import FilterErrorResult
from sysid.problem.estimation_problem import Problem, Progress, model_of

_MOST_TRIED = 8  # candidates fitted at each step
# Times as much as a candidate gains by the noise of the model without it that it may gain by its own.
_RISE = 3.0
# Steps of a fit without what was named before.
_STEPS_BACK = 12
# Turbulence, m/s, from which on gains that are held fixed make standard errors of sideslip's derivatives up to three
# times too small (sysid.filter_error.joint_score).
_GUSTS = 0.02


@dataclass(frozen=True)
class InnovationsFit:
    """A model with its estimate.

    benched: the flights with what a bench leaves of the airspeed's errors estimated. proposed: effects that were found
    elsewhere, tried beside what is promising. came_with: what the first that was named gained then.
    """

    problem: Problem
    at: FittedModel
    benched: Problem
    proposed: Sequence[Named] = ()
    came_with: float = 0.0

    @property
    def model(self) -> Model:
        """It, with its estimates."""
        return self.at.model

    @property
    def result(self) -> FilterErrorResult:
        """The estimates."""
        return self.at.result

    @property
    def cost(self) -> float:
        """Negative log likelihood, prior included."""
        return self.result.cost

    @property
    def is_rough(self) -> bool:
        """Whether the air was rough enough for gains that are held fixed to matter."""
        return max(self.result.turbulence.vertical, self.result.turbulence.horizontal) > _GUSTS

    @cached_property
    def samples(self) -> float:
        """How many were compared."""
        return float(sum(np.isfinite(one).sum() for one in self.result.residuals))

    @property
    def evidence(self) -> float:
        """Logarithm of the evidence, by Schwarz's approximation."""
        values, at = self.result.values(), self.at
        odd = sum(_surprise(effect, name, values[f"{effect}.{name}"]) for effect, name in at.effects)
        return -self.cost - 0.5 * (self._price(len(at.coefficients) + len(at.effects)) + odd)

    def choices(self) -> list[Candidate]:
        """Every effect of the catalogue that the flights could show."""
        return candidates(self.problem, self.model)

    def trials(self, choices: Sequence[Candidate], progress: Progress) -> list[Trial[Self]]:
        """The promising ones of these, the likeliest fitted to the end."""
        worth = [*self._promising(choices), *self._proposed(choices)]
        fits: dict[int, tuple[Candidate, FilterErrorResult]] = {}
        for position, (candidate, start) in enumerate(worth):
            progress((position + 1.0) / (len(worth) + 2.0), f"trying {candidate.effect.name}")
            begun = fit_short(self.problem, self.at, candidate, start)
            if begun is not None and is_possible(candidate, values_of(candidate, begun), self.problem.records):
                key = choices.index(candidate)
                fits[key] = min(fits.get(key, (candidate, begun)), (candidate, begun), key=lambda item: item[1].cost)
        tried = sorted(fits.values(), key=lambda item: item[1].cost)
        if not tried:
            return []
        gain = 2.0 * (self.cost - tried[0][1].cost)
        if self.came_with and is_too_little_beside(self.came_with, _RISE * gain):
            return [self._trial(Finalist(*tried[0], gain))]
        progress((len(worth) + 1.0) / (len(worth) + 2.0), "fitting the likeliest to the end")
        return [self._trial(self._without_absent(one)) for one in rank(self.problem, self.at, tried)]

    def confirmed(self, trial: Trial[Self], significance: Significance) -> Significance:
        """The same: innovations are white."""
        return significance

    def with_named(self, trial: Trial[Self]) -> Self:
        """The fit of a trial, with errors that a bench leaves and the timing of the commands chosen anew: what was
        missing may have made others the likelier.
        """
        found = replace(trial.fit, came_with=self.came_with or trial.gain)
        problem = replace(self.benched, command_first=found.problem.command_first)
        if (
            problem.sensors.keys() != found.problem.sensors.keys()
            and trial.candidate.effect.name != AIRSPEED_ERROR.name
        ):
            known = found.result
            flight = build_filter(problem, found.model, found.at.coefficients, found.at.effects)
            with suppress(EstimationError):
                result = flight.solve(known.values(), known.turbulence, known=known)
                if not is_beyond_bench(result, problem):
                    found = replace(found._with(result), problem=problem)
        problem, result = timed(found.problem, found.model, found.at.coefficients, found.at.effects, found.result)
        return found if problem is found.problem else replace(found._with(result), problem=problem)

    def without(self, candidate: Candidate) -> Self | None:
        """The fit without a candidate that it has; None where the filter then loses the flights."""
        own = {candidate.parameter(name) for name in candidate.free}
        coefficients = [name for name in self.at.coefficients if name not in own]
        effects = [pair for pair in self.at.effects if pair not in candidate.names]
        model = replace(
            self.model,
            coefficients={name: value for name, value in self.model.coefficients.items() if name not in own},
            effects=tuple(e for e in self.model.effects if candidate.coefficients or e.name != candidate.effect.name),
            correlation=None,
        )
        flight, known = build_filter(self.problem, model, coefficients, effects), self.result
        start = {name: value for name, value in known.values().items() if name not in own}
        try:
            result = flight.solve(start, known.turbulence, known=known, max_iterations=_STEPS_BACK)
            if 2.0 * (result.cost - known.cost) < LEAST_PROMISE:
                again = flight.solve(result.values(), known.turbulence, near=result, brief=True)
                result = min(result, again, key=lambda one: one.cost)
        except EstimationError:
            return None
        return replace(self, at=FittedModel(model, coefficients, effects, result))._with(result)

    def values_of(self, candidate: Candidate) -> dict[str, tuple[float, float]]:
        """Value and standard error of a candidate's parameters, by name."""
        return values_of(candidate, self.result)

    def sharpened(self) -> Self:
        """Estimated once more where turbulence is, noise and turbulence together with everything else. What cannot be
        scored stays as it is.
        """
        if self.is_rough and not self.result.together:
            flight = build_filter(self.problem, self.model, self.at.coefficients, self.at.effects)
            with suppress(EstimationError):
                return self._with(flight.solve(self.result.values(), self.result.turbulence))
        return self

    def doubtful(self, named: Sequence[Named]) -> Named | None:
        """Of these the one whose size is most within its standard error (Wald's test); None where all are beyond
        theirs, where nothing was sharpened, and of limits, which are no sizes: the likelihood must be enough.
        """
        if not (self.is_rough and self.result.together):
            return None
        found = []
        for one in named:
            statistic = wald_statistic(one.candidate, self.result)
            if statistic is not None and not is_significant(
                Significance(1.0, statistic, chance_of(statistic, len(one.candidate.free))), one.tried
            ):
                found.append((statistic, one))
        return min(found, key=lambda item: item[0])[1] if found else None

    def left(self, least: float) -> dict[str, LeftOver]:
        """Outputs with noise that is coloured, and axes in which smooth terms gain more than chance allows."""
        return lack_of_fit(self.problem, self.at, least)

    def _with(self, result: FilterErrorResult) -> Self:
        """Another estimate of the same model."""
        at, model = self.at, self.model
        model = model_of(model, model.name, result, at.coefficients, at.effects, (), model.validity)
        return replace(self, at=replace(at, model=model, result=result))

    def _trial(self, one: Finalist) -> Trial[Self]:
        candidate, values = one.candidate, values_of(one.candidate, one.result)
        sizes = {name: value for name, (value, _) in values.items()}
        model = self.model.with_effect(candidate.effect, sizes, {name: std for name, (_, std) in values.items()})
        at = FittedModel(
            model, [*self.at.coefficients, *candidate.coefficients], [*self.at.effects, *candidate.names], one.result
        )
        odd = sum(_surprise(effect, name, sizes[name]) for effect, name in candidate.names)
        fit = replace(self, at=at)._with(one.result)
        return Trial(candidate, fit, values, one.shown, 0.5 * (one.shown - self._price(len(sizes)) - odd))

    def _without_absent(self, whole: Finalist) -> Finalist:
        """A finalist without parameters that are as good as absent, where it is likelier without them."""
        fewer = without_absent(whole.candidate, values_of(whole.candidate, whole.result))
        begun = None if fewer is None else fit_short(self.problem, self.at, fewer, fewer.starts[0])
        if fewer is None or begun is None:
            return whole
        result = fit_full(self.problem, self.at, fewer, begun)
        lost = 2.0 * (result.cost - whole.result.cost)
        price = self._price(len(whole.candidate.free) - len(fewer.free))
        return Finalist(fewer, result, whole.gain - lost) if lost < price else whole

    def _price(self, parameters: int) -> float:
        """Twice the log evidence that so many parameters cost."""
        return parameters * float(np.log(self.samples))

    def _proposed(self, choices: Sequence[Candidate]) -> list[tuple[Candidate, dict[str, float]]]:
        """Candidates that were found elsewhere and are not named yet, each with its values there."""
        return [
            (choice, {name: value for name, (value, _) in one.values.items()})
            for one in self.proposed
            for choice in choices
            if choice.names == one.candidate.names and choice.free == one.candidate.free
            and choice.effect == one.candidate.effect
        ]  # fmt: skip

    def _promising(self, choices: Sequence[Candidate]) -> list[tuple[Candidate, dict[str, float]]]:
        """Candidates worth a fit, with the start each promises most from."""
        at = self.at
        gains = filter_gains(self.problem, at.model, at.coefficients, at.effects, at.result, choices)
        order = sorted(range(len(choices)), key=lambda i: -gains[i][0])
        best = gains[order[0]][0] if order else 0.0
        if best < LEAST_PROMISE:
            return []
        limit = max(0.5 * LEAST_PROMISE, PROMISE_SHARE * best)
        return [(choices[i], gains[i][1]) for i in order[:_MOST_TRIED] if gains[i][0] >= limit]


def _surprise(effect: str, name: str, value: float) -> float:
    """Twice the log likelihood that a parameter of this value has lost before the flight, beside a usual one."""
    usual = EFFECTS[effect].parameter(name).usual
    return (value / usual) ** 2 if usual else 0.0
