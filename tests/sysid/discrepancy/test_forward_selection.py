"""What the search for missing effects names and takes back, over fits whose costs are said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from sim_vehicle.effects import EFFECTS
from sim_vehicle.model.model_file import Model
from sysid.discrepancy.candidate_fit import Trial
from sysid.discrepancy.candidates import Candidate
from sysid.discrepancy.forward_selection import SelectionState, select
from sysid.discrepancy.identified_effect import Named
from sysid.discrepancy.innovations.candidate_fits import FittedModel
from sysid.discrepancy.innovations.innovations_fit import InnovationsFit
from sysid.discrepancy.naming_rule import LeftOver
from sysid.discrepancy.significance import Significance
from sysid.filter_error.estimator import FilterErrorResult
from sysid.numerics.dryden import Turbulence
from sysid.problem.free_parameters import effect_parameter

PARAMETERS = {"thrust_scale": "scale", "mass_error": "scale", "density_error": "scale", "unsteady_lift": "tau"}


@dataclass(frozen=True)
class Flight:
    """Stands for the records of a flight."""

    interval_s: float = 0.02


@dataclass(frozen=True)
class Flown:
    """Stands for a problem."""

    records: tuple[Flight, ...] = (Flight(),)


@dataclass(frozen=True)
class Fit:
    """Stands for a fitted model. costs: negative log likelihood with each set of effects. over: that are doubtful."""

    costs: Mapping[frozenset[str], float]
    has: frozenset[str] = frozenset()
    over: frozenset[str] = frozenset()
    remains: Mapping[str, LeftOver] = field(default_factory=dict)
    asked: list[float] = field(default_factory=list)
    problem: Any = field(default_factory=Flown)
    model: Any = None

    @property
    def cost(self) -> float:
        return self.costs[self.has]

    @property
    def evidence(self) -> float:
        return -self.cost - 3.0 * len(self.has)

    def choices(self) -> list[Candidate]:
        every = sorted(frozenset().union(*self.costs) - self.has)
        return [Candidate(EFFECTS[name], (PARAMETERS[name],), ({PARAMETERS[name]: 0.05},)) for name in every]

    def trials(self, choices: Sequence[Candidate], progress: object) -> list[Trial[Fit]]:
        found = []
        for one in choices:
            if (more := self.has | {one.effect.name}) in self.costs:
                fit = replace(self, has=more)
                found.append(Trial(one, fit, fit.values_of(one), 2.0 * (self.cost - fit.cost), self.gained(fit)))
        return found

    def gained(self, other: Fit) -> float:
        return other.evidence - self.evidence

    def confirmed(self, trial: Trial[Fit], significance: Significance) -> Significance:
        return significance

    def with_named(self, trial: Trial[Fit]) -> Fit:
        return trial.fit

    def without(self, candidate: Candidate) -> Fit | None:
        rest = self.has - {candidate.effect.name}
        return replace(self, has=rest) if rest in self.costs else None

    def values_of(self, candidate: Candidate) -> dict[str, tuple[float, float]]:
        return {name: (0.05 + 0.01 * len(self.has), 0.001) for name in candidate.free}

    def sharpened(self) -> Fit:
        return self

    def doubtful(self, named: Sequence[Named]) -> Named | None:
        return next((one for one in named if one.effect in self.over), None)

    def left(self, least: float) -> Mapping[str, LeftOver]:
        self.asked.append(least)
        return self.remains


def costs_of(**costs: float) -> dict[frozenset[str], float]:
    """Costs by sets of effects, each written by first letters: tm is the thrust's scale and the mass."""
    letters = {name[0]: name for name in PARAMETERS}
    return {frozenset(): 0.0} | {frozenset(letters[letter] for letter in key): cost for key, cost in costs.items()}


def searched(fit: Fit, ruled_out: frozenset[str] = frozenset()) -> SelectionState[Fit]:
    return select(fit, ruled_out, lambda share, text: None)


def names_of(found: SelectionState[Any]) -> list[str]:
    return [one.effect for one in found.named]


def test_the_likeliest_is_named_with_what_it_may_be_instead() -> None:
    found = searched(Fit(costs_of(t=-500.0, m=-499.5, d=-100.0)))
    assert names_of(found) == ["thrust_scale"]
    (one,) = found.named
    assert [name for name, _ in one.alternatives] == ["mass_error"]
    assert one.significance.probability == pytest.approx(1.0 / (1.0 + np.exp(-0.5)))
    assert (found.whole, found.gains) == (1000.0, {"thrust_scale": 1000.0})
    assert one.values == found.fit.values_of(one.candidate)


def test_what_is_known_not_to_be_there_is_not_looked_at() -> None:
    assert names_of(searched(Fit(costs_of(t=-500.0, m=-400.0)), frozenset({"thrust_scale"}))) == ["mass_error"]


@pytest.mark.parametrize(("gain", "named", "said"), [(8.0, 0, 0), (24.0, 0, 1), (40.0, 1, 0)])
def test_a_name_needs_five_standard_errors_and_what_is_near_is_said(gain: float, named: int, said: int) -> None:
    found = searched(Fit(costs_of(t=-0.5 * gain)))
    assert (len(found.named), len(found.notes)) == (named, said)


def test_beside_what_explains_thousands_hundreds_are_no_name() -> None:
    found = searched(Fit(costs_of(t=-5000.0, tm=-5200.0)))
    assert names_of(found) == ["thrust_scale"]
    assert found.notes == ["mass_error: gains 400, no more than thrust_scale may leave"]


def test_what_is_not_needed_beside_the_others_is_dropped_the_cheapest_first() -> None:
    """The density alone explains most of what the other two do together."""
    costs = costs_of(d=-500.0, m=-300.0, t=-250.0, dm=-700.0, dmt=-1000.0, dt=-600.0, mt=-999.0)
    found = searched(Fit(costs))
    assert names_of(found) == ["mass_error", "thrust_scale"]
    assert found.notes == ["density_error: named for a while, not needed beside the others"]
    # Nothing that was dropped is an alternative.
    assert all(name != "density_error" for one in found.named for name, _ in one.alternatives)
    assert found.gains == {"mass_error": 2.0 * 749.0, "thrust_scale": 2.0 * 699.0}


def test_a_memory_leaves_a_share_of_what_it_came_with_to_others_and_no_more() -> None:
    """A lag that came in with 2,000 gains a million once the noise is small: 3 % of that is no measure of others."""
    costs = costs_of(u=-1000.0, t=-1.0, ut=-500_000.0)
    found = searched(Fit(costs))
    assert names_of(found) == ["unsteady_lift", "thrust_scale"]
    assert found.fit.asked == [pytest.approx(0.03 * 2000.0)]


def test_beside_a_memory_that_came_with_much_little_is_not_added() -> None:
    """A lag came in with 9,800 beside a first name of 200: 3 % of that is 294, more than a third gains."""
    found = searched(Fit(costs_of(t=-100.0, u=-90.0, tu=-5000.0, tum=-5125.0, um=-100.0, tm=-110.0)))
    assert names_of(found) == ["thrust_scale", "unsteady_lift"]
    assert (found.taken_back, found.notes) == ([], [])


def test_a_gain_with_gusts_held_fixed_counts_as_far_as_the_size_is_known_beside_them() -> None:
    costs = costs_of(t=-500.0, m=-300.0, tm=-800.0)
    found = searched(Fit(costs, over=frozenset({"mass_error"})))
    assert names_of(found) == ["thrust_scale"]
    assert found.notes == ["mass_error: named for a while, but its size is within its standard error"]
    none = searched(Fit(costs, over=frozenset({"mass_error", "thrust_scale"})))
    assert none.named == []
    assert none.fit is none.base


def test_companions_that_the_first_may_leave_of_itself_are_taken_back_and_counted() -> None:
    left = {"CL": LeftOver("smooth terms", 300.0)}
    # Without the first a fit ends far beyond where everything began: it lost its way, and what it asks is no measure.
    costs = costs_of(m=-1000.0, t=-200.0, mt=-1200.0)
    costs[frozenset({"thrust_scale"})] = 80_000.0
    found = searched(Fit(costs, remains=left))
    assert names_of(found) == ["mass_error"]
    assert (found.taken_back, found.whole) == (["thrust_scale"], 2400.0)
    # What is left is seen beside all of them: what they explain is not counted twice.
    assert found.left == left
    assert found.gains["mass_error"] == 2.0 * 81_200.0
    assert len(found.notes) == 1


def test_what_stands_beside_the_first_by_a_third_is_a_name_of_its_own() -> None:
    found = searched(Fit(costs_of(m=-1000.0, t=-500.0, mt=-1400.0)))
    assert names_of(found) == ["mass_error", "thrust_scale"]
    assert found.taken_back == []


def filtered(sizes: Mapping[str, tuple[float, float]], *, together: bool) -> tuple[InnovationsFit, list[Named]]:
    """A fit by filter error in rough air. sizes: effect -> value and standard error of its scale."""
    values, stds = ([pair[k] for pair in sizes.values()] for k in (0, 1))
    covariance = np.diag(np.square(stds))
    parameters = tuple(effect_parameter(name, "scale") for name in sizes)
    result = FilterErrorResult(
        parameters, np.array(values), covariance, covariance, np.zeros(15), Turbulence(0.2, 0.2), (), -1000.0,
        -900.0 if together else np.nan, 1, True,
    )  # fmt: skip
    candidates = [Candidate(EFFECTS[name], ("scale",), ({"scale": 0.01},)) for name in sizes]
    named = [Named(one, Significance(0.9, 80.0, 1e-19), (), {"scale": (0.0, 1.0)}, 44, 80.0) for one in candidates]
    at = FittedModel(Model("plane", {}), [], [(name, "scale") for name in sizes], result)
    problem: Any = None  # Nobody looks at the flights.
    return InnovationsFit(problem, at, problem), named


def test_in_gusts_the_size_that_is_least_beyond_its_standard_error_is_doubtful() -> None:
    sizes = {"density_error": (0.023, 0.01), "thrust_scale": (0.5, 0.01), "mass_error": (0.03, 0.01)}
    fit, named = filtered(sizes, together=True)
    doubtful = fit.doubtful(named)
    assert doubtful is not None
    assert doubtful.effect == "density_error"
    assert fit.doubtful(named[1:2]) is None


def test_where_gusts_were_not_estimated_beside_the_sizes_the_likelihood_is_enough() -> None:
    fit, named = filtered({"density_error": (0.023, 0.01)}, together=False)
    assert fit.doubtful(named) is None


def test_what_would_have_been_a_surprise_before_the_flight_is_less_likely() -> None:
    usual, _ = filtered({"density_error": (0.02, 0.01)}, together=False)
    odd, _ = filtered({"density_error": (0.2, 0.01)}, together=False)
    read = (np.ones((100, 15)),)
    usual, odd = (replace(one, at=replace(one.at, result=replace(one.result, residuals=read))) for one in (usual, odd))
    typical = EFFECTS["density_error"].parameter("scale").usual
    assert typical
    assert usual.evidence - odd.evidence == pytest.approx(0.5 * (0.2**2 - 0.02**2) / typical**2)
