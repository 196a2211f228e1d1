"""How candidates are fitted and compared: by output error in calm air, by filter error in turbulence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from sim_vehicle.model import Model
from sysid.candidates import Candidate, extended, within
from sysid.dryden import Turbulence
from sysid.errors import EstimationError
from sysid.estimate import Problem, build_filter, fit, start_values, warmed
from sysid.evidence import log_likelihood_ratio
from sysid.filter_error import FilterErrorResult
from sysid.filter_screen import filter_gains
from sysid.output_error import OutputErrorResult
from sysid.prepare import Prepared
from sysid.screening import PathScreen, sensitivity_gains

Start = Mapping[str, float]
Effects = Sequence[tuple[str, str]]
Result = OutputErrorResult | FilterErrorResult
Promise = tuple[float, dict[str, float]]

# Of the steps of output error, those after which a candidate shows how far it may come.
_FIRST_STEPS = 4
_FINALISTS, _MOST_FINALISTS = 3, 6
# Of log likelihood, within which a candidate is as near as the first.
_CLOSE = 12.5
# Twice the log likelihood up to which what is missing has not spoiled the estimates of noise and turbulence.
_LITTLE = 150.0
_SHARE_OF_BEST = 0.5
_LEAST_GUSTS = 0.02  # m/s, to start from
# Starts of a candidate, as shares of what its score promises: a size too large may lie over the hill.
_SHARES = (1.0, 0.3)


@dataclass(frozen=True)
class Setting:
    """A model with its free coefficients and effect parameters, and its estimate."""

    model: Model
    coefficients: Sequence[str]
    effects: Effects
    result: Result


@dataclass(frozen=True)
class Finalist:
    """A candidate with its estimate, and twice the log likelihood that it gains."""

    candidate: Candidate
    result: Result
    gain: float


class Engine(Protocol):
    """One way to estimate and to compare."""

    @property
    def problem(self) -> Problem:
        """What is estimated besides the model."""

    def fit(self, model: Model, coefficients: Sequence[str], effects: Effects, start: Start) -> Result:
        """The estimate of a model, to the end."""

    def looks(self, base: Setting, choices: Sequence[Candidate]) -> list[list[Promise]]:
        """Per way of looking and candidate: twice the log likelihood it promises, and values to start from."""

    def tried(self, base: Setting, candidate: Candidate, promised: Start, given: Start) -> Result | None:
        """First steps with a candidate added; None where it can be fitted from nowhere."""

    def finalists(self, base: Setting, fits: Sequence[tuple[Candidate, Result]]) -> list[Finalist]:
        """Those that have come furthest, brought to their end. fits: after first steps, the likeliest first."""

    def samples(self, leader: Result) -> float:
        """How many independent samples the likelihood rests on."""


def parameter_values(result: Result) -> dict[str, float]:
    """Estimates by parameter name, initial states left out."""
    return {p.name: float(v) for p, v in zip(result.parameters, result.theta[: len(result.parameters)], strict=True)}


@dataclass(frozen=True)
class Calm:
    """Output error over short free runs. flights: the same as in the problem."""

    problem: Problem
    flights: Sequence[Prepared]

    def fit(self, model: Model, coefficients: Sequence[str], effects: Effects, start: Start) -> OutputErrorResult:
        """See Engine."""
        return fit(self.problem, model, coefficients, effects, start)

    def looks(self, base: Setting, choices: Sequence[Candidate]) -> list[list[Promise]]:
        """Through the sensitivities, with and without regard to colour, and along the reconstructed motion."""
        result = _output_error(base.result)
        errors = {name: result.value(name) for name in self.problem.sensors}
        return [
            *(
                sensitivity_gains(
                    self.problem, base.model, base.coefficients, base.effects, result, choices, coloured
                )
                for coloured in (True, False)
            ),
            PathScreen(self.problem, self.flights, errors).gains(base.model, base.coefficients, choices),
        ]  # fmt: skip

    def tried(self, base: Setting, candidate: Candidate, promised: Start, given: Start) -> OutputErrorResult | None:
        """From the model so far, and from the model as handed in; the better."""
        so_far = parameter_values(base.result)
        rough = warmed(replace(self.problem, sub_steps=1), _output_error(base.result))
        model = extended(base.model, candidate, dict(promised))
        named = {candidate.parameter(name): value for name, value in promised.items()}
        free = [*base.coefficients, *candidate.coefficients], [*base.effects, *candidate.names]
        begun = []
        for origin in (so_far, {**so_far, **given}):
            with suppress(EstimationError):
                begun.append(fit(rough, model, *free, {**origin, **named}, max_iterations=1))
        if not begun:
            return None
        best = min(begun, key=lambda found: found.cost)
        return fit(warmed(rough, best), model, *free, parameter_values(best), max_iterations=_FIRST_STEPS - 1)

    def finalists(self, base: Setting, fits: Sequence[tuple[Candidate, Result]]) -> list[Finalist]:
        """Three, and who is as near to the first; residuals count by the colour of the likeliest's."""
        close = [i for i, (_, found) in enumerate(fits) if i < _FINALISTS or found.cost < fits[0][1].cost + _CLOSE]
        ended = [(fits[i][0], self._finished(base, *fits[i])) for i in close[:_MOST_FINALISTS]]
        leader = min((found for _, found in ended), key=lambda found: found.cost)
        start = _output_error(base.result)
        return [
            Finalist(candidate, found, log_likelihood_ratio(start, found, leader.inflation))
            for candidate, found in ended
        ]

    def _finished(self, base: Setting, candidate: Candidate, rough: Result) -> OutputErrorResult:
        values = parameter_values(rough)
        model = extended(base.model, candidate, {name: values[candidate.parameter(name)] for name in candidate.free})
        return fit(
            warmed(self.problem, _output_error(rough)),
            model,
            [*base.coefficients, *candidate.coefficients],
            [*base.effects, *candidate.names],
            values,
        )

    def samples(self, leader: Result) -> float:
        """See Engine."""
        result = _output_error(leader)
        used = np.isfinite(result.sigma)
        return float(np.sum(result.samples[used] / result.inflation[used]))


@dataclass(frozen=True)
class Rough:
    """Filter error: gusts are process noise, innovations white. gust_sigma: m/s, to start from."""

    problem: Problem
    gust_sigma: float

    def fit(self, model: Model, coefficients: Sequence[str], effects: Effects, start: Start) -> FilterErrorResult:
        """See Engine."""
        values = start_values(self.problem, model, coefficients, effects) | dict(start)
        sigma = max(self.gust_sigma, _LEAST_GUSTS)
        flight = build_filter(self.problem, model, coefficients, effects)
        return flight.solve(values, Turbulence(sigma, sigma), brief=True)

    def looks(self, base: Setting, choices: Sequence[Candidate]) -> list[list[Promise]]:
        """By one filter pass over all candidates."""
        result = _filter_error(base.result)
        return [filter_gains(self.problem, base.model, base.coefficients, base.effects, result, choices)]

    def tried(self, base: Setting, candidate: Candidate, promised: Start, given: Start) -> FilterErrorResult | None:
        """With noise and turbulence as they were without it."""
        known = _filter_error(base.result)
        best: FilterErrorResult | None = None
        for share in _SHARES:
            sizes = {name: share if _is_size(candidate, name) else 1.0 for name in promised}
            values = within(candidate, {name: sizes[name] * value for name, value in promised.items()})
            model = extended(base.model, candidate, values)
            flight = build_filter(
                self.problem,
                model,
                [*base.coefficients, *candidate.coefficients],
                [*base.effects, *candidate.names],
            )
            start = parameter_values(known) | {candidate.parameter(name): v for name, v in values.items()}
            with suppress(EstimationError):
                found = flight.solve(start, known.turbulence, known=known)
                best = found if best is None or found.cost < best.cost else best
            if best is not None and best.cost < known.cost:
                break
        return best

    def finalists(self, base: Setting, fits: Sequence[tuple[Candidate, Result]]) -> list[Finalist]:
        """Where little is missing, noise and turbulence without it are right for all, and who is near the first
        stays. Else they hold what is missing, and the first few are judged with their own.
        """
        gains = [2.0 * (base.result.cost - found.cost) for _, found in fits]
        if gains[0] < _LITTLE:
            kept = [i for i, gain in enumerate(gains) if gain > gains[0] - 2.0 * _CLOSE]
            ended = [self._finished(base, *fits[0]), *(fits[i][1] for i in kept[1:])]
            return [Finalist(fits[i][0], found, gains[i]) for i, found in zip(kept, ended, strict=True)]
        near = [i for i, gain in enumerate(gains[:_FINALISTS]) if gain > _SHARE_OF_BEST * gains[0]]
        found = [(fits[i][0], self._finished(base, *fits[i])) for i in near]
        return [Finalist(candidate, one, 2.0 * (base.result.cost - one.cost)) for candidate, one in found]

    def _finished(self, base: Setting, candidate: Candidate, rough: Result) -> FilterErrorResult:
        """With noise and turbulence of its own."""
        found = _filter_error(rough)
        values = parameter_values(found)
        model = extended(base.model, candidate, {name: values[candidate.parameter(name)] for name in candidate.free})
        flight = build_filter(
            self.problem, model, [*base.coefficients, *candidate.coefficients], [*base.effects, *candidate.names]
        )
        try:
            return flight.solve(values, found.turbulence, brief=True)
        except EstimationError:
            return found

    def samples(self, leader: Result) -> float:
        """See Engine."""
        return float(sum(np.isfinite(one).sum() for one in _filter_error(leader).residuals))


def _is_size(candidate: Candidate, name: str) -> bool:
    """Whether a parameter is a size that may be small, not a limit."""
    return next(p for p in candidate.effect.parameters if p.name == name).low <= 1e-3


def _output_error(result: Result) -> OutputErrorResult:
    assert isinstance(result, OutputErrorResult)
    return result


def _filter_error(result: Result) -> FilterErrorResult:
    assert isinstance(result, FilterErrorResult)
    return result
