"""One group of axes under a model with more or fewer unknowns, fitted from where it stood.

Models are compared by their evidence, the probability of the measurement with every unknown's prior integrated over
(MacKay, "Information Theory, Inference, and Learning Algorithms", ch. 28). The spectrum of what is left is estimated
anew under each: what nobody models (gusts, vibration, the aircraft's own tables) is in it and counts against all alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np

from sim_vehicle.effects import Parameter
from sim_vehicle.model.model_file import Model
from sysid.arrays import Array
from sysid.discrepancy.candidates import Candidate, extended, within
from sysid.errors import EstimationError
from sysid.numerics.normal_equations import inverse
from sysid.posterior.considered_errors import ConsiderParameter
from sysid.posterior.estimates import GroupEstimate
from sysid.posterior.estimator import Posterior
from sysid.posterior.likelihood import Prior
from sysid.posterior.nuisance_priors import GROUPS
from sysid.problem.model_structure import is_longitudinal, usual_size

_PASSES = 8  # of Gauss-Newton from a candidate's start
# Prior of a coefficient that may be missing: so many usual sizes about none. Of another size: a share of its range.
_COEFFICIENT, _SIZE = 3.0, 0.25
# Of a moment that something happened at, s.
_MOMENT_S = 1.0


@dataclass(frozen=True)
class Fresh:
    """An unknown that a model did not have: where to start, prior and bounds."""

    start: float
    mean: float
    std: float
    low: float
    high: float


@dataclass(frozen=True)
class GroupFit:
    """A group of axes at the maximum of its posterior.

    theta: (P,) all unknowns. structure: of this group, values ignored where they are free. coefficients, effects: that
    are free. evidence: its logarithm, of use beside other fits of the same parts. doubts: what was taken as known.
    """

    posterior: Posterior
    theta: Array
    structure: Model
    coefficients: tuple[str, ...]
    effects: tuple[tuple[str, str], ...]
    evidence: float
    doubts: Sequence[ConsiderParameter]

    @cached_property
    def cost(self) -> float:
        """Negative log likelihood, noise estimated here."""
        return self.posterior.profile_cost(self.theta)

    @property
    def names(self) -> tuple[str, ...]:
        """Of coefficients and parameters of effects that are free, as they stand in `theta`."""
        return tuple(one.name for one in self.posterior.model.parameters)

    def values(self) -> dict[str, float]:
        """Coefficients and parameters of effects that are free."""
        return dict(zip(self.names, self.theta[: len(self.names)].tolist(), strict=True))

    def covariance(self) -> Array:
        """(P, P) of them, in the order of `names`, with the noise as it is estimated here."""
        posterior, count = self.posterior, len(self.names)
        at = posterior.point(self.theta)
        posterior.weigh(at)
        H, _ = posterior.normal(at)
        return np.asarray(inverse(H)[:count, :count])

    def stds(self) -> dict[str, float]:
        """Their standard deviations."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance())).tolist(), strict=True))

    def ended(self) -> GroupEstimate:
        """The group, estimated, with bars that count all."""
        return GroupEstimate(self.posterior, self.posterior.solve(self.theta, self.doubts), self.doubts)

    def takes(self, name: str) -> bool:
        """Whether a coefficient is of this group's axes."""
        return is_longitudinal(name) == (self.posterior.model.group == GROUPS[0])

    def with_effect(
        self, candidate: Candidate, values: Mapping[str, float], start: Mapping[str, float] | None = None
    ) -> GroupFit | None:
        """The fit with a candidate's parameters free, from these values; None where it is lost.

        start: values of other unknowns to start from, nuisances that are not among them from what was known of them
        before the flight; None starts all from where they are.
        """
        values = within(candidate, dict(values))
        own = [name for name in candidate.coefficients if self.takes(name)]
        fresh = {
            candidate.parameter(name): fresh_unknown(candidate, name, values[name])
            for name in candidate.free
            if not candidate.coefficients or name in own
        }
        model = self._of_own_axes(extended(self.structure, candidate, values))
        begun = self._rebuilt(model, (*self.coefficients, *own), (*self.effects, *candidate.names), fresh, start)
        return begun.searched()

    def flying(self, candidate: Candidate, values: Mapping[str, float]) -> GroupFit | None:
        """The fit with an effect that is as it is; None where it is lost."""
        model = self._of_own_axes(extended(self.structure, candidate, within(candidate, dict(values))))
        return self._rebuilt(model, self.coefficients, self.effects).searched()

    def without(self, candidate: Candidate) -> GroupFit | None:
        """The fit without a candidate that it has; None where it is lost."""
        gone = set(candidate.coefficients)
        kept = {name: entry for name, entry in self.structure.coefficients.items() if name not in gone}
        others = tuple(e for e in self.structure.effects if candidate.coefficients or e.name != candidate.effect.name)
        begun = self._rebuilt(
            replace(self.structure, coefficients=kept, effects=others),
            tuple(name for name in self.coefficients if name not in gone),
            tuple(pair for pair in self.effects if pair not in candidate.names),
        )
        return begun.searched()

    def nuisances(self) -> dict[str, float]:
        """What stands between aircraft and log, the last flight's where each has its own."""
        begin = len(self.names)
        return {one.name: float(v) for one, v in zip(self.posterior.model.unknowns, self.theta[begin:], strict=False)}

    def profile_cost_from(
        self, candidate: Candidate | None, values: Mapping[str, float], start: Mapping[str, float]
    ) -> float:
        """Half the deviance with a candidate, or none, at these values and others at `start`, nothing searched."""
        coefficients, model, fresh = self.coefficients, self.structure, dict[str, Fresh]()
        if candidate is not None:
            model = self._of_own_axes(extended(self.structure, candidate, within(candidate, dict(values))))
            own = tuple(name for name in candidate.coefficients if self.takes(name))
            coefficients = (*coefficients, *own)
            fresh = {name: fresh_unknown(candidate, name, values[name]) for name in own}
        begun = self._rebuilt(model, coefficients, self.effects, fresh, start)
        return begun.posterior.of(begun.posterior.model.rough()).profile_cost(begun.theta)

    def _of_own_axes(self, model: Model) -> Model:
        return replace(
            model, coefficients={name: entry for name, entry in model.coefficients.items() if self.takes(name)}
        )

    def searched(self) -> GroupFit | None:
        """The fit from where it begins to its maximum; None where it is lost."""
        try:
            theta = self.posterior.search(self.theta, _PASSES)
            evidence = self.posterior.evidence(theta)
        except (EstimationError, np.linalg.LinAlgError):
            return None
        return replace(self, theta=theta, evidence=evidence) if np.isfinite(evidence) else None

    def _rebuilt(
        self,
        model: Model,
        coefficients: tuple[str, ...],
        effects: tuple[tuple[str, str], ...],
        fresh: Mapping[str, Fresh] = MappingProxyType({}),
        start: Mapping[str, float] | None = None,
    ) -> GroupFit:
        """A fit of other unknowns before it is searched: those that stay have their priors and bounds. start: as in
        `with_effect`.
        """
        before = self.posterior
        flown = before.model.flying(model, coefficients, effects)
        old, new = list(self.names), [one.name for one in flown.parameters]
        rest = list(range(len(old), self.theta.size))
        source = [old.index(name) if name in old else -1 for name in new] + rest
        size = len(source)
        kept = [i for i, place in enumerate(source) if place >= 0]
        own = [source[i] for i in kept]
        theta, mean, low, high = np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size)
        information = np.zeros((size, size))
        information[np.ix_(kept, kept)] = before.prior.information[np.ix_(own, own)]
        theta[kept], mean[kept] = self.theta[own], before.prior.mean[own]
        low[kept], high[kept] = before.low[own], before.high[own]
        for i, name in enumerate(new):
            if source[i] < 0:
                one = fresh[name]
                theta[i], mean[i], low[i], high[i] = one.start, one.mean, one.low, one.high
                information[i, i] = 1.0 / one.std**2
        if start is not None:
            begin, end = len(new), len(new) + len(flown.unknowns.names)
            theta[begin:end] = mean[begin:end]
            for i, name in enumerate((*new, *(one.name for one in flown.unknowns))):
                theta[i] = start.get(name, theta[i])
        posterior = Posterior(flown, Prior(mean, information), low, high, before.zeros, before.whole)
        return GroupFit(posterior, np.clip(theta, low, high), model, coefficients, effects, -np.inf, self.doubts)


def fit_of(estimate: GroupEstimate, structure: Model, effects: Sequence[tuple[str, str]]) -> GroupFit:
    """The fit that an estimate is the end of. structure, effects: as `sysid.posterior.analysis.estimate` had them."""
    posterior, result = estimate.posterior, estimate.result
    free = [one.name for one in posterior.model.parameters]
    coefficients = tuple(name for name in free if name in structure.coefficients)
    flown = tuple(pair for pair in effects if ".".join(pair) in free)
    own = {name: entry for name, entry in structure.coefficients.items() if name in coefficients}
    theta = np.concatenate((result.theta, result.states))
    model = replace(structure, coefficients=own, correlation=None)
    return GroupFit(posterior, theta, model, coefficients, flown, posterior.evidence(theta), estimate.doubts)


def fresh_unknown(candidate: Candidate, name: str, start: float) -> Fresh:
    """Prior of a candidate's parameter: about nothing where it is a size, over its range where it is a limit."""
    if candidate.coefficients:
        return Fresh(start, 0.0, _COEFFICIENT * usual_size(name), -np.inf, np.inf)
    one = candidate.effect.parameter(name)
    if one.moment:
        return Fresh(start, start, _MOMENT_S, one.low, one.high)
    if is_size(one):
        return Fresh(start, 0.0, one.usual or _SIZE * max(abs(one.low), abs(one.high)), one.low, one.high)
    return Fresh(start, 0.5 * (one.low + one.high), 0.5 * (one.high - one.low), one.low, one.high)


def is_size(one: Parameter) -> bool:
    """Whether a parameter of 0 makes nothing: a lag's time does, though it is simulated from its least on."""
    return not one.moment and (one.low <= 0.0 or one.unit == "s")
