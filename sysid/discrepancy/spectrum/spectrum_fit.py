"""A model fitted by the posterior with an estimated noise spectrum, as the search for missing effects asks of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from sim_vehicle.model.model_file import Model
from sysid.discrepancy.candidate_fit import Trial
from sysid.discrepancy.candidates import Candidate, candidates, stepping_of, without_absent
from sysid.discrepancy.identified_effect import Named
from sysid.discrepancy.naming_rule import BORNE_OUT, EVIDENCE, KNOWN_TO, LEAST_PROMISE, PROMISE_SHARE, LeftOver
from sysid.discrepancy.significance import NAMING_P_VALUE, Significance, chance_of
from sysid.discrepancy.smooth_terms import explained_by_axis, smooth_terms
from sysid.discrepancy.spectrum.group_fits import GroupFit, is_size
from sysid.discrepancy.spectrum.screening import PredictedGain, RestartGain, promises, second_looks
from sysid.discrepancy.wording import chance_text
from sysid.numerics.normal_equations import inverse
from sysid.problem.estimation_problem import Problem, Progress

_MOST_TRIED = 6  # candidates fitted at each step
# Twice the log likelihood by which one must be better from elsewhere, where nothing is at its best, to be begun there;
# and so many in each group of axes.
_LEAST_SECOND_LOOK, _MOST_SECOND_LOOKS = 40.0, 2

_Looks = dict[str, tuple[PredictedGain, RestartGain | None]]


@dataclass(frozen=True)
class SpectrumFit:
    """A model fitted in each group of axes.

    given: values of the model's coefficients and parameters of effects before anything was fitted. aliases: whether
    effects that coefficients all but imitate are looked at. seen: by group its fit, and what it was promised by each
    candidate.
    """

    problem: Problem
    model: Model
    groups: Mapping[str, GroupFit]
    given: Mapping[str, float]
    aliases: bool = False
    seen: dict[str, tuple[GroupFit, _Looks]] = field(default_factory=dict)

    @cached_property
    def cost(self) -> float:
        """Negative log likelihood of all groups, noise estimated at this fit."""
        return sum(fit.cost for fit in self.groups.values())

    @property
    def evidence(self) -> float:
        """Logarithm of the evidence of all groups."""
        return sum(fit.evidence for fit in self.groups.values())

    def choices(self) -> list[Candidate]:
        """Every effect that the flights could show, from its own starts. What coefficients all but imitate is one of
        them in flights of the textbooks alone: a structure that lacks a term would be reported as the term's imitation.
        """
        return [
            replace(one, starts=one.effect.starts()) if stepping_of(one.effect) else one
            for one in candidates(self.problem, self.model)
            if self.aliases or not one.effect.alias
        ]

    def trials(self, choices: Sequence[Candidate], progress: Progress) -> list[Trial[Self]]:
        """The promising ones of these, each fitted in the group that it promises most."""
        looked = {group: self._looked(group, choices) for group in self.groups}
        promised = {group: [first for first, _ in of] for group, of in looked.items()}
        looks = {group: [second for _, second in of] for group, of in looked.items()}
        total = [sum(max(of[i].gain, 0.0) for of in promised.values()) for i in range(len(choices))]
        order = sorted(range(len(choices)), key=lambda i: -total[i])
        limit = max(LEAST_PROMISE, PROMISE_SHARE * total[order[0]]) if order else np.inf
        worth = [i for i in order[:_MOST_TRIED] if total[i] >= limit]
        if worth:
            # What coefficients imitate shows in no slope, only in its curvature.
            worth += [i for i in order if choices[i].effect.by_curvature and i not in worth]
        begun: list[tuple[int, str | None]] = [(i, None) for i in worth]
        begun += _worth_a_second_look(looks)
        best: dict[str, Trial[Self]] = {}
        for count, (i, group) in enumerate(begun):
            progress((count + 1.0) / (len(begun) + 1.0), f"trying {choices[i].effect.name}")
            of_groups = {name: of[i] for name, of in promised.items()}
            one = self._tried(choices[i], of_groups, None if group is None else (group, looks[group][i]))
            # Another start of the same candidate may have left it behind.
            if one is not None and (_key(choices[i]) not in best or one.evidence > best[_key(choices[i])].evidence):
                best[_key(choices[i])] = one
        return list(best.values())

    def confirmed(self, trial: Trial[Self], significance: Significance) -> Significance:
        """What a gain comes to where bars count all: the colour that the noise keeps, what no structure holds, what was
        taken as known. A likelihood that knows of none of these grows with every second flown.
        """
        first = trial.candidate.parameter(next(iter(trial.values)))
        own = next(fit for fit in trial.fit.groups.values() if first in fit.names)
        gain = _with_full_bars(own, trial.candidate, tuple(trial.values), trial.gain)
        return Significance(significance.probability, gain, chance_of(gain, len(trial.values)))

    def with_named(self, trial: Trial[Self]) -> Self:
        """The fit of a trial."""
        return trial.fit

    def without(self, candidate: Candidate) -> Self | None:
        """All groups without an effect; None where one is lost."""
        groups = {group: fit.without(candidate) for group, fit in self.groups.items()}
        kept = {group: fit for group, fit in groups.items() if fit is not None}
        gone, model = set(candidate.coefficients), self.model
        model = replace(
            model,
            coefficients={name: entry for name, entry in model.coefficients.items() if name not in gone},
            effects=tuple(e for e in model.effects if gone or e.name != candidate.effect.name),
        )
        return replace(self, model=model, groups=kept) if len(kept) == len(groups) else None

    def values_of(self, candidate: Candidate) -> dict[str, tuple[float, float]]:
        """Value and standard error of a candidate's parameters, by name."""
        found: dict[str, tuple[float, float]] = {}
        for fit in self.groups.values():
            own = [name for name in candidate.free if candidate.parameter(name) in fit.names]
            values, stds = (fit.values(), fit.stds()) if own else ({}, {})
            found |= {name: (values[candidate.parameter(name)], stds[candidate.parameter(name)]) for name in own}
        return found

    def sharpened(self) -> Self:
        """Itself: the noise is estimated at every fit."""
        return self

    def doubtful(self, named: Sequence[Named]) -> Named | None:
        """None: `confirmed` has counted everything."""
        return None

    def left(self, least: float) -> dict[str, LeftOver]:
        """Smooth terms of every axis, which no single effect is: what gains by them has no name."""
        terms = smooth_terms(self.problem, self.model)
        found: dict[str, LeftOver] = {}
        for fit in self.groups.values():
            own = [one for one in terms if fit.takes(one.free[0])]
            explained = explained_by_axis(fit.names, fit.theta[: len(fit.names)], fit.covariance())
            for one, promise in zip(own, promises(fit, own), strict=True):
                after = None if promise.gain < LEAST_PROMISE else fit.with_effect(one, promise.values)
                if after is None:
                    continue
                gain = 2.0 * (fit.cost - after.cost)
                floor = max(least, KNOWN_TO * explained.get(one.effect.name, 0.0))
                if gain < floor or after.evidence - fit.evidence < EVIDENCE:
                    continue
                sure = _with_full_bars(after, one, one.free, gain)
                if (chance := chance_of(sure, len(one.free))) * len(terms) < NAMING_P_VALUE:
                    found[one.effect.name] = LeftOver(f"smooth terms gain {sure:.0f}, {chance_text(chance)}", gain)
        return found

    def _looked(self, group: str, choices: Sequence[Candidate]) -> list[tuple[PredictedGain, RestartGain | None]]:
        """What candidates promise a group of axes, as it was found before where nothing of it has changed since."""
        fit = self.groups[group]
        if group not in self.seen or self.seen[group][0] is not fit:
            first = promises(fit, choices)
            both = zip(first, second_looks(fit, choices, first, self.given), strict=True)
            self.seen[group] = (fit, {_key(one): of for one, of in zip(choices, both, strict=True)})
        known = self.seen[group][1]
        return [known[_key(one)] for one in choices]

    def _tried(
        self,
        candidate: Candidate,
        promised: Mapping[str, PredictedGain],
        look: tuple[str, RestartGain | None] | None,
    ) -> Trial[Self] | None:
        """A candidate fitted, without parameters that are as good as absent where that is likelier."""
        whole = self._fitted(candidate, promised, look)
        fewer = None if whole is None else without_absent(candidate, whole.values)
        if whole is None or fewer is None:
            return whole
        (values,) = fewer.starts
        if look is not None and look[1] is not None:
            look = (look[0], replace(look[1], values=values))
        part = self._fitted(fewer, {group: replace(one, values=values) for group, one in promised.items()}, look)
        return part if part is not None and part.evidence > whole.evidence else whole

    def _fitted(
        self,
        candidate: Candidate,
        promised: Mapping[str, PredictedGain],
        look: tuple[str, RestartGain | None] | None,
    ) -> Trial[Self] | None:
        """A candidate fitted in the group that it promises most, and flown as it is found there in the others.

        look: the group in which it is begun from elsewhere, and where.
        """
        own = max(promised, key=lambda group: promised[group].gain)
        if look is not None and look[1] is not None:
            own, begin = look[0], look[1]
            after = self.groups[own].with_effect(candidate, {**promised[own].values, **begin.values}, begin.start)
        else:
            after = self.groups[own].with_effect(candidate, promised[own].values)
        if after is None:
            return None
        values, stds = after.values(), after.stds()
        known = {name: (values[candidate.parameter(name)], stds[candidate.parameter(name)]) for name in candidate.free
                 if candidate.parameter(name) in values}  # fmt: skip
        sizes = {name: value for name, (value, _) in known.items()}
        groups = {**self.groups, own: after}
        for group, promise in promised.items():
            if group != own and promise.acts and not candidate.coefficients:
                other = self.groups[group].flying(candidate, sizes)
                if other is None:
                    return None
                groups[group] = other
        fit = replace(self, groups=groups, model=self.model.with_effect(candidate.effect, sizes))
        gain = min(2.0 * (self.cost - fit.cost), _borne_out(candidate, known))
        return Trial(candidate, fit, known, gain, min(fit.evidence - self.evidence, 0.5 * gain))


def _key(candidate: Candidate) -> str:
    return candidate.effect.title


def _worth_a_second_look(looks: Mapping[str, Sequence[RestartGain | None]]) -> list[tuple[int, str]]:
    """Candidates that come nearest to the flight from elsewhere, and the group of axes in which they do."""
    found: list[tuple[int, str]] = []
    for group, of in looks.items():
        better = [(one.cost, i) for i, one in enumerate(of) if one is not None and one.gain >= _LEAST_SECOND_LOOK]
        found += [(i, group) for _, i in sorted(better)[:_MOST_SECOND_LOOKS]]
    return found


def _borne_out(candidate: Candidate, values: Mapping[str, tuple[float, float]]) -> float:
    """What the sizes of an effect bear out of a gain: one far beyond their standard errors is of a search that went on
    elsewhere. Infinite for limits, which have no size that vanishes.
    """
    if not _has_sizes(candidate, values):
        return float(np.inf)
    return BORNE_OUT * float(sum((value / max(std, 1e-300)) ** 2 for value, std in values.values()))


def _has_sizes(candidate: Candidate, names: Mapping[str, object] | Sequence[str]) -> bool:
    return bool(candidate.coefficients) or all(is_size(candidate.effect.parameter(name)) for name in names)


def _with_full_bars(fit: GroupFit, candidate: Candidate, names: Sequence[str], gain: float) -> float:
    """A gain by some of a candidate's parameters, as far as their whole errors bear it out."""
    result = fit.ended().result
    places = [result.names.index(candidate.parameter(name)) for name in names]
    here = np.ix_(places, places)
    full, white = result.covariance[here], result.fisher[here]
    gain *= min(1.0, *(np.diag(white) / np.diag(full)).tolist())
    if _has_sizes(candidate, names):
        values = result.theta[places]
        gain = min(gain, float(values @ inverse(full) @ values))
    return gain
