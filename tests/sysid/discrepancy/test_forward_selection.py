"""What the search for missing effects takes back."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from sim_vehicle.effects import EFFECTS
from sim_vehicle.model.model_file import Model
from sysid.discrepancy.by_filter_error import forward_selection
from sysid.discrepancy.by_filter_error.forward_selection import (
    Search,
    eliminate_insignificant,
    eliminate_redundant,
    settle_names,
)
from sysid.discrepancy.candidates import Candidate
from sysid.discrepancy.identified_effect import Named
from sysid.discrepancy.naming_rule import LeftOver
from sysid.discrepancy.significance import Significance
from sysid.filter_error.estimator import FilterErrorResult
from sysid.numerics.dryden import Turbulence
from sysid.problem.estimation_problem import Problem
from sysid.problem.free_parameters import effect_parameter


def result_of(names: tuple[str, ...], values: list[float], stds: list[float], together: bool) -> FilterErrorResult:
    """An estimate of one parameter of each named effect, independent of each other."""
    covariance = np.diag(np.square(stds))
    parameters = tuple(effect_parameter(*name.split(".")) for name in names)
    return FilterErrorResult(
        parameters, np.array(values), covariance, covariance, np.zeros(15), Turbulence(0.2, 0.2), (), -1000.0,
        -900.0 if together else np.nan, 1, True,
    )  # fmt: skip


# Half the deviance before anything was named; with all that was named it is -1000.
BEGAN = -600.0


def searched(sizes: dict[str, tuple[float, float]], *, together: bool) -> Search:
    """A search that has named effects, each for a great gain. sizes: "effect.parameter" -> (value, standard error)."""
    named = []
    for i, (name, (value, std)) in enumerate(sizes.items()):
        effect, parameter = name.split(".")
        candidate = Candidate(EFFECTS[effect], (parameter,), ({parameter: 0.01},))
        others = tuple((other.split(".")[0], 0.3) for other in sizes if other != name)
        named.append(
            Named(candidate, Significance(0.9, 80.0 + i, 1e-19), others, {parameter: (value, std)}, 44, 80.0 + i)
        )
    values, stds = ([pair[k] for pair in sizes.values()] for k in (0, 1))
    model = Model("plane", {})
    for one in named:
        model = model.with_effect(one.candidate.effect, {name: value for name, (value, _) in one.values.items()})
    result = result_of(tuple(sizes), values, stds, together)
    # Nobody looks at the flights.
    return Search(
        cast("Problem", None), model, [], [(one.effect, one.candidate.free[0]) for one in named], result, BEGAN, named
    )


class Costs:
    """Stands for fits without an effect: each costs what is said of the effects that are left."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, costs: dict[frozenset[str], float]) -> None:
        self.costs = costs
        monkeypatch.setattr(forward_selection, "build_filter", self.build)
        monkeypatch.setattr(forward_selection, "model_of", lambda model, *_: model)

    def build(self, problem: object, model: Model, coefficients: object, effects: list[tuple[str, str]]) -> Costs:
        self.left = effects
        return self

    def solve(self, start: dict[str, float], *_: object, **__: object) -> FilterErrorResult:
        names = tuple(f"{effect}.{parameter}" for effect, parameter in self.left)
        cost = self.costs[frozenset(effect for effect, _ in self.left)]
        return replace(result_of(names, [start[n] for n in names], [1e-3] * len(names), True), cost=cost)


def names_of(found: Search) -> list[str]:
    return [one.effect for one in found.named]


@pytest.mark.parametrize(("sigmas", "kept"), [(2.3, []), (10.0, ["density_error"])])
def test_a_gain_with_gusts_held_fixed_counts_as_far_as_the_size_is_known_beside_them(
    monkeypatch: pytest.MonkeyPatch, sigmas: float, kept: list[str]
) -> None:
    Costs(monkeypatch, {frozenset(): -990.0})
    found = searched({"density_error.scale": (sigmas * 0.01, 0.01)}, together=True)
    eliminate_insignificant(found)
    assert names_of(found) == kept
    assert len(found.dropped) == 1 - len(kept)


def test_one_that_is_borne_out_shields_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    Costs(monkeypatch, {frozenset({"thrust_scale"}): -990.0})
    sizes = {"density_error.scale": (0.023, 0.01), "thrust_scale.scale": (0.5, 0.01)}
    found = searched(sizes, together=True)
    eliminate_insignificant(found)
    assert names_of(found) == ["thrust_scale"]
    assert found.named[0].alternatives == ()
    assert found.dropped == ["density_error: named for a while, but its size is within its standard error"]


def test_where_gusts_were_not_estimated_beside_the_sizes_the_likelihood_is_enough() -> None:
    found = searched({"density_error.scale": (0.023, 0.01)}, together=False)
    eliminate_insignificant(found)
    assert names_of(found) == ["density_error"]


def test_what_is_not_needed_beside_the_others_is_dropped_the_cheapest_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """Either of the first two explains what the other does; the third is needed. Costs are half of what is lost."""
    left = {
        frozenset({"thrust_scale", "mass_error"}): -999.0,  # without the density: 2
        frozenset({"density_error", "mass_error"}): -998.0,  # without the thrust: 4
        frozenset({"density_error", "thrust_scale"}): -500.0,
        frozenset({"thrust_scale"}): -490.0,
        frozenset({"mass_error"}): -400.0,
    }
    Costs(monkeypatch, left)
    sizes = {"density_error.scale": (0.1, 0.01), "thrust_scale.scale": (0.5, 0.01), "mass_error.scale": (0.2, 0.01)}
    found = searched(sizes, together=True)
    eliminate_redundant(found)
    assert names_of(found) == ["thrust_scale", "mass_error"]
    # What they gain is told beside each other, and nothing that was dropped is an alternative.
    assert [one.significance.gain for one in found.named] == [2.0 * 599.0, 2.0 * 509.0]
    assert all(name != "density_error" for one in found.named for name, _ in one.alternatives)


def test_what_a_memory_gains_beside_the_others_does_not_hide_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """A lag that came in with 80 gains a million once the noise is small: 3 % of that is no measure of the others."""
    left = {frozenset({"thrust_scale"}): 499_000.0, frozenset({"unsteady_lift"}): -500.0}
    Costs(monkeypatch, left)
    found = searched({"unsteady_lift.tau": (0.05, 0.001), "thrust_scale.scale": (0.5, 0.01)}, together=True)
    eliminate_redundant(found)
    assert names_of(found) == ["unsteady_lift", "thrust_scale"]


def test_companions_that_the_first_may_leave_of_itself_are_taken_back_and_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[list[str]] = []

    def lack_of_fit(problem: object, setting: object, least: float) -> dict[str, LeftOver]:
        seen.append(names_of(found))
        return {"CL": LeftOver("smooth terms", 300.0)}

    monkeypatch.setattr(forward_selection, "lack_of_fit", lack_of_fit)
    Costs(monkeypatch, {
        frozenset({"mass_error", "thrust_scale"}): -999.0, frozenset({"mass_error"}): -998.0,
    })  # fmt: skip
    found = searched({"mass_error.scale": (0.5, 0.01), "density_error.scale": (0.1, 0.01),
                      "thrust_scale.scale": (0.1, 0.01)}, together=True)  # fmt: skip
    # Without the first a fit ends far beyond where everything began: it lost its way, and what it asks is no measure.
    gains = (155_000.0, 50.0, 80.0)
    found.named = [
        replace(one, significance=replace(one.significance, gain=gain))
        for one, gain in zip(found.named, gains, strict=True)
    ]
    settle_names(found)
    # What is left is seen beside all of them: what they explain is not counted twice.
    assert seen == [["mass_error", "density_error", "thrust_scale"]]
    assert names_of(found) == ["mass_error"]
    assert found.taken_back == ["density_error", "thrust_scale"]
    assert found.whole == 2.0 * (BEGAN + 1000.0)
    assert len(found.dropped) == 2


def test_what_stands_beside_the_first_by_a_third_is_a_name_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forward_selection, "lack_of_fit", lambda *_: {})
    found = searched({"mass_error.scale": (0.5, 0.01), "thrust_scale.scale": (0.1, 0.01)}, together=True)
    gains = (155_000.0, 250.0)
    found.named = [
        replace(one, significance=replace(one.significance, gain=gain))
        for one, gain in zip(found.named, gains, strict=True)
    ]
    settle_names(found)
    assert names_of(found) == ["mass_error", "thrust_scale"]
    assert found.taken_back == []
